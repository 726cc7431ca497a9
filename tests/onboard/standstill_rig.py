"""One robot on emulated devices, with injected faults of processes and devices."""

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, Self

from actors.installation.repository import REPOSITORY, SHIPPED
from actors.runtime.errors import AcrcError
from tests.laboratory.hosts import Running, setup

GUARDIAN: Final = "guardian.py"
MAP: Final = SHIPPED / "maps" / "corridor.yaml"
_FAST: Final = 0.45
"""Speed above which the robot counts as driving, m/s; its maximum is 0.5."""
FLEET: Final = """
map = "{map}"
[run]
strategy = "none"
[[robot]]
id = "r1"
address = 1
start = [12.0, 12.5, 0.0]
places = [[22.0, 12.5], [8.0, 12.5]]
base = "{links}/base"
radio = "{links}/radio"
range = "{links}/range"
"""
_NICE: Final = -10
"""Nice value of all processes, if permitted; the service has -5."""
_PTRACE_SEIZE: Final = 0x4206
_PTRACE_INTERRUPT: Final = 0x4207

TITLE: Final = "acrc r1"
"""Process title of a sandboxed robot."""


class NotDrivingError(AcrcError):
    """Failure of the robot to start driving."""


class Where(NamedTuple):
    """Ground truth."""

    time: float
    way: float
    speed: float
    told: float
    """1 if the last command to the wheels was a stop."""


class Rig:
    """Emulated devices and the processes of a robot; a context manager."""

    fleet = FLEET
    fast = _FAST

    def __init__(self, folder: Path, more: str = "") -> None:
        """Create it; `more`: additional lines of the robot's table."""
        self.folder, self._more = folder, more
        self.out = folder / "runs" / "one"
        self._links = folder / "links"

    def __enter__(self) -> Self:
        before = os.nice(0)
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, _NICE)
        self._laboratory = Running(self.folder, setup(1)).__enter__()
        command = self.onboard()
        self._log = (self.folder / "onboard.log").open("wb")
        self._onboard = subprocess.Popen(command, cwd=REPOSITORY, stdout=self._log, stderr=self._log)
        os.setpriority(os.PRIO_PROCESS, 0, before)
        return self

    def __exit__(self, *error: object) -> None:
        if self._onboard.poll() is None:
            self._onboard.kill()
        self._onboard.wait()
        parts = ("base", "bridge")
        for word in ("actors.robot", *(f"firmware_bridge.onboard.{part}" for part in parts), GUARDIAN):
            killed(self.processes(word))
        self._laboratory.__exit__()
        self._log.close()

    def exit_code(self, patience_s: float) -> int:
        """Wait for the supervisor's exit and return its code."""
        return self._onboard.wait(patience_s)

    def write_fleet(self, map_file: str) -> Path:
        """Write the fleet file of this robot."""
        fleet = self.folder / "fleet.toml"
        fleet.write_text(self.fleet.format(map=map_file, links=self._links / "r1") + self._more)
        return fleet

    def onboard(self) -> list[str]:
        """Return the command that starts the robot."""
        words = ("fleet", "onboard", self.write_fleet(str(MAP)), "--robot", "r1", "--out", self.out)
        return [sys.executable, "-m", "acrc_testbed.command_line", *map(str, words)]

    def processes(self, word: str) -> list[int]:
        """Return the robot's processes with this word in their command line or title."""
        found = []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit() or int(entry.name) == os.getpid():
                continue
            try:
                words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
                words += ["actors.robot", str((entry / "fd" / "1").readlink())] if words[0] == TITLE else []
            except OSError:
                continue
            ours = any(str(self.folder) in one for one in words)
            if ours and any(one.endswith(word) for one in words):
                found.append(int(entry.name))
        return found

    def expect_ok(self, line: str) -> None:
        """Inject a fault of a device. Raises NotDrivingError if it is refused."""
        if (answer := self._laboratory.say(line)) != "ok":
            raise NotDrivingError(f"{line}: {answer}")

    def where(self) -> Where:
        """Return the ground truth."""
        return Where(*map(float, self._laboratory.say("where r1").split()))

    def until_driving(self, patience_s: float = 90.0) -> None:
        """Wait until the robot drives. Raises NotDrivingError."""
        deadline = time.monotonic() + patience_s
        while self.where().speed < self.fast:
            if time.monotonic() > deadline:
                said = (self.folder / "onboard.log").read_text()
                raise NotDrivingError(f"the robot did not drive within {patience_s:g} s: {said}")
            time.sleep(0.02)

    def standing(self, patience_s: float) -> tuple[Where | None, Where | None]:
        """Return ground truth at the stop command and at standstill; None if it did not happen."""
        deadline = time.monotonic() + patience_s
        told = None
        while time.monotonic() < deadline:
            here = self.where()
            told = told or (here if here.told else None)
            if told is not None and (here.speed == 0 or not here.told):
                return told, here if here.speed == 0 else None
            time.sleep(0.003)
        return told, None


def killed(processes: Sequence[int]) -> None:
    """Send SIGKILL."""
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def stopped(processes: Sequence[int]) -> None:
    """Send SIGSTOP."""
    for process in processes:
        os.kill(process, signal.SIGSTOP)


def held(processes: Sequence[int]) -> None:
    """Stop the main thread only, like an endless loop. Raises OSError if ptrace is not permitted."""
    libc = ctypes.CDLL(None, use_errno=True)
    for process in processes:
        for request in (_PTRACE_SEIZE, _PTRACE_INTERRUPT):
            if libc.ptrace(request, process, None, None) != 0:
                number = ctypes.get_errno()
                raise OSError(number, os.strerror(number))
