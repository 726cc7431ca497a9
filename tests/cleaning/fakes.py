"""Cleaning robots for tests, and scripted swarms with delayed, repeated and lost messages."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic, NamedTuple, Self, TypeVar

from acrc_testbed.testing import floor
from actors.geometry import Point, Pose
from actors.instant import Instant, seconds
from actors.items import ItemKey
from actors.topic import MessagePart
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.place import Assignment, VisitReport
from cleaning.robot import CleaningRobot
from deeco import Knowledge
from deeco.knowledge import role_view

Role = TypeVar("Role", bound=Knowledge)
NOW = Instant(seconds(100))
HERE = Pose(0.0, 0.0, 0.0)


@dataclass
class FakeTaskMonitor:
    """A task monitor that records reports."""

    visits: list[ItemKey] = field(default_factory=list)
    gone: list[tuple[ItemKey, str]] = field(default_factory=list)
    left: tuple[ItemKey, ...] | None = None

    def report(self, report: MessagePart) -> None:
        assert isinstance(report, VisitReport)
        self.visits.append(ItemKey(report.owner, report.number))

    def given_up(self, place: ItemKey, reason: str, now: Instant) -> None:
        assert 0 < len(reason) <= 100
        self.gone.append((place, reason))

    def remaining(self, route: Sequence[ItemKey]) -> None:
        self.left = tuple(route)


OPEN = floor("\n".join(["." * 24] * 11 + ["a" + "." * 23]), 2.0, origin=(-12.0, -12.0))
"""A floor without walls."""
DOORWAY = floor(
    """
    ...........#...........
    ...........#...........
    a......................
    ...........#...........
    ...........#...........
    """,
    origin=(-11.5, -2.5),
)
"""A door from x = -0.5 to 0.5 m, y = 0; region 1 is west and region 2 east of it."""


def published(robot: CleaningRobot, role: type[Role]) -> Role:
    """Return the published knowledge of a robot."""
    made = role_view(robot, role)
    assert isinstance(made, role)
    return made


def assignment(x: float, index: int = 0, owner: str = "r1", term: int = 0) -> Assignment:
    return Assignment(owner, index, Point(x, 0.0), term)


def route(*xs: float, owner: str = "r1") -> tuple[Assignment, ...]:
    return tuple(assignment(x, index, owner) for index, x in enumerate(xs))


def plain(*xs: float) -> CleaningRobot:
    return CleaningRobot(id="r1", position=Point(0.0, 0.0), route=route(*xs))


def adaptive(robot: str, at: float, *xs: float) -> AdaptiveCleaningRobot:
    """Return a robot at x = `at`, m, on its way to the first of its places at `xs`."""
    mine = route(*xs, owner=robot)
    return AdaptiveCleaningRobot(
        id=robot, position=Point(at, 0.0), route=mine, destination=mine[0] if mine else None
    )


Robot = TypeVar("Robot", bound=CleaningRobot)


class Action(NamedTuple):
    """An action of a robot, with a number that selects its object."""

    what: str
    robot: int
    number: int


class ScriptedSwarm(Generic[Robot]):
    """Robots, their published messages, and their places; an action `x` calls the method `_x`."""

    def __init__(self, robots: list[Robot]) -> None:
        self.monitor = FakeTaskMonitor()
        self.robots = robots
        self.places = [assignment.key for robot in robots for assignment in robot.route]
        self.published: list[Any] = []
        self.now = NOW

    def act(self, act: Action) -> None:
        index = act.robot % len(self.robots)
        one: Callable[[Robot, int], Robot] = getattr(self, f"_{act.what}")
        self.robots[index] = one(self.robots[index], act.number)
        self.now = Instant(self.now + seconds(1))

    def play(self, acts: Iterable[Action]) -> Self:
        """Execute actions and check after each that no place is lost."""
        for act in acts:
            self.act(act)
            self.check()
        return self

    def message(self, robot: Robot, number: int) -> Any:
        """Return an earlier message of another robot, newest first; None if there is none."""
        others = [role for role in reversed(self.published) if role.id != robot.id]
        return others[number % len(others)] if others else None

    def open_places(self) -> list[ItemKey]:
        """Return the places that no robot has visited or given up."""
        over = {*self.monitor.visits, *(key for key, _ in self.monitor.gone)}
        return [key for key in self.places if key not in over]

    def held(self) -> list[ItemKey]:
        return [assignment.key for robot in self.robots for assignment in robot.route]

    def check(self) -> None:
        assert {*self.open_places()} <= {*self.held()}, "no place is lost"
        for robot in self.robots:
            assert len({assignment.key for assignment in robot.route}) == len(robot.route), "no place twice"
            assert robot.destination is None or robot.destination in robot.route

    def check_held_once(self) -> None:
        held = self.held()
        assert all(held.count(key) == 1 for key in self.open_places())
