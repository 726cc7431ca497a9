"""The floor of a run over time: obstacles, walls, closed doors and jammers."""

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.replay.run_recordings import GivenOrder
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.instant import in_seconds
from actors.messages import Jam
from actors.orders import CloseDoor, Obstacle, OpenDoor, Wall

Cells = NDArray[np.bool_]
FLOOR_ORDERS: Final = (CloseDoor, OpenDoor, Obstacle, Wall)
"""Orders that change the floor."""


class FloorObject(NamedTuple):
    """An object on the floor that is not on the map, or a jammer above it."""

    kind: str
    """`wall`, `obstacle`, `closed door` or `jammer`: a mark of the drawing language."""
    points: tuple[tuple[float, float], ...]
    """m: the centre of a round object, both ends of a straight one."""
    radius: float = 0.0
    """m; 0 of a straight object."""
    door: int = -1
    """Index of the map's door."""


FloorState = tuple[FloorObject, ...]
"""Everything on the floor beside its map, in the order in which it came."""


class FloorOrders:
    """Objects and doors of the floor as orders change them, step by step."""

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        """`grid`: the robots' map; `radius`: of the largest robot, m."""
        self._radius = radius
        self._grid = grid
        self._objects: FloorState = ()
        self._closing: list[FloorObject] = []
        self._leaves: dict[int, Cells] = {}

    @cached_property
    def doorways(self) -> Doorways:
        """The doors of the map."""
        return Doorways(self._grid, self._radius)

    @property
    def now(self) -> FloorState:
        """Return the current state."""
        return self._objects

    def changes(
        self, orders: Sequence[GivenOrder], true: NDArray[np.float64], first: int = 0
    ) -> Iterator[tuple[int, FloorState]]:
        """Yield each step in which something changes, and the state from then on.

        `orders`: by step, all before `first + len(true)`; `true`: (steps, robots, 2 or more), m, positions of
        the robots from the step `first` on. A door closes once no robot stands in it.
        """
        begin = first
        for step, order in orders:
            yield from self._closed(true, first, begin, max(step, begin))
            begin = max(step, begin)
            if self._take(order):
                yield begin, self._objects
        yield from self._closed(true, first, begin, first + len(true))

    def leaf(self, thing: FloorObject) -> Cells:
        """Return the cells that a closed door fills, (rows, columns)."""
        return self._leaves[thing.door]

    def _take(self, order: object) -> bool:
        """Apply an order; True if the floor has changed. The world has refused invalid ones."""
        match order:
            case Obstacle(x, y, radius):
                self._objects += (FloorObject("obstacle", ((x, y),), radius),)
            case Wall(x, y, to_x, to_y):
                self._objects += (FloorObject("wall", ((x, y), (to_x, to_y))),)
            case CloseDoor(x, y) | OpenDoor(x, y):
                return self._turn(order, Point(x, y))
            case _:
                return False
        return True

    def _turn(self, order: CloseDoor | OpenDoor, at: Point) -> bool:
        try:
            door = self.doorways.at(at).index
            same = [one for one in self._objects if one.door == door]
            if isinstance(order, OpenDoor):
                self._closing = [one for one in self._closing if one.door != door]
                self._objects = tuple(one for one in self._objects if one.door != door)
                return bool(same)
            if not same and all(one.door != door for one in self._closing):
                self._closing.append(
                    FloorObject("closed door", self.doorways.leaf(self._filled(door)), 0.0, door)
                )
        except DoorError:
            pass
        return False

    def _closed(
        self, true: NDArray[np.float64], first: int, begin: int, end: int
    ) -> Iterator[tuple[int, FloorState]]:
        """Yield the doors that close in the steps from `begin` to before `end`."""
        now = true[begin - first : end - first, :, :2]
        waits = [(self._wait(now, self.leaf(one)), one) for one in self._closing]
        for wait, one in sorted((two for two in waits if two[0] is not None), key=lambda two: two[0] or 0):
            self._closing.remove(one)
            self._objects += (one,)
            yield begin + (wait or 0), self._objects

    def _wait(self, true: NDArray[np.float64], leaf: Cells) -> int | None:
        """Return the first step in which no robot stands in a door; None: there is none."""
        filled = self.middles(leaf)
        for step, robots in enumerate(true):
            gaps = np.hypot(*(robots[:, None] - filled).transpose(2, 0, 1))
            if not (gaps < self._radius).any():
                return step
        return None

    def middles(self, taken: Cells) -> NDArray[np.float64]:
        """Return the centres of cells, (n, 2), m."""
        rows, columns = np.nonzero(taken)
        x, y = self._grid.centres()
        return np.column_stack([x[columns], y[rows]])

    def _filled(self, door: int) -> Cells:
        if door not in self._leaves:
            self._leaves[door] = self.doorways.closed(self.doorways.regions.doors[door])
        return self._leaves[door]


def door_cells(grid: OccupancyGrid, radius: float) -> Cells | None:
    """Return which cells are doors, (rows, columns), for robots of a radius, m; None without a radius."""
    if not radius:
        return None
    parts = Doorways(grid, radius).regions
    return parts.labels > parts.count


class FloorHistory:
    """The floor of one run over time, part by part."""

    def __init__(self, grid: OccupancyGrid, radius: float, step_us: int) -> None:
        """`grid`: the robots' map; `radius`: of the largest robot, m."""
        self._orders = FloorOrders(grid, radius)
        self._step_us = step_us
        self._jams: list[tuple[float, Jam]] = []
        """Those that have not ended."""
        self._state: FloorState = ()

    def extend(
        self,
        orders: Sequence[GivenOrder],
        jams: Sequence[tuple[float, Jam]],
        seconds: NDArray[np.float64],
        true: NDArray[np.float64],
        end: float,
    ) -> Iterator[tuple[float, FloorState]]:
        """Yield each instant up to `end`, s, at which the floor changes, and its state from then on.

        `seconds`, (steps,), and `true`, (steps, robots, 3): of the next steps.
        """
        if not len(seconds):
            return
        first = round(seconds[0] * 1e6) // self._step_us
        standing = self._orders.now
        changes = {
            float(seconds[step - first]): state for step, state in self._orders.changes(orders, true, first)
        }
        self._jams += jams
        ends = {in_seconds(jam.until) for _, jam in self._jams}
        for second in sorted({*changes, *(begin for begin, _ in jams), *ends}):
            if second > end:
                break
            standing = changes.get(second, standing)
            now = (*standing, *self._jamming(second))
            if now != self._state:
                self._state = now
                yield second, now
        self._jams = [one for one in self._jams if in_seconds(one[1].until) > end]

    def _jamming(self, second: float) -> Iterator[FloorObject]:
        for begin, jam in self._jams:
            if begin <= second < in_seconds(jam.until):
                yield FloorObject("jammer", ((jam.x, jam.y),), jam.radius)


class FloorInterval(NamedTuple):
    """An object, and from when to when it was there."""

    object: FloorObject
    begin: float
    """Simulated s."""
    end: float


def floor_intervals(changes: Sequence[tuple[float, FloorState]], end: float) -> list[FloorInterval]:
    """Return the intervals of all objects of a run that lasted until `end`, s, by begin."""
    open_: list[FloorInterval] = []
    found: list[FloorInterval] = []
    for second, now in changes:
        left = list(now)
        for one in open_:
            if one.object in left:
                left.remove(one.object)
            else:
                found[found.index(one)] = one._replace(end=second)
        open_ = [one for one in found if one.end == end and one.object in now]
        new = [FloorInterval(each, second, end) for each in left]
        found += new
        open_ += new
    return found
