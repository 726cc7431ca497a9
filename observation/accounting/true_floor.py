"""A run's floor as it truly was, stage by stage: the map, with doors closed and things put on it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OCCUPIED, OccupancyGrid
from observation.accounting.episodes import STANDARD, EpisodeParameters
from observation.accounting.passage import Passages
from observation.accounting.ways import FloorWays
from observation.evidence.floor_things import ON_FLOOR, FloorThing, FloorThings
from observation.replay.recorded_orders import GivenOrder

_HALF_WALL: Final = 0.05
"""Half of how thick a wall is that was ordered, m, as in `actors.world.body`."""


@dataclass(frozen=True, eq=False)
class Stage:
    """The floor from one step on until the next stage."""

    begin: int
    ways: FloorWays
    """As it is."""
    opened: FloorWays
    """If all doors were open."""
    leaves: NDArray[np.float64]
    """(n, 2): the middles of the cells that closed doors fill, m."""


class TrueFloor:
    """All stages of a run's floor, and its narrow places."""

    def __init__(
        self,
        grid: OccupancyGrid,
        radius: float,
        orders: Sequence[GivenOrder] = (),
        parameters: EpisodeParameters = STANDARD,
    ) -> None:
        """`grid`: the robots' map; `radius`: of the largest robot, m; `orders`: in their order."""
        self.grid = grid
        self.passages = Passages(grid, radius, parameters.neck)
        self._radius, self._reach = radius, parameters.reported
        self._orders = [one for one in orders if isinstance(one.order, ON_FLOOR)]

    def stages(self, true: NDArray[np.float64]) -> list[Stage]:
        """From the first step on; `true`: (steps, robots, 2 or more), where robots were, m.

        A door closes once no robot stands in it.
        """
        floor = FloorThings(self.grid, self._radius)
        found = [self._stage(0, floor, ())]
        for begin, things in floor.changes(self._orders, true):
            found.append(self._stage(begin, floor, things))
        return found

    def _stage(self, begin: int, floor: FloorThings, things: tuple[FloorThing, ...]) -> Stage:
        taken, leaves = np.zeros((2, *self.grid.cells.shape), np.bool_)
        for thing in things:
            if thing.kind == "closed door":
                leaves |= floor.leaf(thing)
            else:
                taken |= self._from(thing) <= (thing.radius or _HALF_WALL)
        opened = self._ways(taken)
        ways = self._ways(taken | leaves) if leaves.any() else opened
        return Stage(begin, ways, opened, floor.middles(leaves))

    def _ways(self, taken: NDArray[np.bool_]) -> FloorWays:
        key = taken.tobytes()
        if key not in self._known:
            cells = np.where(taken, np.uint8(OCCUPIED), self.grid.cells)
            floor = replace(self.grid, cells=cells) if taken.any() else self.grid
            self._known[key] = FloorWays(floor, self._radius, self._reach)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[bytes, FloorWays]:
        return {}

    def _from(self, thing: FloorThing) -> NDArray[np.float64]:
        """(rows, columns): how far cells are from a line or a point, m."""
        columns, rows = self.grid.centres()
        (x, y), (to_x, to_y) = thing.points[0], thing.points[-1]
        dx, dy = to_x - x, to_y - y
        across, up = columns[None, :] - x, rows[:, None] - y
        share = np.clip((across * dx + up * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        far: NDArray[np.float64] = np.hypot(across - share * dx, up - share * dy)
        return far
