"""A run's floor as it truly was, stage by stage: the map, with doors closed and things put on it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.doorway import DoorError, Doorways
from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.geometry import Point
from actors.orders import CloseDoor, Obstacle, OpenDoor, Wall
from observation.accounting.episodes import STANDARD, EpisodeParameters
from observation.accounting.passage import Passages
from observation.accounting.ways import FloorWays
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
        self._orders = [
            one for one in orders if isinstance(one.order, CloseDoor | OpenDoor | Obstacle | Wall)
        ]

    def stages(self, true: NDArray[np.float64]) -> list[Stage]:
        """From the first step on; `true`: (steps, robots, 2 or more), where robots were, m.

        A door closes once no robot stands in it.
        """
        found = [self._stage(0, {}, np.zeros(self.grid.cells.shape, np.bool_))]
        for begin, shut, things in self._changes(true[..., :2]):
            found.append(self._stage(begin, shut, things))
        return found

    def _changes(
        self, true: NDArray[np.float64]
    ) -> Iterator[tuple[int, dict[int, NDArray[np.bool_]], NDArray[np.bool_]]]:
        shut: dict[int, NDArray[np.bool_]] = {}
        closing: dict[int, NDArray[np.bool_]] = {}
        things = np.zeros(self.grid.cells.shape, np.bool_)
        for number, (step, order) in enumerate(self._orders):
            match order:
                case CloseDoor() | OpenDoor():
                    self._turn(order, shut, closing)
                case Obstacle():
                    things = things | (self._from(order.x, order.y, order.x, order.y) <= order.radius)
                case Wall():
                    things = things | (self._from(order.x, order.y, order.to_x, order.to_y) <= _HALF_WALL)
            yield step, dict(shut), things
            after = self._orders[number + 1].step if number + 1 < len(self._orders) else len(true)
            free = {index: self._free(true[step:after], leaf) for index, leaf in closing.items()}
            for index, wait in sorted(free.items(), key=lambda one: (one[1] is None, one[1], one[0])):
                if wait is not None:
                    shut[index] = closing.pop(index)
                    yield step + wait, dict(shut), things

    def _turn(
        self,
        order: CloseDoor | OpenDoor,
        shut: dict[int, NDArray[np.bool_]],
        closing: dict[int, NDArray[np.bool_]],
    ) -> None:
        """Orders that make no sense were refused, and changed nothing."""
        try:
            door = self._doorways.at(Point(order.x, order.y))
            if isinstance(order, OpenDoor):
                closing.pop(door.index, shut.pop(door.index, None))
            elif door.index not in shut:
                closing[door.index] = self._doorways.closed(door)
        except DoorError:
            return

    def _free(self, true: NDArray[np.float64], leaf: NDArray[np.bool_]) -> int | None:
        """The first step in which no robot stands in a door; None: there is none."""
        filled = self._middles(leaf)
        for step, robots in enumerate(true):
            gaps = np.hypot(*(robots[:, None] - filled).transpose(2, 0, 1))
            if not (gaps < self._radius).any():
                return step
        return None

    def _stage(self, begin: int, shut: dict[int, NDArray[np.bool_]], things: NDArray[np.bool_]) -> Stage:
        leaves = np.zeros_like(things)
        for leaf in shut.values():
            leaves |= leaf
        opened = self._ways(things)
        return Stage(begin, self._ways(things | leaves) if shut else opened, opened, self._middles(leaves))

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

    @cached_property
    def _doorways(self) -> Doorways:
        return Doorways(self.grid, self._radius)

    def _middles(self, taken: NDArray[np.bool_]) -> NDArray[np.float64]:
        rows, columns = np.nonzero(taken)
        x, y = self.grid.centres()
        return np.column_stack([x[columns], y[rows]])

    def _from(self, x: float, y: float, to_x: float, to_y: float) -> NDArray[np.float64]:
        """(rows, columns): how far cells are from a line, m."""
        columns, rows = self.grid.centres()
        dx, dy = to_x - x, to_y - y
        across, up = columns[None, :] - x, rows[:, None] - y
        share = np.clip((across * dx + up * dy) / max(dx * dx + dy * dy, 1e-12), 0.0, 1.0)
        far: NDArray[np.float64] = np.hypot(across - share * dx, up - share * dy)
        return far
