"""What stands on a run's floor beside its map, step by step: walls, round things, closed doors, jammers."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.orders import CloseDoor, Obstacle, OpenDoor, Wall
from observation.replay.recorded_orders import GivenOrder

Cells = NDArray[np.bool_]
ON_FLOOR: Final = (CloseDoor, OpenDoor, Obstacle, Wall)
"""Orders that change the floor."""


class FloorThing(NamedTuple):
    """Something on the floor, or, of a jammer, above it."""

    kind: str
    """`wall`, `obstacle`, `closed door` or `jammer`: a mark of the drawing language."""
    points: tuple[tuple[float, float], ...]
    """m: the middle of what is round, both ends of what is straight."""
    radius: float = 0.0
    """m; 0 of what is straight."""
    door: int = -1
    """Which of the map's doors."""


class FloorThings:
    """Takes orders in, step by step."""

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        """`grid`: the robots' map; `radius`: of the largest robot, m."""
        self._radius = radius
        self._grid = grid
        self._things: tuple[FloorThing, ...] = ()
        self._closing: list[FloorThing] = []
        self._leaves: dict[int, Cells] = {}

    @cached_property
    def doorways(self) -> Doorways:
        """The doors of the map."""
        return Doorways(self._grid, self._radius)

    @property
    def now(self) -> tuple[FloorThing, ...]:
        """What stands there, in the order in which it came."""
        return self._things

    def changes(
        self, orders: Sequence[GivenOrder], true: NDArray[np.float64], first: int = 0
    ) -> Iterator[tuple[int, tuple[FloorThing, ...]]]:
        """Each step in which something changes, and what stands there from then on.

        `orders`: in their order, of steps before `first + len(true)`; `true`: (steps, robots, 2 or more), m,
        where robots were from the step `first` on. A door closes once no robot stands in it.
        """
        begin = first
        for step, order in orders:
            yield from self._closed(true, first, begin, max(step, begin))
            begin = max(step, begin)
            if self._take(order):
                yield begin, self._things
        yield from self._closed(true, first, begin, first + len(true))

    def leaf(self, thing: FloorThing) -> Cells:
        """(rows, columns): the cells that a closed door fills."""
        return self._leaves[thing.door]

    def _take(self, order: object) -> bool:
        """True if the floor has changed by it. Those that make no sense were refused."""
        match order:
            case Obstacle(x, y, radius):
                self._things += (FloorThing("obstacle", ((x, y),), radius),)
            case Wall(x, y, to_x, to_y):
                self._things += (FloorThing("wall", ((x, y), (to_x, to_y))),)
            case CloseDoor(x, y) | OpenDoor(x, y):
                return self._turn(order, Point(x, y))
            case _:
                return False
        return True

    def _turn(self, order: CloseDoor | OpenDoor, at: Point) -> bool:
        try:
            door = self.doorways.at(at).index
            same = [one for one in self._things if one.door == door]
            if isinstance(order, OpenDoor):
                self._closing = [one for one in self._closing if one.door != door]
                self._things = tuple(one for one in self._things if one.door != door)
                return bool(same)
            if not same and all(one.door != door for one in self._closing):
                self._closing.append(
                    FloorThing("closed door", self.doorways.leaf(self._filled(door)), 0.0, door)
                )
        except DoorError:
            pass
        return False

    def _closed(
        self, true: NDArray[np.float64], first: int, begin: int, end: int
    ) -> Iterator[tuple[int, tuple[FloorThing, ...]]]:
        """Doors that close from one step to before another one."""
        now = true[begin - first : end - first, :, :2]
        waits = [(self._wait(now, self.leaf(one)), one) for one in self._closing]
        for wait, one in sorted((two for two in waits if two[0] is not None), key=lambda two: two[0] or 0):
            self._closing.remove(one)
            self._things += (one,)
            yield begin + (wait or 0), self._things

    def _wait(self, true: NDArray[np.float64], leaf: Cells) -> int | None:
        """The first step in which no robot stands in a door; None: there is none."""
        filled = self.middles(leaf)
        for step, robots in enumerate(true):
            gaps = np.hypot(*(robots[:, None] - filled).transpose(2, 0, 1))
            if not (gaps < self._radius).any():
                return step
        return None

    def middles(self, taken: Cells) -> NDArray[np.float64]:
        """(n, 2): the middles of cells, m."""
        rows, columns = np.nonzero(taken)
        x, y = self._grid.centres()
        return np.column_stack([x[columns], y[rows]])

    def _filled(self, door: int) -> Cells:
        if door not in self._leaves:
            self._leaves[door] = self.doorways.closed(self.doorways.regions.doors[door])
        return self._leaves[door]
