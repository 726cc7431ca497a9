"""When what was put into a run's world was there: for pictures, films and windows."""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from actors.instant import in_seconds
from actors.messages import Jam
from actors.orders import CloseDoor, Give, Lose, Move, Obstacle, OpenDoor, Order, StartJam, Wall
from observation.evidence.floor_things import FloorThing, FloorThings
from observation.evidence.run_evidence import RunEvidence, largest_radius

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
