"""A robot inside a system of its own, and its emulated devices outside."""

import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final

from benchmarks.hardware.standstill_rig import NotDrivingError, Rig
from benchmarks.processors import debian

KEPT: Final = "var/lib/acrc"
"""Of the system: recordings, last pose, counted starts."""
_PATIENCE_S: Final = {False: 60.0, True: 600.0}
"""Until the robot drives; True: in the emulator."""
_GRACE_S: Final = 20.0


class BundledRig(Rig):
    """The devices outside, the robot inside."""

    def __init__(self, folder: Path, system: Path, machine: str) -> None:
        super().__init__(folder)
        self._system, self._machine = system, machine

    def onboard(self) -> list[str]:
        """As the installed service has it, as the user that it names, below its state folder."""
        for link in (self.folder / "links" / "r1").iterdir():
            link.resolve().chmod(0o666)  # udev does so on a robot
        unit = (self._system / "etc/systemd/system/acrc-r1.service").read_text().splitlines()
        said = dict(line.split("=", 1) for line in unit if "=" in line)
        user = said["User"]
        who = ("setpriv", "--reuid", user, "--regid", user, "--init-groups")
        words = (*who, "env", f"-C/{KEPT}", f"HOME=/{KEPT}", *said["ExecStart"].split())
        return [*debian.inside(self._system, self.folder, self._machine, words)]

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop it as systemd does: by SIGTERM to the first process inside."""
        pid = self._onboard.pid
        with suppress(OSError, subprocess.TimeoutExpired):
            for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
                os.kill(int(child), signal.SIGTERM)
            self._onboard.wait(_GRACE_S)
        super().__exit__(kind, error, trace)

    def said(self) -> str:
        """What the robot has said, on one line."""
        return " ".join((self.folder / "onboard.log").read_text().split())

    def drive(self, seconds: float) -> float:
        """Wait until the robot has moved, and so long; its way, m. Raises NotDrivingError.

        An emulated one may be too late with every step to be let move: then it is 0 after a while.
        """
        ended = time.monotonic() + _PATIENCE_S[debian.is_emulated(self._machine)]
        while not self.where().way:
            late = time.monotonic() > ended
            if late and debian.is_emulated(self._machine):
                return 0.0
            if late or self._onboard.poll() is not None:
                raise NotDrivingError(f"the robot did not drive: {self.said()[-300:]}")
            time.sleep(0.1)
        time.sleep(seconds)
        return self.where().way
