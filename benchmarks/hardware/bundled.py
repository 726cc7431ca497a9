"""A robot's bundle installed on a bare Debian without a network; there the robot drives emulated devices.

The devices are outside, as in `acrc run --hardware-in-the-loop`; the robot runs as its service starts it.
"""

import os
import shutil
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from actors.installation.repository import REPOSITORY
from actors.processes.scratch import scratch_folder
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.errors import AcrcError
from benchmarks.hardware.bundled_rig import KEPT, BundledRig
from benchmarks.hardware.standstill_rig import MAP, Rig
from benchmarks.processors import debian
from benchmarks.processors.building import NotBuiltError, do, once, provide
from benchmarks.statistics.measured import Measured, table_of
from deploy.fleet.bundle import making
from deploy.fleet.bundle.wheels import MACHINES
from deploy.fleet.fleet_file import load_fleet
from observation.recordings.info import info
from observation.replay import record_replay

_STEPS: Final = 20
"""So many a robot must have answered to have been there; 2 s where nothing is late."""
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
    (out,) = (system / KEPT / "runs").glob("*-*/")
    (robot,) = (one for one in info(out) if one.actor == "r1")
    steps = max(
        (rate.count for (way, key), rate in robot.topics.items() if key.endswith("/drive")), default=0
    )
    row = replace(row, steps=steps)
    if MACHINES[row.computer.split()[2]] not in robot.processor:
        return replace(row, fault=f"the robot ran on {robot.processor}")
    row = replace(row, replayed=record_replay.replay_actor(out, "r1").outputs)
    return row if steps >= _STEPS else replace(row, fault=f"only {steps} steps; must be {_STEPS} or more")
