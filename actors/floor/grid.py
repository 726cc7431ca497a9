"""Floor plan as a grid of free, unknown or occupied cells in the map frame."""

import hashlib
import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final, Generic, NamedTuple, TypeVar
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Flags, Floats, Int32s, Octets
from actors.floor import raster
from actors.floor.raster_arrays import runs
from actors.geometry import Point
from deeco.knowledge import new_tuple

V = TypeVar("V")


class SharedCache(Generic[V]):
    """Weak cache of immutable values by their content, and of the last value.

    A process that starts many robots keeps the values of the first, so that the others, also forked ones,
    share them.
    """

    def __init__(self) -> None:
        self._known: WeakValueDictionary[Hashable, V] = WeakValueDictionary()

    def get(self, content: Hashable, make: Callable[[], V]) -> V:
        """Return the cached value of `content`, or a new one by `make`."""
        value = self._known.get(content)
        if value is None:
            value = self._known[content] = make()
        self._last = value
        return value


FREE: Final = 0
UNKNOWN: Final = 1
OCCUPIED: Final = 2
_MAP_FRAME: Final = Point(0.0, 0.0)


class Cell(NamedTuple):
    """A cell of the grid: `row` counts from the south edge northward, `column` from the west eastward."""

    row: int
    column: int


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """A floor plan of free, occupied and unknown cells.

    A point on the line between two cells belongs to the one north or east of it. Cells that are not free
    block, and so does everything outside.
    """

    cells: Octets
    """(rows, columns) of FREE, UNKNOWN, OCCUPIED; row 0 is the southernmost. A read-only copy."""
    resolution: float
    """Side of a cell, m."""
    origin: Point = _MAP_FRAME
    """South-west corner of the cell in row 0, column 0, m in the map frame."""

    def __post_init__(self) -> None:
        assert self.cells.ndim == 2 and self.cells.dtype == np.uint8 and self.cells.size > 0
        assert self.resolution > 0
        cells = self.cells.copy()
        cells.setflags(write=False)
        object.__setattr__(self, "cells", cells)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.cells.shape[0])

    @property
    def columns(self) -> int:
        """Number of columns."""
        return int(self.cells.shape[1])

    @property
    def corner(self) -> Point:
        """North-east corner of the map, m."""
        return Point(
            self.origin.x + self.columns * self.resolution, self.origin.y + self.rows * self.resolution
        )

    @property
    def free(self) -> Flags:
        """Which cells are free, (rows, columns)."""
        return np.equal(self.cells, FREE)

    @property
    def blocking(self) -> Flags:
        """Which cells are occupied or unknown, (rows, columns)."""
        return np.not_equal(self.cells, FREE)

    @cached_property
    def clearance(self) -> Floats:
        """`raster.clearance` of this grid, read-only, computed once."""
        clearance = raster.clearance(self.blocking, self.resolution)
        clearance.setflags(write=False)
        return clearance

    @cached_property
    def content(self) -> bytes:
        """SHA-256 of cells, resolution and origin."""
        frame = np.array([self.rows, self.columns, self.resolution, *self.origin], np.float64)
        return hashlib.sha256(frame.tobytes() + self.cells.tobytes()).digest()

    def contains(self, point: Point) -> bool:
        """Return whether the map has a cell at `point`."""
        x, y = self._cells_from_corner(point)
        return 0 <= x < self.columns and 0 <= y < self.rows

    def cell(self, point: Point) -> Cell:
        """Return the cell that contains `point`; outside of the map, its indices are out of range."""
        x, y = self._cells_from_corner(point)
        return new_tuple(Cell, (math.floor(y), math.floor(x)))

    def centre(self, cell: Cell) -> Point:
        """Return the centre of a cell, m."""
        return Point(
            self.origin.x + (cell.column + 0.5) * self.resolution,
            self.origin.y + (cell.row + 0.5) * self.resolution,
        )

    def centres(self) -> tuple[Floats, Floats]:
        """Return the x of all columns' centres, (columns,), and the y of all rows' centres, (rows,), m.

        Read-only.
        """
        return self._centres

    @cached_property
    def _centres(self) -> tuple[Floats, Floats]:
        x = self.origin.x + (np.arange(self.columns, dtype=np.float64) + 0.5) * self.resolution
        y = self.origin.y + (np.arange(self.rows, dtype=np.float64) + 0.5) * self.resolution
        x.flags.writeable = y.flags.writeable = False
        return x, y

    def is_free(self, point: Point) -> bool:
        """Return whether `point` is in a free cell of the map."""
        return self.contains(point) and bool(self.cells[self.cell(point)] == FREE)

    def clearance_at(self, point: Point, within: float) -> float:
        """Return the distance from `point` to the nearest blocking point, m, at most `within`.

        Exact for any point, unlike `clearance`, which holds for the centres of cells; 0 in a blocking cell
        and outside.
        """
        if not self.is_free(point):
            return 0.0
        x, y = self._cells_from_corner(point)
        nearest = min(within / self.resolution, x, y, self.columns - x, self.rows - y)
        reach = math.ceil(nearest)
        bottom, left = max(int(y) - reach, 0), max(int(x) - reach, 0)
        rows, columns = np.nonzero(self.blocking[bottom : int(y) + reach + 1, left : int(x) + reach + 1])
        if rows.size:
            dx = _gap(x, columns + left)
            dy = _gap(y, rows + bottom)
            nearest = min(nearest, math.sqrt(np.min(dx * dx + dy * dy)))
        return min(within, nearest * self.resolution)

    def _cells_from_corner(self, point: Point) -> tuple[float, float]:
        return (point.x - self.origin.x) / self.resolution, (point.y - self.origin.y) / self.resolution


