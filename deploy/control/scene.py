"""What the page shows, kept up with the run's messages."""

import base64
import io
import math
from collections import OrderedDict
from collections.abc import Iterable
from typing import Final

import numpy as np
from PIL import Image

from actors.floor.grid import FREE, UNKNOWN, OccupancyGrid
from actors.instant import in_seconds
from actors.messages import Answered, Control, Drive, Jam, Progress, RobotTruth, Truth
from actors.orders import CloseDoor, Give, Move, Obstacle, OpenDoor, Order, Speed, Wall
from actors.robot_model import load_model
from actors.topic import Message
from actors.world.world_setup import WorldSetup
from deploy.control.wire import Circle, Floor, Line, MapRobot, MapState, Place, Spot

_PENDING: Final = 256
"""Orders of which nobody has said yet what became of them; older ones are forgotten."""


class Scene:
    """The world as far as its messages tell. What has changed what is not in them, orders do."""

    def __init__(self, setup: WorldSetup, grid: OccupancyGrid, speed: float) -> None:
        """`speed`: simulated seconds per second with which the run begins, at most; 0: no limit."""
        self.floor = _floor(setup, grid)
        self.changed = True
        self.over = False
        numbers = ((robot.id, index) for robot in setup.robots for index in range(len(robot.places)))
        self._numbers = {key: number for number, key in enumerate(numbers)}
        self._events = list(setup.events)
        self._pending: OrderedDict[str, tuple[Order, ...]] = OrderedDict()
        self._bodies = {robot.id: MapRobot(robot.id, *robot.start, "driving") for robot in setup.robots}
        self._instant = 0
        self._step = -1
        self._done: set[int] = set()
        self._given_up: set[int] = set()
        self._obstacles: list[Circle] = []
        self._walls: list[Line] = []
        self._given: list[Place] = []
        self._closed: list[Spot] = []
        self._jams: list[Jam] = []
        self._paused_at: int | None = None
        """The step that it has last been seen to wait before."""
        self._missed = 0
        self._speed = speed

    def take(self, message: Message) -> None:
        """Take in one message of the run."""
        match message:
            case Truth():
                self._truth(message)
            case Drive():
                self._done |= self._indices((one.owner, one.place) for one in message.reports)
                self._given_up |= self._indices((one.owner, one.place) for one in message.given_up)
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

    def state(self, *, junk: int) -> MapState:
        """How things stand now."""
        self._jams = [jam for jam in self._jams if jam.until > self._instant]
        return MapState(
            t=in_seconds(self._instant),
            step=max(self._step, 0),
            robots=tuple(self._bodies.values()),
            done=tuple(sorted(self._done)),
            given_up=tuple(sorted(self._given_up - self._done)),
            given=tuple(self._given),
            obstacles=tuple(self._obstacles),
            jammers=tuple((jam.x, jam.y, jam.radius) for jam in self._jams),
            walls=tuple(self._walls),
            closed=tuple(self._closed),
            paused=self._paused_at is not None and self._step < self._paused_at,
            speed=self._speed,
            over=self.over,
            missed=self._missed,
            junk=junk,
        )

    def _truth(self, truth: Truth) -> None:
        self.over = self.over or truth.halt
        if not truth.robots:
            return
        if self._step >= 0:
            self._missed += max(0, truth.step - self._step - 1)
        self._step, self._instant = truth.step, truth.instant
        self._jams += truth.jams
        self._bodies = {
            one.id: MapRobot(one.id, one.x, one.y, one.heading, _standing(one)) for one in truth.robots
        }
        while self._events and self._events[0].instant <= truth.instant:
            event = self._events.pop(0).order
            if not isinstance(event, Move):
                self._carried_out((event,))

    def _carried_out(self, orders: Iterable[Order]) -> None:
        for order in orders:
            match order:
                case Obstacle(x, y, radius):
                    self._obstacles.append((x, y, radius))
                case Wall(x, y, to_x, to_y):
                    self._walls.append((x, y, to_x, to_y))
                case Give(robot, places):
                    self._give(robot, places)
                case CloseDoor(x, y):
                    self._closed.append((x, y))
                case OpenDoor(x, y) if self._closed:
                    self._closed.remove(min(self._closed, key=lambda one: math.dist(one, (x, y))))
                case Speed(factor):
                    self._speed = factor
                case Move(robot, x, y, heading):  # while the run is paused, nobody else would tell
                    self._bodies[robot] = MapRobot(robot, x, y, heading, self._bodies[robot].standing)

    def _give(self, robot: str, places: Iterable[tuple[float, float]]) -> None:
        for x, y in places:
            index = sum(owner == robot for owner, _ in self._numbers)
            self._numbers[robot, index] = len(self._numbers)
            self._given.append(Place(robot, x, y))

    def _indices(self, keys: Iterable[tuple[str, int]]) -> set[int]:
        return {self._numbers[key] for key in keys if key in self._numbers}


def _standing(robot: RobotTruth) -> str:
    return "driving" if robot.stepping else "frozen" if robot.powered else "ended"


def _floor(setup: WorldSetup, grid: OccupancyGrid) -> Floor:
    cells = grid.cells[::-1]
    alpha = np.where(cells == FREE, 0, np.where(cells == UNKNOWN, 40, 255)).astype(np.uint8)
    file = io.BytesIO()
    Image.merge(
        "LA", (Image.new("L", (grid.cells.shape[1], grid.cells.shape[0])), Image.fromarray(alpha))
    ).save(file, "PNG")
    return Floor(
        png=base64.b64encode(file.getvalue()).decode(),
        west=grid.origin.x,
        south=grid.origin.y,
        width=grid.cells.shape[1] * grid.resolution,
        height=grid.cells.shape[0] * grid.resolution,
        radii={
            robot.id: load_model(robot.model, robot.sensor).footprint.circumradius for robot in setup.robots
        },
        places=tuple(Place(robot.id, *place) for robot in setup.robots for place in robot.places),
    )
