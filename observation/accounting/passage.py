"""Where a robot that stands lets nobody by: the doors and narrow places of a floor plan."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor import distance, flood
from actors.floor.grid import OccupancyGrid, largest_region
from actors.geometry import Point

_ROOM: Final = 1.0
"""What is cut off counts from so much floor on, for the centre of a robot, m²: more than a niche has."""
_AROUND: Final = 1.0
"""So far around a robot it is looked first whether it leaves a way, m; of no influence on what comes out."""


class Passages:
    """The narrow places of one floor plan, for discs of one radius."""

    def __init__(self, grid: OccupancyGrid, radius: float, neck: float = 0.0) -> None:
        """`radius`, m; `neck`: for `at`, passages between rooms that are narrower count as well, m."""
        self.grid = self._grid = grid
        self._radius = radius
        self._floor = largest_region(grid, radius)
        self._centres = grid.centres()
        self._neck = _necks(grid, self._floor, neck) if neck else np.zeros(grid.cells.shape, np.bool_)
        self._to_neck = distance.squared_distance(self._neck) * grid.resolution**2
        self._judged: dict[tuple[float, float, float], bool] = {}

    def closed_by(self, point: Point) -> bool:
        """True if a robot at `point` cuts off at least 1 m² from the floor that the others can get to."""
        if self._leaves_way(point):
            return False
        left = self._floor & ~self._taken(point)
        cut_off = int(left.sum()) - int(flood.largest_region(left).sum())
        return cut_off * self._grid.resolution**2 >= _ROOM

    def at(self, points: NDArray[np.float64], within: float) -> NDArray[np.bool_]:
        """(k,): which of the points, (k, 2), m, are at a neck, or at a passage as `beside` has it.

        All points of one square of a lattice of half of `within` are judged by its middle, and once.
        """
        side = within / 2
        squares, which = np.unique(np.floor(points / side).astype(np.int64), axis=0, return_inverse=True)
        judged = [self._square(float(x), float(y), within) for x, y in (squares + 0.5) * side]
        return np.array(judged, np.bool_)[which.reshape(-1)]

    def sees(self, one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(k,): where no wall stands between two points of the map, each (k, 2), m."""
        farthest = float(np.hypot(*(other - one).T).max(initial=0.0))
        along = np.linspace(0.0, 1.0, int(farthest / self._grid.resolution) + 2)[:, None, None]
        corner = np.array([self._grid.origin.x, self._grid.origin.y])
        cells = ((one + (other - one) * along - corner) / self._grid.resolution).astype(np.intp)
        seen: NDArray[np.bool_] = ~self._grid.blocking[cells[..., 1], cells[..., 0]].any(axis=0)
        return seen

    def _square(self, x: float, y: float, within: float) -> bool:
        key = (x, y, within)
        if key not in self._judged:
            point = Point(x, y)
            near = self._grid.contains(point) and self._to_neck[self._grid.cell(point)] <= within**2
            self._judged[key] = bool(near) or self.beside(point, within)
        return self._judged[key]

    def beside(self, point: Point, within: float = 0.5) -> bool:
        """True if some point of the floor not farther than `within`, m, is one at which a robot would.

        Looked at are points of a lattice of a quarter of `within` around `point`.
        """
        marks = np.linspace(-within, within, 9)
        around = [(point.x + dx, point.y + dy) for dx in marks for dy in marks if np.hypot(dx, dy) <= within]
        return any(self._is_floor(Point(*xy)) and self.closed_by(Point(*xy)) for xy in [point, *around])

    def _leaves_way(self, point: Point) -> bool:
        """True if the floor around hangs together without where the robot stands: then nothing is cut off.

        The other way round nothing follows: there may be another way about.
        """
        cell, side = self._grid.cell(point), self._grid.resolution
        if self._grid.contains(point) and self._grid.clearance[cell] >= 3 * self._radius + 2 * side:
            return True  # others get by on every side
        reach = int((2 * self._radius + _AROUND) / side)
        bottom, left = max(cell.row - reach, 0), max(cell.column - reach, 0)
        around = np.s_[bottom : cell.row + reach + 1, left : cell.column + reach + 1]
        near = flood.flood(self._floor[around], cell.row - bottom, cell.column - left)
        near &= ~self._taken(point, around)
        return bool(np.array_equal(flood.largest_region(near), near))

    def _is_floor(self, point: Point) -> bool:
        return self._grid.contains(point) and bool(self._floor[self._grid.cell(point)])

    def _taken(self, point: Point, around: tuple[slice, slice] = np.s_[:, :]) -> NDArray[np.bool_]:
        """(rows, columns) of a part of the map: where the centre of another robot cannot be."""
        x, y = self._centres
        taken: NDArray[np.bool_] = (x[around[1]] - point.x) ** 2 + (y[around[0], None] - point.y) ** 2 < (
            2 * self._radius
        ) ** 2
        return taken


def _necks(grid: OccupancyGrid, floor: NDArray[np.bool_], width: float) -> NDArray[np.bool_]:
    """(rows, columns): floor under no free disc of this width, m, without which rooms fall apart."""
    roomy = distance.squared_distance(grid.clearance >= width / 2) * grid.resolution**2 < (width / 2) ** 2
    rest, necks = floor & ~roomy, np.zeros_like(floor)
    while rest.any():
        row, column = np.argwhere(rest)[0]
        part = flood.flood(rest, int(row), int(column))
        rest &= ~part
        left = floor & ~part
        if int(left.sum()) - int(flood.largest_region(left).sum()) >= _ROOM / grid.resolution**2:
            necks |= part
    return necks
