"""Random stories of cleaning robots: messages that come late, again, in any order or never."""

from collections.abc import Callable, Iterable
from typing import Any, Generic, NamedTuple, Self, TypeVar

from actors.instant import Instant, seconds
from actors.task.task import PlaceKey
from cleaning.robot import CleaningRobot
from tests.cleaning.equipment import NOW, Notes

Robot = TypeVar("Robot", bound=CleaningRobot)


class Act(NamedTuple):
    """What happens next, to which robot, with which number to choose from what there is."""

    what: str
    robot: int
    number: int


class Story(Generic[Robot]):
    """Robots, everything that they ever published, and the places; an act `x` is done by a method `_x`."""

    def __init__(self, robots: list[Robot]) -> None:
        self.notes = Notes()
        self.robots = robots
        self.places = [assignment.key for robot in robots for assignment in robot.route]
        self.published: list[Any] = []
        self.now = NOW

    def act(self, act: Act) -> None:
        index = act.robot % len(self.robots)
        one: Callable[[Robot, int], Robot] = getattr(self, f"_{act.what}")
        self.robots[index] = one(self.robots[index], act.number)
        self.now = Instant(self.now + seconds(1))

    def play(self, acts: Iterable[Act]) -> Self:
        """Do them one after the other; no place may be lost after any."""
        for act in acts:
            self.act(act)
            self.check()
        return self

    def message(self, robot: Robot, number: int) -> Any:
        """Return any message that another robot ever sent, the newest first; None if there is none."""
        others = [role for role in reversed(self.published) if role.id != robot.id]
        return others[number % len(others)] if others else None

    def open_places(self) -> list[PlaceKey]:
        """Return the places that no robot has visited or given up."""
        over = {*self.notes.visits, *(key for key, _ in self.notes.gone)}
        return [key for key in self.places if key not in over]

    def held(self) -> list[PlaceKey]:
        return [assignment.key for robot in self.robots for assignment in robot.route]

    def check(self) -> None:
        assert {*self.open_places()} <= {*self.held()}, "no place is lost"
        for robot in self.robots:
            assert len({assignment.key for assignment in robot.route}) == len(robot.route), "no place twice"
            assert robot.destination is None or robot.destination in robot.route

    def check_held_once(self) -> None:
        held = self.held()
        assert all(held.count(key) == 1 for key in self.open_places())
