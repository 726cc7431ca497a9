"""Checks of the computer itself: Python packages, clock, disk, kernels, namespaces."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from actors.installation import pins
from deploy.fleet.doctor.machine import DoctorFinding, Machine, well, wrong

_BRINGS: Final = {"base": "acrc", "hardware": "acrc fleet units"}
"""The command for which ./acrc installs what a robot needs."""


@dataclass(frozen=True)
class ComputerParameters:
    """What is enough."""

    first_year: int = 2025
    """A clock that shows an earlier one was never set. Default: the year of this software."""
    last_year: int = 2100
    free_bytes: int = 2_000_000_000
    """On the disk. Default: own choice; a robot with a lidar records up to 100 MB an hour."""


def packages(machine: Machine, constraints: str, needed: tuple[str, ...]) -> Iterator[DoctorFinding]:
    """Whether the extras in the text of constraints.txt are installed as they were tested."""
    for extra, pinned in pins.sections(constraints, machine.python[1]).items():
        if extra == "build":
            continue  # there while building only
        subject = f"packages {extra}"
        tested = {pin.name: pin.version for pin in pinned}
        found = {name: machine.version_of(name) for name in tested}
        missing = [name for name, version in found.items() if version is None]
        others = [name for name, version in found.items() if version not in {None, tested[name]}]
        if others:
            name = others[0]
            yield wrong(
                subject,
                f"{name} is {found[name]}, but was tested as {tested[name]}; remove .venv, and the next "
                "./acrc makes it anew",
            )
        elif not missing:
            said = "1 package, as it was" if len(tested) == 1 else f"{len(tested)} packages, as they were"
            yield well(subject, f"{said} tested")
        elif extra in needed:
            yield wrong(subject, f"{', '.join(missing)} missing; `./{_BRINGS[extra]}` installs what is")
        else:
            yield well(subject, "not all installed, and not needed here")


def clock(machine: Machine, parameters: ComputerParameters = ComputerParameters()) -> Iterator[DoctorFinding]:
    """Whether the clock shows the time."""
    now = machine.now()
    if not parameters.first_year <= now.year < parameters.last_year:
        yield wrong(
            "clock",
            f'it shows the year {now.year}; set it with `sudo date --set="2026-01-31 12:00"`, or connect the '
            "computer to a network with time",
        )
        return
    error = machine.clock_error()
    if error is None:
        yield wrong(
            "clock",
            f"it shows {now:%Y-%m-%d %H:%M} UTC, but nothing keeps it right; connect the computer to a "
            "network and run `sudo timedatectl set-ntp true`",
        )
    else:
        yield well("clock", f"{now:%Y-%m-%d %H:%M} UTC, synchronised, off by at most {error * 1000:.0f} ms")


def disk(machine: Machine, parameters: ComputerParameters = ComputerParameters()) -> Iterator[DoctorFinding]:
    """Whether recordings find room."""
    free, least = machine.free_bytes() / 1e9, parameters.free_bytes / 1e9
    if free < least:
        yield wrong(
            "disk",
            f"{free:.1f} GB are free at {machine.here}, but {least:.1f} should be; remove old recordings",
        )
    else:
        yield well("disk", f"{free:.1f} GB are free at {machine.here}")


def kernels(machine: Machine) -> Iterator[DoctorFinding]:
    """Whether numeric kernels are compiled before the robot's first step."""
    state = machine.kernels()
    if not state.can_be_kept:
        yield wrong(
            "kernels",
            f"compiled ones cannot be kept, as {machine.user} may not write to {state.cache}; "
            f"`sudo chown -R {machine.user} {state.cache.parent}` allows it",
        )
    elif state.compiled:
        yield well("kernels", f"{state.compiled} compiled just now, in {state.seconds:.0f} s, and kept")
    else:
        yield well("kernels", f"all compiled, loaded in {state.seconds:.1f} s")


def namespaces(machine: Machine) -> Iterator[DoctorFinding]:
    """Whether robots can be isolated."""
    fault = machine.isolation_fault()
    if fault is None:
        yield well("namespaces", "the robot's process can have a sandbox")
    else:
        yield wrong("namespaces", fault)
