"""What the page shows, kept up with the run's messages."""

import math
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from typing import Final

from acrc_testbed.accounting.episodes import STANDARD
from actors.floor.doors import DoorError
from actors.geometry import Point
from actors.instant import in_seconds
from actors.messages import Answered, Control, Drive, Jam, Progress, Received, RobotTruth, Truth
from actors.orders import (
    CloseDoor,
    Freeze,
    Give,
    Kill,
    Move,
    Obstacle,
    OpenDoor,
    Order,
    Restart,
    Speed,
    Thaw,
    Wall,
)
from actors.task.task import PlaceKey
from actors.topic import Message
from actors.world.world_setup import WorldSetup
from deploy.control.onlooking import Links, SeenRobot
from deploy.control.page_floor import PageFloor
from deploy.control.wire import Circle, Line, MapRobot, MapState, Past, Place

_PENDING: Final = 256
"""Orders of which nobody has said yet what became of them; older ones are forgotten."""


class Scene:
    """The world as far as its messages tell. What has changed what is not in them, orders do."""

    def __init__(
        self, setup: WorldSetup, plan: PageFloor, speed: float, addresses: Mapping[int, str]
    ) -> None:
        """`speed`: simulated seconds per second with which the run begins, at most; 0: no limit.

        `addresses`: robots by their short addresses.
        """
        self._plan = plan
        self.changed = True
        self.over = False
        numbers = ((robot.id, index) for robot in setup.robots for index in range(len(robot.places)))
        self._numbers = {key: number for number, key in enumerate(numbers)}
        self._events = list(setup.events)
        self._pending: OrderedDict[str, tuple[Order, ...]] = OrderedDict()
        self._robots = {
            robot.id: SeenRobot(
                robot.id, robot.start, tuple(PlaceKey(robot.id, index) for index in range(len(robot.places)))
            )
            for robot in setup.robots
        }
        self._links = Links({robot: number for number, robot in enumerate(self._robots)}, dict(addresses))
        self._instant = 0
        self._step = -1
        self._done: set[int] = set()
        self._given_up: set[int] = set()
        self._obstacles: list[Circle] = []
        self._walls: list[Line] = []
        self._given: list[Place] = []
        self._closed: set[int] = set()
        self._jams: list[Jam] = []
        self._paused_at: int | None = None
        """The step that it has last been seen to wait before."""
        self._missed = 0
        self._speed = speed
        self.floor = plan.told

    def take(self, message: Message, robot: str = "") -> None:
        """Take in one message of the run; `robot`: whose key it came on."""
        match message:
            case Truth():
                self._truth(message)
            case Drive():
                self._done |= self._indices(PlaceKey(one.owner, one.place) for one in message.reports)
                self._given_up |= self._indices(PlaceKey(one.owner, one.place) for one in message.given_up)
                if message.route is not None and robot in self._robots:
                    self._robots[robot].route = message.route
            case Received():
                self._links.take(robot, message)
            case Progress():
                self._paused_at = message.step if message.paused else None
                self.over = self.over or message.finished
            case Control():
                self._pending[message.ticket] = message.orders
                while len(self._pending) > _PENDING:
                    self._pending.popitem(last=False)
            case Answered():
                orders = self._pending.pop(message.ticket, ())
                if not message.refusals:
                    self._carried_out(orders)
        self.changed = True

    def past(self) -> Past:
        """What a page would know had it been open all the time."""
        return Past({robot.id: tuple(robot.trail) for robot in self._robots.values()})

    def state(self, *, junk: int) -> MapState:
        """How things stand now."""
        now = in_seconds(self._instant)
        self._jams = [jam for jam in self._jams if jam.until > self._instant]
        return MapState(
            t=now,
            step=max(self._step, 0),
            robots=tuple(self._shown(robot, now) for robot in self._robots.values()),
            links=self._links.lately(self._instant),
            done=tuple(sorted(self._done)),
            given_up=tuple(sorted(self._given_up - self._done)),
            given=tuple(self._given),
            obstacles=tuple(self._obstacles),
            jammers=tuple(
                (jam.x, jam.y, jam.radius, in_seconds(jam.until - self._instant)) for jam in self._jams
            ),
            walls=tuple(self._walls),
            closed=tuple(sorted(self._closed)),
            paused=self._paused_at is not None and self._step < self._paused_at,
            speed=self._speed,
            over=self.over,
            missed=self._missed,
            junk=junk,
        )

    def _shown(self, robot: SeenRobot, now: float) -> MapRobot:
        near = ""
        if robot.stays(now):
            others = [
                (math.dist((robot.x, robot.y), (other.x, other.y)), other.id)
                for other in self._robots.values()
                if other is not robot
            ]
            distance, nearest = min(others, default=(math.inf, ""))
            near = nearest if distance <= STANDARD.near else ""
        number = self._numbers.get((robot.route[0].owner, robot.route[0].place)) if robot.route else None
        return robot.shown(now, None if number is None else self._place(number), near)

    def _place(self, number: int) -> tuple[float, float]:
        first = self.floor.places
        place = first[number] if number < len(first) else self._given[number - len(first)]
        return place.x, place.y

    def _truth(self, truth: Truth) -> None:
        self.over = self.over or truth.halt
        if not truth.robots:
            return
        if self._step >= 0:
            self._missed += max(0, truth.step - self._step - 1)
        self._step, self._instant = truth.step, truth.instant
        self._jams += truth.jams
        now = in_seconds(truth.instant)
        for one in truth.robots:
            self._robots[one.id].see(now, one.x, one.y, one.heading, _standing(one))
        while self._events and self._events[0].instant <= truth.instant:
            event = self._events.pop(0).order
            if not isinstance(event, Move | Kill | Freeze | Thaw | Restart):
                self._carried_out((event,))

    def _carried_out(self, orders: Iterable[Order]) -> None:
        """Orders to robots, too: while the run is paused, nobody else would tell."""
        for order in orders:
            match order:
                case Move(robot, x, y, heading):
                    self._robots[robot].put(x, y, heading)
                case Kill(robot):
                    self._robots[robot].standing = "off"
                case Freeze(robot):
                    self._robots[robot].standing = "frozen"
                case Thaw(robot) | Restart(robot):
                    self._robots[robot].standing = "driving"
                case Give(robot, places):
                    self._give(robot, places)
                case Speed(factor):
                    self._speed = factor
                case _:
                    self._put(order)

    def _put(self, order: Order) -> None:
        match order:
            case Obstacle(x, y, radius):
                self._obstacles.append((x, y, radius))
            case Wall(x, y, to_x, to_y):
                self._walls.append((x, y, to_x, to_y))
            case CloseDoor(x, y):
                self._closed |= self._doors_at(x, y)
            case OpenDoor(x, y):
                self._closed -= self._doors_at(x, y)

    def _doors_at(self, x: float, y: float) -> set[int]:
        try:
            index = self._plan.doorways.at(Point(x, y)).index
        except DoorError:  # so the world's floor has other doors than its map
            return set()
        return {self._plan.numbers[index]} if index in self._plan.numbers else set()

    def _give(self, robot: str, places: Iterable[tuple[float, float]]) -> None:
        for x, y in places:
            index = sum(owner == robot for owner, _ in self._numbers)
            self._numbers[robot, index] = len(self._numbers)
            self._given.append(Place(robot, x, y))

    def _indices(self, keys: Iterable[PlaceKey]) -> set[int]:
        return {
            self._numbers[key.owner, key.place] for key in keys if (key.owner, key.place) in self._numbers
        }


def _standing(robot: RobotTruth) -> str:
    return "driving" if robot.stepping else "frozen" if robot.powered else "off"
