"""A robot's bundle installed on a bare Debian without a network; there the robot drives emulated devices.

The devices are outside, as in `acrc run --hardware-in-the-loop`; the robot runs as its service starts it.
"""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.processes.scratch import scratch_folder
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.errors import AcrcError
from benchmarks.hardware.standstill_rig import MAP, NotDrivingError, Rig
from benchmarks.processors import debian
from benchmarks.processors.building import NotBuiltError, do, once, provide
from benchmarks.statistics.measured import Measured, table_of
from deploy.fleet.bundle import making
from deploy.fleet.bundle.wheels import MACHINES
from deploy.fleet.fleet_file import load_fleet
from observation.recordings.info import info
from observation.replay import record_replay

_KEPT: Final = "var/lib/acrc"
_STEPS: Final = 20
"""So many a robot must have answered to have been there; 2 s where nothing is late."""
_PATIENCE_S: Final = {False: 60.0, True: 900.0}
"""Until the robot drives; True: in the emulator."""
_GRACE_S: Final = 20.0
_PYTHON: Final = "3.11"
"""Of Debian 12."""


@dataclass(frozen=True)
class BundleRow:
    """What came of a bundle on one computer."""

    computer: str
    bundle_mb: float = 0.0
    installed_s: float = 0.0
    """Kernels compiled, doctor asked."""
    installed_mb: float = 0.0
    steps: int = 0
    """That the robot's program answered."""
    way_m: float = 0.0
    """That the emulated body went."""
    sandboxed: bool = False
    """The robot's process is; qemu has no sandbox."""
    replayed: int = 0
    """Messages, all equal, that the robot's program sends again on this computer from its recording."""
    fault: str = ""
    missing: str = ""
    """Why there is no such computer here."""


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
        words = ("setpriv", "--reuid", user, "--regid", user, "--init-groups", "env", f"-C/{_KEPT}")
        start = said["ExecStart"].split()
        return [*debian.inside(self._system, self.folder, self._machine, (*words, *start))]

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
        """Wait until the robot has moved, and so long; its way, m. Raises NotDrivingError."""
        ended = time.monotonic() + _PATIENCE_S[debian.is_emulated(self._machine)]
        while not self.where().way:
            if self._onboard.poll() is not None or time.monotonic() > ended:
                raise NotDrivingError(f"the robot did not drive: {self.said()[-300:]}")
            time.sleep(0.1)
        time.sleep(seconds)
        return self.where().way


def check(
    duration: float = 20.0,
    only: Sequence[str] = (),
    install: bool = False,
    folder: Path = REPOSITORY / ".processors",
) -> Measured:
    """Make, install and drive it on each computer; it holds where the robot drives, and replays here.

    `duration`: s of driving. `only`: parts of the names of the computers that are wanted; none: all.
    `install`: let apt-get install what is needed. `folder`: for what is built.
    """
    rows = list(_rows(duration, only, install, folder))
    tried = [row for row in rows if not row.missing]
    shown = [table_of([asdict(row) for row in rows], "robots installed from a bundle, without a network")]
    holds = all(not row.fault for row in tried) if tried else None
    return Measured([asdict(row) for row in rows], shown, holds)


def _rows(duration: float, only: Sequence[str], install: bool, folder: Path) -> Iterator[BundleRow]:
    for machine in MACHINES:
        emulated = debian.is_emulated(machine)
        row = BundleRow(f"Debian 12, {machine}{' in qemu' if emulated else ''}")
        if only and not any(word in row.computer for word in only):
            continue
        try:
            if os.geteuid():
                raise NotBuiltError("entering a system of its own requires root")
            provide(_programs(emulated), install=install)
            place = folder / f"debian-{machine}"
            once(place, partial(debian.system, machine=machine))
        except NotBuiltError as error:
            yield replace(row, missing=str(error))
            continue
        with scratch_folder() as scratch:
            yield _row(row, place, machine, duration, scratch)


def _programs(emulated: bool) -> Mapping[str, str]:
    """What is needed, and the Debian packages that bring it."""
    return {"debootstrap": "debootstrap", **({debian.EMULATOR: "qemu-user-static"} if emulated else {})}


def _row(row: BundleRow, place: Path, machine: str, duration: float, scratch: Path) -> BundleRow:
    shared, system = scratch / "shared", scratch / "system"
    shared.mkdir()
    scratch.chmod(0o755)
    try:
        debian.copied(place, system)
        rig = BundledRig(shared, system, machine)
        row = replace(row, bundle_mb=_bundle(rig, machine))
        begun = time.monotonic()
        do(*debian.inside(system, shared, machine, (f"{shared}/acrc-r1/install.sh",)))
        row = replace(row, installed_s=round(time.monotonic() - begun, 1), installed_mb=_megabytes(system))
        with rig:
            way = rig.drive(duration)
        row = replace(row, way_m=round(way, 2), sandboxed="plain processes" not in rig.said())
        return _recorded(row, system)
    except (NotBuiltError, AcrcError) as error:
        return replace(row, fault=str(error))


def _bundle(rig: Rig, machine: str) -> float:
    """Make and unpack it; its size, MB."""
    for file in (MAP, MAP.with_suffix(".png")):
        shutil.copy(file, rig.folder)
    fleet, out = load_fleet(rig.write_fleet(MAP.name)), rig.folder / "r1.tar"
    made = making.make(REPOSITORY, fleet, "r1", INSTALLED, machine=machine, python=_PYTHON, out=out)
    do("tar", "-xf", str(out), "-C", str(rig.folder))
    return round(made.bytes / 1e6, 1)


def _megabytes(system: Path) -> float:
    return float(do("du", "-sm", str(system / "srv/acrc")).split()[0])


def _recorded(row: BundleRow, system: Path) -> BundleRow:
    """What the robot recorded, held against its program here."""
    (out,) = (system / _KEPT / "runs").glob("*-*/")
    (robot,) = (one for one in info(out) if one.actor == "r1")
    steps = max(
        (rate.count for (way, key), rate in robot.topics.items() if key.endswith("/drive")), default=0
    )
    row = replace(row, steps=steps)
    if MACHINES[row.computer.split()[2]] not in robot.processor:
        return replace(row, fault=f"the robot ran on {robot.processor}")
    row = replace(row, replayed=record_replay.replay_actor(out, "r1").outputs)
    return row if steps >= _STEPS else replace(row, fault=f"only {steps} steps; must be {_STEPS} or more")
