"""A task without places: robots acknowledge beacons by name."""

from collections.abc import Collection
from typing import Self

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.instant import Instant
from actors.items import TaskReports
from actors.robot.behaviour import Behaviour, Start, TaskMonitor, host
from actors.task.task import Column, Judge, JudgeSetup, Metric, Task, TaskDeclaration, TaskOutcome, Value
from actors.topic import MessagePart
from deeco import Knowledge, component, periodic, replace, role, seconds


class Acknowledgement(MessagePart, frozen=True):
    """A robot's report that it has seen a beacon."""

    name: str
    instant: int


class Beacons(Task):
    """Robots acknowledge beacons."""

    declaration = TaskDeclaration(
        name="beacons", table="beacons", item="beacon", items="beacons", done="acknowledged",
        metrics=(Metric("acknowledged", "acknowledged beacons", "beacons", "acknowledged", rank=1),),
        columns=(Column("name", "text", ""), Column("by", "text", ""), Column("at_us", "integer", "")),
    )  # fmt: skip
    item = str
    report = Acknowledgement

    def judge(self, setup: JudgeSetup) -> Judge:
        """Return the judge."""
        return BeaconJudge(setup)

    def check(self, item: str, grid: OccupancyGrid) -> str | None:
        """Return the fault of a beacon without a name."""
        return None if item else "have a name"


class BeaconJudge(Judge):
    """Judge that accepts the names that robots were given."""

    def __init__(self, setup: JudgeSetup) -> None:
        super().__init__()
        self.names = {name for items in setup.items.values() for name in items}
        self.robots = setup.robots
        self.seen: dict[str, tuple[str, int]] = {}
        self.apart_m: float | None = None

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Measure the distance of the first two robots."""
        self.apart_m = round(float(np.linalg.norm(positions[0] - positions[1])), 3)

    def take(self, robot: str, answer: TaskReports, begin: int, end: int) -> str | None:
        """Accept reports of known names."""
        for report in answer.reports:
            if report.name not in self.names:
                return f"acknowledges the unknown beacon {report.name!r}"
            self.seen.setdefault(report.name, (robot, report.instant))
        return None

    def outcome(self, present: Collection[str], end: Instant) -> TaskOutcome:
        """Return the acknowledged beacons."""
        rows: tuple[dict[str, Value], ...] = tuple(
            {"name": name, "by": by, "at_us": at} for name, (by, at) in self.seen.items()
        )
        values = {"acknowledged": len(rows), "apart_m": self.apart_m}
        return TaskOutcome("acknowledged beacons", values, {robot: {} for robot in self.robots}, rows)


@role
class BeaconRobot(Knowledge):
    """Published part of the robot: its id."""


@component
class ListeningRobot(BeaconRobot):
    """Robot that acknowledges its beacons, one a second."""

    beacons: tuple[str, ...]

    @periodic(every=seconds(1))
    def acknowledge(self, monitor: TaskMonitor, now: Instant) -> Self:
        """Acknowledge the next beacon."""
        if not self.beacons:
            return self
        monitor.report(Acknowledgement(self.beacons[0], now))
        return replace(self, beacons=self.beacons[1:])


def listen(start: Start) -> Behaviour:
    """Return a behaviour that stands and acknowledges beacons."""
    return host(start, ListeningRobot(id=start.robot, beacons=tuple(start.items)))
