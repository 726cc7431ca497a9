"""Time intervals of obstacles, walls, closed doors and jammers on a run's floor."""

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.evidence.run_evidence import RunEvidence, largest_radius
from acrc_testbed.replay.run_recordings import GivenOrder
from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import OccupancyGrid
from actors.geometry import Point
from actors.instant import in_seconds
from actors.messages import Jam
from actors.orders import CloseDoor, Give, Lose, Move, Obstacle, OpenDoor, Order, StartJam, Wall

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


Things = tuple[FloorThing, ...]
_THERE: Final = 0.1
"""So near the point to which it was carried a robot is at that step, m."""


class ThingSpan(NamedTuple):
    """Something that was there for a while."""

    thing: FloorThing
    begin: float
    """Simulated s."""
    end: float


class OrderedChange(NamedTuple):
    """What somebody, or the scenario, ordered, and no robot did."""

    second: float
    robot: str
    """Whom it is about; empty: nobody."""
    words: str


class ThingsOverTime:
    """Follows a run, piece by piece."""

    def __init__(self) -> None:
        self._floor: FloorThings | None = None
        self._jams: list[tuple[float, Jam]] = []
        """Those that have not ended."""
        self._told: Things = ()

    def floor(self, run: RunEvidence) -> FloorThings:
        """The floor of the run, and what stands on it by now."""
        if self._floor is None:
            self._floor = FloorThings(run.grid, largest_radius(run.setup))
        return self._floor

    def extend(self, run: RunEvidence) -> Iterator[tuple[float, Things]]:
        """From which instant on, s, these things were there, until the next one; in order."""
        on_floor = self.floor(run)
        if not len(run.seconds):
            return
        first = round(run.seconds[0] * 1e6) // run.setup.step_us
        standing = on_floor.now
        floor = {float(run.seconds[step - first]): things for step, things in
                 on_floor.changes(run.orders, run.true, first)}  # fmt: skip
        self._jams += run.jams
        ends = {in_seconds(jam.until) for _, jam in self._jams}
        for second in sorted({*floor, *(begin for begin, _ in run.jams), *ends}):
            if second > run.end:
                break
            standing = floor.get(second, standing)
            now = (*standing, *self._jamming(second))
            if now != self._told:
                self._told = now
                yield second, now
        self._jams = [one for one in self._jams if in_seconds(one[1].until) > run.end]

    def _jamming(self, second: float) -> Iterator[FloorThing]:
        for begin, jam in self._jams:
            if begin <= second < in_seconds(jam.until):
                yield FloorThing("jammer", ((jam.x, jam.y),), jam.radius)


def spans(run: RunEvidence) -> list[ThingSpan]:
    """All that was put into a whole run's world, in the order in which it came."""
    open_: list[ThingSpan] = []
    found: list[ThingSpan] = []
    for second, now in ThingsOverTime().extend(run):
        left = list(now)
        for one in open_:
            if one.thing in left:
                left.remove(one.thing)
            else:
                found[found.index(one)] = one._replace(end=second)
        open_ = [one for one in found if one.end == run.end and one.thing in now]
        new = [ThingSpan(thing, second, run.end) for thing in left]
        found += new
        open_ += new
    return found


def ordered(run: RunEvidence) -> list[OrderedChange]:
    """What was ordered, and shows neither by the robots' states nor by their words; in order.

    Of who was to be carried, those that were: what the world has refused changed nothing.
    """
    found = []
    for step, order in run.orders:
        if words := _words(order):
            robot = order.robot if isinstance(order, Give | Move | Lose) else ""
            if not isinstance(order, Move) or _carried(run, step, order):
                found.append(OrderedChange(in_seconds(step * run.setup.step_us), robot, words))
    return found


def _carried(run: RunEvidence, step: int, order: Move) -> bool:
    if order.robot not in run.robots or not len(run.seconds):
        return False
    row = step - round(run.seconds[0] * 1e6) // run.setup.step_us
    x, y = run.true[min(max(row, 0), len(run.true) - 1), run.robots.index(order.robot), :2].tolist()
    return math.dist((x, y), (order.x, order.y)) < _THERE


def _words(order: Order) -> str:
    """What it says; nothing for orders that other marks show."""
    words = ""
    match order:
        case Obstacle(x, y, radius):
            words = f"a thing of {2 * radius:g} m is put at ({x:.1f}, {y:.1f})"
        case Wall(x, y, to_x, to_y):
            words = f"a wall is put from ({x:.1f}, {y:.1f}) to ({to_x:.1f}, {to_y:.1f})"
        case CloseDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) is to close"
        case OpenDoor(x, y):
            words = f"the door at ({x:.1f}, {y:.1f}) opens"
        case StartJam(x, y, radius, duration):
            words = f"a jammer of {radius:g} m at ({x:.1f}, {y:.1f}) for {in_seconds(duration):g} s"
        case Give(_, places):
            words = f"is given {len(places)} more place{'' if len(places) == 1 else 's'}"
        case Move(_, x, y, _):
            words = f"is carried to ({x:.1f}, {y:.1f})"
        case Lose(_, sender):
            words = f"is to lose the next frame of {sender}"
    return words
