"""The shortest ways between points of a robot's own map, and the doors on them; a field per goal is kept.

Unlike plans, which keep off walls (`planning`), these are only about length. They run on cells twice as large
where the body is large enough, so that a swarm's places fit the memory of one cost map.
"""

import math
from collections import OrderedDict
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, nearest_cell
from actors.floor.regions import Regions, regions
from actors.floor.sharing import Shared
from actors.geometry import Point
from actors.robot.navigation.planning import Ground
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, descent, potential

_TOLERANCE: Final = 0.5
"""A point where the robot cannot be stands for the nearest one where it can, within so many m."""
_FIELDS: Final = 256
"""So many goals are kept; 0.11 MB each on the corridor map."""
_PAIRS: Final = 1 << 16
"""So many pairs of cells whose doors are kept."""


class Routes:
    """Lengths, ways and doors on one ground."""

    def __init__(self, ground: Ground) -> None:
        self._ground = ground
        self._factor = max(1, int(ground.reach / (ground.grid.resolution * math.sqrt(2.0))))
        self._grid, self._costs = _coarse(ground, self._factor)
        self._fields: OrderedDict[Cell, NDArray[np.int32]] = OrderedDict()
        self._doors_between = lru_cache(_PAIRS)(self._find_doors)

    def length(self, start: Point, goal: Point) -> float | None:
        """How far it is, m; None where no way leads. At most 8 % more than the shortest curve, for grids turn
        by eighths."""
        first, last = self._cell(start), self._cell(goal)
        if first is None or last is None:
            return None
        steps = int(self._field(last)[first])
        return None if steps == UNREACHABLE else steps * self._grid.resolution / (2 * STRAIGHT)

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """The way of that length: centres of neighbouring cells; None without one."""
        first, last = self._cell(start), self._cell(goal)
        if first is None or last is None or self._field(last)[first] == UNREACHABLE:
            return None
        cells = descent(self._costs, self._field(last), *first)
        return tuple(self._grid.centre(Cell(int(row), int(column))) for row, column in cells)

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Indices of the doors on that way, in order; None without one."""
        first, last = self._cell(start), self._cell(goal)
        return None if first is None or last is None else self._doors_between(first, last)

    @cached_property
    def regions(self) -> Regions:
        """The floor taken apart, on the ground's own grid."""
        ground = self._ground
        return regions(ground.grid, ground.costs > 0, ground.clearance)

    def region(self, point: Point) -> int | None:
        """The number of the region around a point, from 1; None in a door, and where the robot cannot be."""
        label = self._label(self._ground.grid.cell(point)) if self._ground.grid.is_free(point) else 0
        return label if 0 < label <= self.regions.count else None

    def door(self, point: Point) -> int | None:
        """The index of the door around a point; None elsewhere."""
        label = self._label(self._ground.grid.cell(point)) if self._ground.grid.is_free(point) else 0
        return label - self.regions.count - 1 if label > self.regions.count else None

    def _label(self, cell: Cell) -> int:
        return int(self.regions.labels[cell])

    def _cell(self, point: Point) -> Cell | None:
        return nearest_cell(self._grid, self._costs > 0, point, _TOLERANCE)

    def _field(self, goal: Cell) -> NDArray[np.int32]:
        field = self._fields.get(goal)
        if field is not None:
            self._fields.move_to_end(goal)
            return field
        while len(self._fields) >= _FIELDS:
            self._fields.popitem(last=False)
        self._fields[goal] = potential(self._costs, *goal)
        return self._fields[goal]

    def _find_doors(self, first: Cell, last: Cell) -> tuple[int, ...] | None:
        field = self._field(last)
        if field[first] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *first)
        labels = self._coarse_labels[cells[:, 0], cells[:, 1]]
        labels = labels[labels > 0]
        met = labels[np.flatnonzero(np.diff(labels, prepend=0))].tolist()
        count = self.regions.count
        doors = []
        for index, label in enumerate(met):
            ends = index in (0, len(met) - 1)
            if label > count and (ends or met[index - 1] != met[index + 1]):
                doors.append(label - count - 1)
        return tuple(doors)

    @cached_property
    def _coarse_labels(self) -> NDArray[np.int32]:
        """(rows, columns) of the large cells; a cell with a door in it is one of that door."""
        labels: NDArray[np.int32] = _blocks(self.regions.labels, self._factor).max(axis=(1, 3))
        return labels


_ROUTES: Final = Shared[Routes]()


def routes(ground: Ground) -> Routes:
    """The routes of a ground; shared by all robots of a process that have the same ground."""
    return _ROUTES.get(ground, lambda: Routes(ground))


def _blocks(fine: NDArray[np.int32], factor: int) -> NDArray[np.int32]:
    """(rows, factor, columns, factor), with 0 beyond the north and east edges."""
    rows, columns = -(-fine.shape[0] // factor), -(-fine.shape[1] // factor)
    padded = np.zeros((rows * factor, columns * factor), np.int32)
    padded[: fine.shape[0], : fine.shape[1]] = fine
    return padded.reshape(rows, factor, columns, factor)


def _coarse(ground: Ground, factor: int) -> tuple[OccupancyGrid, NDArray[np.int32]]:
    """The ground on larger cells, passable where one of their cells is; and costs of 1 there.

    No wall vanishes: where the body's centre cannot be is everywhere wider than two large cells' diagonals.
    """
    costs = _blocks((ground.costs > 0).astype(np.int32), factor).max(axis=(1, 3))
    costs.setflags(write=False)  # as the ground's: the kernels are compiled for that
    cells = np.where(costs > 0, FREE, OCCUPIED).astype(np.uint8)
    return OccupancyGrid(cells, ground.grid.resolution * factor, ground.grid.origin), costs