def reachable(grid: OccupancyGrid, start: Point, clearance: float = 0.0) -> Flags:
    """Return the free cells, (rows, columns), that a disc of radius `clearance`, m, can reach from `start`.

    It moves east, north, west and south over cells whose centre is at least `clearance` from blocking points.
    Nothing is reachable from a start without that clearance, or outside the map.
    """
    if not grid.contains(start):
        return np.zeros(grid.cells.shape, dtype=np.bool_)
    parts = _parts(grid, clearance)
    return np.equal(parts, parts[grid.cell(start)] or -1)


@lru_cache(2)
def _parts(grid: OccupancyGrid, clearance: float) -> Int32s:
    return raster.regions(passable(grid, clearance))


def largest_region(grid: OccupancyGrid, clearance: float = 0.0) -> Flags:
    """Return the largest set of cells that `reachable` returns for any start, (rows, columns)."""
    return raster.largest_region(passable(grid, clearance))


def passable(grid: OccupancyGrid, clearance: float) -> Flags:
    """Return the free cells whose centre is at least `clearance`, m, from blocking points, (rows,
    columns)."""
    if clearance <= grid.resolution / 2:  # every free cell has it
        return grid.free
    return grid.clearance >= clearance


def nearest_cell(grid: OccupancyGrid, admitted: Flags, point: Point, within: float = math.inf) -> Cell | None:
    """Return the admitted cell around `point`, or the one with the nearest centre; None beyond `within`, m.

    `admitted`: (rows, columns).
    """
    here = grid.cell(point)
    if grid.contains(point) and admitted[here]:
        return here
    window, bottom, left = admitted, 0, 0
    if within < math.inf:
        cells = math.ceil(within / grid.resolution) + 1
        bottom, left = max(here.row - cells, 0), max(here.column - cells, 0)
        window = admitted[bottom : max(here.row + cells + 1, 0), left : max(here.column + cells + 1, 0)]
    rows, columns = np.nonzero(window)
    if not rows.size:
        return None
    x, y = grid.centres()
    squared = np.square(x[columns + left] - point.x) + np.square(y[rows + bottom] - point.y)
    best = int(np.argmin(squared))
    if squared[best] > within * within:
        return None
    return Cell(int(rows[best]) + bottom, int(columns[best]) + left)


def outline(grid: OccupancyGrid, *, beyond: bool = True) -> Floats:
    """Return the exact border of free and blocking cells, (n, 4), rows of x0, y0, x1, y1, m.

    The outside of the map blocks if `beyond`. Segments have maximum length and are listed once: first the
    horizontal ones (x0 < x1) from south to north and west to east, then the vertical ones (y0 < y1) from west
    to east and south to north.
    """
    ringed = np.full((grid.rows + 2, grid.columns + 2), beyond)
    ringed[1:-1, 1:-1] = grid.blocking
    y, x0, x1 = runs(ringed[1:, 1:-1] != ringed[:-1, 1:-1])
    horizontal = np.stack([x0, y, x1, y], axis=1)
    x, y0, y1 = runs((ringed[1:-1, 1:] != ringed[1:-1, :-1]).T)
    vertical = np.stack([x, y0, x, y1], axis=1)
    corner = np.array([grid.origin.x, grid.origin.y, grid.origin.x, grid.origin.y])
    return corner + np.concatenate([horizontal, vertical]) * grid.resolution


def _gap(value: float, index: NDArray[Any]) -> Floats:
    """Return the distance along one axis from `value` to the closed intervals [index, index + 1]."""
    gap: Floats = np.maximum(np.maximum(index - value, value - index - 1.0), 0.0)
    return gap
