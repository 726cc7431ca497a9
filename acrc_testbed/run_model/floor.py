"""The floor of a run over time: obstacles, walls, closed doors and jammers."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from actors.array_types import Flags
from actors.floor.doors import Doorways
from actors.floor.grid import OccupancyGrid
from actors.instant import in_seconds
from actors.messages import FloorChanged, Jam, UnmappedObstacle
from actors.orders import CloseDoor, Obstacle, OpenDoor, Wall

FLOOR_ORDERS: Final = (CloseDoor, OpenDoor, Obstacle, Wall)
"""Orders that change the floor."""
NO_CHANGES: Final = "obstacles, walls and closed doors were not recorded: an older version recorded the world"


class FloorObject(NamedTuple):
    """An object on the floor that is not on the map, or a jammer above it."""

    kind: str
    """`wall`, `obstacle`, `closed door` or `jammer`: a mark of the drawing language."""
    points: tuple[tuple[float, float], ...]
    """m: centre of a disc, or both ends of a line."""
    radius: float
    """m; for a line, half of its thickness."""

    @property
    def is_round(self) -> bool:
        """True for a disc; False for a line."""
        return len(self.points) == 1


FloorState = tuple[FloorObject, ...]
"""All objects on the floor that are not on the map, oldest first."""


def door_cells(grid: OccupancyGrid, radius: float) -> Flags | None:
    """Return the mask of door cells, (rows, columns), for robots of a radius, m; None without a radius."""
    if not radius:
        return None
    parts = Doorways(grid, radius).regions
    return parts.labels > parts.count


class FloorHistory:
    """The floor of one run over time, from the changes that the world recorded."""

    def __init__(self, step_us: int) -> None:
        self._step_us = step_us
        self._changes: list[FloorChanged] = []
        """Changes that `advance` has not returned yet."""
        self._things: dict[int, UnmappedObstacle] = {}
        self._jams: list[tuple[float, Jam]] = []
        """Active jammers."""
        self._state: FloorState = ()
        self.is_recorded = False
        """True once the world has recorded its floor."""

    def extend(self, changed: FloorChanged) -> None:
        """Add a change."""
        self.is_recorded = True
        self._changes.append(changed)

    def advance(
        self, until: int, jams: Sequence[tuple[float, Jam]], end: float
    ) -> Iterator[tuple[float, FloorState]]:
        """Yield the time of each change, s, and the new state of the floor.

        `until`, `end`: last step, and last instant, s; `jams`: jammers that were switched on in these steps.
        """
        due = [one for one in self._changes if one.step <= until]
        self._changes = self._changes[len(due) :]
        self._jams += jams
        changes: dict[float, list[FloorChanged]] = {}
        for one in due:
            changes.setdefault(in_seconds(one.step * self._step_us), []).append(one)
        ends = {in_seconds(jam.until) for _, jam in self._jams}
        for second in sorted({*changes, *(begin for begin, _ in jams), *ends}):
            if second > end:
                break
            for one in changes.get(second, ()):
                self._apply(one)
            now = tuple(self._objects(second))
            if now != self._state:
                self._state = now
                yield second, now
        self._jams = [one for one in self._jams if in_seconds(one[1].until) > end]

    def _apply(self, changed: FloorChanged) -> None:
        for number in changed.gone:
            self._things.pop(number, None)
        self._things.update((one.number, one) for one in changed.put)

    def _objects(self, second: float) -> Iterator[FloorObject]:
        """Yield the objects put there so far, then the jammers that are active at an instant, s."""
        for one in self._things.values():
            if one.kind != "closing door":
                yield FloorObject(one.kind, one.points, one.radius)
        for begin, jam in self._jams:
            if begin <= second < in_seconds(jam.until):
                yield FloorObject("jammer", ((jam.x, jam.y),), jam.radius)


class FloorInterval(NamedTuple):
    """An object and the interval in which it was on the floor."""

    object: FloorObject
    begin: float
    """Simulated s."""
    end: float


def floor_intervals(changes: Sequence[tuple[float, FloorState]], end: float) -> list[FloorInterval]:
    """Return the intervals of all objects, by start; `end`: end of the run, s."""
    open_: list[FloorInterval] = []
    found: list[FloorInterval] = []
    for second, now in changes:
        remaining = list(now)
        for one in open_:
            if one.object in remaining:
                remaining.remove(one.object)
            else:
                found[found.index(one)] = one._replace(end=second)
        open_ = [one for one in found if one.end == end and one.object in now]
        new = [FloorInterval(each, second, end) for each in remaining]
        found += new
        open_ += new
    return found
