"""Assignments of places to robots, and the places of the original testbed."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.items import ItemKey
from actors.robot.behaviour import Start, TaskList
from actors.runtime.errors import AcrcError
from actors.settings import Place
from actors.topic import MessagePart
from deeco.schema import Resolution

_FILE: Final = Path(__file__).with_name("golden.toml")
GOLDEN: Final = tuple(
    tuple(Point(*place) for place in places) for places in tomllib.loads(_FILE.read_text("utf-8"))["places"]
)
"""Ten places for each of the original testbed's four robots, m, to the millimetre, from its generator with
its seed, java.util.Random(42). Some are nearer to a wall than a robot's radius; a robot reaches them from
within 0.5 m."""


RESTART_TERM: Final = 2**20
"""Term added to a robot's own assignments at a restart; see `assignments`. Must exceed the number of
adoptions of a place between two restarts: with an adoption every 3 s (the ensemble's period), this value
lasts 36 days. It costs 4 bytes per place on the air, only after a restart."""
LAST_TERM: Final = 2**63 - 1
"""Highest term; correct robots never reach it, and the wire format ends just above it."""


@dataclass(frozen=True)
class Takeover:
    """The adoption of a place, published to its previous holders."""

    owner: str
    """The robot to which the place was assigned."""
    index: int
    """Index in the owner's list."""
    term: int
    """Number of adoptions of the place known to the new holder, including this one."""

    @property
    def key(self) -> ItemKey:
        """Key of the place."""
        return ItemKey(self.owner, self.index)


@dataclass(frozen=True)
class Assignment:
    """A place to clean."""

    owner: str
    """The robot to which the place was assigned."""
    index: int
    """Index in the owner's list."""
    point: Annotated[Point, Resolution(1000)]
    """Position, m, map frame; rounded to the millimetre when adopted."""
    term: int = 0
    """Number of adoptions known to the holder."""

    @property
    def key(self) -> ItemKey:
        """Key of the place."""
        return ItemKey(self.owner, self.index)

    @property
    def takeover(self) -> Takeover:
        """The assignment without its position."""
        return Takeover(self.owner, self.index, self.term)


class VisitReport(MessagePart, frozen=True):
    """A robot's report that it visited a place."""

    owner: str
    number: int
    """As in ItemKey."""
    instant: int

    @property
    def key(self) -> ItemKey:
        """Key of the place."""
        return ItemKey(self.owner, self.number)


def visit_report(key: ItemKey, now: Instant) -> VisitReport:
    """Return the report that a place was visited."""
    return VisitReport(key.owner, key.number, now)


def points(items: Sequence[Any]) -> tuple[Point, ...]:
    """Return the places given to a robot, m, map frame. Raises AcrcError for items of another task."""
    try:
        return tuple(Point(x, y) for x, y in msgspec.convert(list(items), tuple[Place, ...]))
    except msgspec.ValidationError as error:
        raise AcrcError(f"the robot has items of another task than cleaning: {error}") from None


def assignments(start: Start) -> tuple[Assignment, ...]:
    """Return a robot's own places, in order.

    A restarted robot claims all of them again, with a term above all earlier ones: other robots have returned
    places to it, and must not remove them with old messages.
    """
    term = start.epoch * RESTART_TERM
    return tuple(
        Assignment(start.robot, index, point, term) for index, point in enumerate(points(start.items))
    )


def assignments_since(tasks: TaskList, robot: str, known: int) -> tuple[Assignment, ...]:
    """Return the assignments that were added after the first `known` places, in order."""
    if known == len(tasks.items):  # usual case
        return ()
    term = tasks.epoch * RESTART_TERM
    new = points(tasks.items[known:])
    return tuple(Assignment(robot, index, point, term) for index, point in enumerate(new, start=known))
