"""The cheapest ways over one floor, by goal: how far it is, and where one goes first."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid, nearest_cell
from actors.geometry import Point
from actors.robot.navigation.potential import STRAIGHT, UNREACHABLE, descent, potential

Points = NDArray[np.float64]
_SIDE: Final = 0.067
"""Cells are joined until they would be larger, m: a way need not be finer than a third of a robot."""
_OPEN: Final = 10
"""Cost of a cell far from walls,"""
_TIGHT: Final = 30
"""and so much more where a robot just fits: ways keep to the middle as navigation's do."""
_ROOM: Final = 0.3
"""From so much room on, m, beside what a robot needs, a cell is far from walls."""
_ASIDE: Final = 0.3
"""A robot that stands where none fits, as in a corner, begins at the nearest cell within, m."""
_CELL_COST: Final = 2 * STRAIGHT * _OPEN


class FloorWays:
    """Of discs of one radius on one floor; what was computed for a goal is kept."""

    def __init__(self, grid: OccupancyGrid, radius: float, reach: float) -> None:
        """`radius` of a robot, m; a goal is reached by who is within `reach` of it, m."""
        by = max(int(_SIDE / grid.resolution), 1)
        rows, columns = grid.rows // by, grid.columns // by
        blocks = grid.clearance[: rows * by, : columns * by].reshape(rows, by, columns, by)
        room = blocks.max(axis=(1, 3)) - (radius - grid.resolution / 2)
        self._fits = room >= 0
        tight = np.clip(1 - room / _ROOM, 0.0, 1.0)
        self._costs = np.where(self._fits, np.rint(_OPEN + _TIGHT * tight), 0).astype(np.int32)
        cells = np.where(self._fits, FREE, OCCUPIED).astype(np.uint8)
        self._grid = OccupancyGrid(cells, grid.resolution * by, grid.origin)
        self._reach = reach
        self._fields: dict[tuple[float, float], NDArray[np.int32] | None] = {}
        self._begins: dict[tuple[int, int], Cell | None] = {}

    def far(self, points: Points, goal: tuple[float, float]) -> NDArray[np.float64]:
        """(n,): how far it is from each point, (n, 2), m, where there is room; inf without a way."""
        field = self._field(goal)
        if field is None:
            return np.full(len(points), np.inf)
        squares, which = np.unique(self.squares(points), axis=0, return_inverse=True)
        begins = [self._begin(row, column) for row, column in squares.tolist()]
        costs = np.array([UNREACHABLE if one is None else field[one] for one in begins], np.int64)
        metres = np.where(costs == UNREACHABLE, np.inf, costs * (self._grid.resolution / _CELL_COST))
        return metres[which.reshape(-1)]

    def way(self, point: tuple[float, float], goal: tuple[float, float], length: float) -> Points | None:
        """(n, 2): points from this one on, for so many m, about as far apart as cells; None without a way."""
        field, begin = self._field(goal), self._begin(*self.squares(np.array([point]))[0].tolist())
        if field is None or begin is None or field[begin] == UNREACHABLE:
            return None
        cells = descent(self._costs, field, *begin)[: int(length / self._grid.resolution) + 1]
        x, y = self._grid.centres()
        return self._straight(np.column_stack([x[cells[:, 1]], y[cells[:, 0]]]))

    def _straight(self, way: Points) -> Points:
        """The same way without the bends that come of going from cell to cell in eight directions."""
        parts, here = [way[:1]], 0
        while here < len(way) - 1:
            there = next(
                k for k in range(len(way) - 1, here, -1) if k == here + 1 or self._clear(*way[[here, k]])
            )
            parts.append(np.linspace(way[here], way[there], there - here + 1)[1:])
            here = there
        return np.concatenate(parts)

    def _clear(self, one: Points, other: Points) -> bool:
        """True if a robot fits everywhere on the straight line between two points."""
        count = 2 * int(np.hypot(*(other - one)) / self._grid.resolution) + 2
        rows, columns = self.squares(np.linspace(one, other, count).astype(np.float64)).T
        return bool(self._fits[rows, columns].all())

    def squares(self, points: Points) -> NDArray[np.int64]:
        """(n, 2): row and column of the cells that points, (n, 2), are in; from one cell leads one way."""
        corner = np.array([self._grid.origin.x, self._grid.origin.y])
        cells: NDArray[np.int64] = np.floor((points - corner) / self._grid.resolution).astype(np.int64)
        return cells[:, ::-1]

    def _begin(self, row: int, column: int) -> Cell | None:
        if (row, column) not in self._begins:
            middle = self._grid.centre(Cell(row, column))
            self._begins[row, column] = nearest_cell(self._grid, self._fits, middle, _ASIDE)
        return self._begins[row, column]

    def _field(self, goal: tuple[float, float]) -> NDArray[np.int32] | None:
        if goal not in self._fields:
            cell = nearest_cell(self._grid, self._fits, Point(*goal), self._reach)
            self._fields[goal] = None if cell is None else potential(self._costs, *cell)
        return self._fields[goal]
