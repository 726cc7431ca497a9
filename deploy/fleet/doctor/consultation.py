"""All checks one after the other, and what they have found: for people line by line, for programs as JSON."""

import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
from rich.text import Text

from actors.console import screen
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from actors.robot.behaviour.foreign import INSTALLED, Permit
from deploy.fleet.doctor import checks
from deploy.fleet.doctor.machine import DoctorFinding, Machine
from deploy.fleet.fleet_file import Fleet, FleetRobot, load_fleet


class Report(msgspec.Struct, frozen=True):
    """Everything that was found."""

    robot: str | None
    ok: bool
    findings: tuple[DoctorFinding, ...]


def consult(
    path: Path | None,
    name: str | None,
    permit: Permit = INSTALLED,
    *,
    json: bool,
    machine: Machine | None = None,
) -> bool:
    """Check this computer, or as the robot `name` of the fleet in the file, and print; True if all is well.

    Raises OptionError if only one of both is given, and AcrcError for a file that cannot be used.
    """
    if path is None and name is not None:
        raise OptionError(
            f"--robot: {name} without a fleet file; must be as in acrc fleet doctor fleet.toml --robot {name}"
        )
    fleet = None if path is None else load_fleet(path)
    if fleet is not None and name is None:
        known = ", ".join(robot.id for robot in fleet.robots)
        raise OptionError(f"--robot: is missing; must say which of the robots this computer is: {known}")
    robot = fleet.robot(name) if fleet is not None and name is not None else None
    found: list[DoctorFinding] = []
    for finding in findings(machine or Machine(), fleet, robot, permit):
        found.append(finding)
        if not json:
            _print(finding)
    report = Report(name, all(finding.ok for finding in found), tuple(found))
    if json:
        sys.stdout.write(msgspec.json.encode(report).decode() + "\n")
    else:
        bad = sum(not finding.ok for finding in found)
        count = f"{bad} of {len(found)} {'is' if bad == 1 else 'are'} wrong"
        screen().print(count if bad else f"all {len(found)} are well")
    return report.ok


def findings(
    machine: Machine, fleet: Fleet | None, robot: FleetRobot | None, permit: Permit = INSTALLED
) -> Iterator[DoctorFinding]:
    """What all checks find, the quick ones first."""
    constraints = (SHIPPED / "constraints.txt").read_text("utf-8")
    needed = ("base",) if robot is None else ("base", "hardware")
    yield from checks.packages(machine, constraints, needed)
    yield from checks.clock(machine)
    yield from checks.disk(machine)
    yield from checks.namespaces(machine)
    yield from checks.kernels(machine)
    if fleet is None or robot is None:
        return
    yield from checks.group(machine)
    yield from checks.ports(machine, robot)
    yield from checks.camera(machine, robot)
    yield from checks.floor(fleet, robot)
    yield from checks.behaviour(fleet, robot, permit)
    yield from checks.keys(machine, fleet, robot)


def _print(finding: DoctorFinding) -> None:
    line = Text("ok     " if finding.ok else "wrong  ", style="green" if finding.ok else "bold red")
    line.append(f"{finding.subject:<20} ", style="bold").append(finding.text, style="default")
    screen().print(line)
