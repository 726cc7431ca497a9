"""Judges, from ground truth, which places were really visited, and keeps who claimed what and when."""

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.messages import PlaceReport
from actors.world.setup import RobotSetup
from actors.world.visits import visitors


class PlaceOutcome(msgspec.Struct, frozen=True):
    """What became of one place; instants in µs, None = never."""

    owner: str
    place: int
    x: float
    y: float
    reached_at: int | None
    """When ground truth first came within reach."""
    reached_by: str | None
    reported_at: int | None
    """When a robot first reported it."""
    reported_by: str | None

    @property
    def done(self) -> bool:
        """Reported, and true: some robot had been there by then."""
        return (
            self.reported_at is not None
            and self.reached_at is not None
            and self.reached_at <= self.reported_at
        )


class Referee:
    """Watches every step's true positions and every report."""

    def __init__(self, robots: tuple[RobotSetup, ...], reach: float) -> None:
        self._ids = tuple(robot.id for robot in robots)
        self._owners = [(robot.id, index) for robot in robots for index in range(len(robot.places))]
        self._numbers = {owner: number for number, owner in enumerate(self._owners)}
        flat = [place for robot in robots for place in robot.places]
        self._places: NDArray[np.float64] = np.array(flat, dtype=np.float64).reshape(-1, 2)
        self._reach = reach
        self._open = np.arange(len(flat))
        self._reached: dict[int, tuple[int, str]] = {}
        self._reported: dict[int, tuple[int, str]] = {}

    @property
    def reports(self) -> int:
        """How many different places have been reported."""
        return len(self._reported)

    def watch(self, instant: Instant, positions: NDArray[np.float64]) -> None:
        """Take in the robots' true positions, (n, 2) m, in the order of the set-up."""
        if not self._open.size:
            return
        found = visitors(self._places, self._open, positions, self._reach)
        if len(found):
            for number, robot in found.tolist():
                self._reached[number] = (instant, self._ids[robot])
            self._open = np.setdiff1d(self._open, found[:, 0], assume_unique=True)

    def report(self, robot: str, report: PlaceReport) -> bool:
        """Take in a robot's report; False if there is no such place. The first report of a place counts."""
        number = self._numbers.get((report.owner, report.place))
        if number is None:
            return False
        self._reported.setdefault(number, (report.instant, robot))
        return True

    def outcomes(self) -> tuple[PlaceOutcome, ...]:
        """What became of every place, in the order of the robots and of their lists."""
        return tuple(self._outcome(number) for number in range(len(self._owners)))

    def _outcome(self, number: int) -> PlaceOutcome:
        owner, place = self._owners[number]
        x, y = (float(value) for value in self._places[number])
        reached_at, reached_by = self._reached.get(number, (None, None))
        reported_at, reported_by = self._reported.get(number, (None, None))
        return PlaceOutcome(owner, place, x, y, reached_at, reached_by, reported_at, reported_by)
