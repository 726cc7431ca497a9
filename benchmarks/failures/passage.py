"""Where a robot that stands lets nobody by: the doors and narrow places of a floor plan."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor import flood
from actors.floor.grid import OccupancyGrid, largest_region
from actors.geometry import Point

_ROOM: Final = 1.0
"""What is cut off counts from so much floor on, for the centre of a robot, m²: more than a niche has."""


class Passages:
    """The narrow places of one floor plan, for discs of one radius."""

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        """`radius`, m."""
        self._grid = grid
        self._radius = radius
        self._floor = largest_region(grid, radius)

    def closed_by(self, point: Point) -> bool:
        """True if a robot at `point` cuts off at least 1 m² from the floor that the others can get to."""
        left = self._floor & ~self._taken(point)
        cut_off = int(left.sum()) - int(flood.largest_region(left).sum())
        return cut_off * self._grid.resolution**2 >= _ROOM

    def beside(self, point: Point, within: float = 0.5) -> bool:
        """True if some point of the floor not farther than `within`, m, is one at which a robot would.

        Looked at are points of a lattice of a quarter of `within` around `point`.
        """
        marks = np.linspace(-within, within, 9)
        around = [(point.x + dx, point.y + dy) for dx in marks for dy in marks if np.hypot(dx, dy) <= within]
        return any(self._is_floor(Point(*xy)) and self.closed_by(Point(*xy)) for xy in [point, *around])

    def _is_floor(self, point: Point) -> bool:
        return self._grid.contains(point) and bool(self._floor[self._grid.cell(point)])

    def _taken(self, point: Point) -> NDArray[np.bool_]:
        """(rows, columns): where the centre of another robot cannot be."""
        x, y = self._grid.centres()
        taken: NDArray[np.bool_] = (x - point.x) ** 2 + (y[:, None] - point.y) ** 2 < (2 * self._radius) ** 2
        return taken
