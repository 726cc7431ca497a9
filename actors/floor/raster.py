"""Raster algorithms on grids: distance transform, connected regions, and traversal of cells along a ray.

Distances: the lower envelope of parabolas of Felzenszwalb & Huttenlocher, "Distance Transforms of Sampled
Functions", Theory of Computing 8 (2012), algorithm 1; squared distances are whole numbers, hence exact in
float64. Rays: the traversal of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing",
Eurographics 1987, in leaps over squares of equal cells, with equal cells and points as result.
"""

import math
import sys
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Flags, Floats, Int32s, Int64s, Octets
from actors.floor import raster_arrays
from actors.kernels import kernel
from actors.portable.compiled import asin, atan2

_MOST_CELLS: Final = 1 << 19
"""Maximum size of maps for which `raster_arrays` takes less time than loading numba."""


def _without_kernels(flags: Flags) -> bool:
    return "numba" not in sys.modules and flags.size <= _MOST_CELLS


def squared_distance(mask: Flags, limit: int = raster_arrays.FAR) -> Floats:
    """Return squared distances between cell centres to the nearest True cell, cells²; inf without any.

    `mask` and result: (rows, columns). Distances are exact below `limit`, cells², and at least that beyond.
    """
    if _without_kernels(mask):
        return raster_arrays.squared_distance(mask, limit)
    return _squared_distance(np.ascontiguousarray(mask))


def clearance(blocking: Flags, resolution: float) -> Floats:
    """Return the distance from each free cell's centre to the nearest blocking point, m.

    `blocking` and result: (rows, columns); `resolution`: a cell's side, m. Blocking cells are closed squares
    with distance 0, and everything outside the map blocks: a free cell beside a wall has half a cell of
    clearance. Exact.
    """
    rows, columns = blocking.shape
    ringed = np.ones((rows + 2, columns + 2), dtype=np.bool_)
    ringed[1:-1, 1:-1] = blocking
    squared = raster_arrays.squared_clearance if _without_kernels(ringed) else _squared_clearance
    half_cells = np.sqrt(squared(ringed)[1:-1, 1:-1])
    return half_cells * (resolution / 2)


@kernel
def _rows_away(mask: Flags) -> Floats:
    """Return each cell's distance to the nearest True cell of its column, rows; inf without any."""
    rows, columns = mask.shape
    away = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            if mask[row, column]:
                away[row, column] = 0.0
            elif row > 0:
                away[row, column] = away[row - 1, column] + 1.0
            else:
                away[row, column] = np.inf
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            away[row, column] = min(away[row, column], away[row + 1, column] + 1.0)
    return away


@kernel
def _envelope(
    heights: Floats,
    apex: Int64s,
    begin: Floats,
    lowest: Floats,
) -> None:
    """Fill `lowest[q]` with the minimum over all p of (q − p)² + heights[p].

    `apex` and `begin` are scratch arrays of the same length: the lowest parabolas and where each begins.
    """
    count = 0
    for q in range(heights.size):
        if heights[q] == np.inf:
            continue
        cut = -np.inf
        while count > 0:
            p = apex[count - 1]
            cut = (heights[q] + q * q - heights[p] - p * p) / (2 * (q - p))
            if cut > begin[count - 1]:
                break
            count -= 1
        apex[count] = q
        begin[count] = cut
        count += 1
    if count == 0:
        lowest[:] = np.inf
        return
    k = 0
    for q in range(heights.size):
        while k + 1 < count and begin[k + 1] < q:
            k += 1
        lowest[q] = (q - apex[k]) * (q - apex[k]) + heights[apex[k]]


@kernel
def _squared_distance(mask: Flags) -> Floats:
    away = _rows_away(mask)
    rows, columns = mask.shape
    apex = np.empty(columns, np.int64)
    begin = np.empty(columns)
    squared = np.empty((rows, columns))
    for row in range(rows):
        _envelope(away[row] * away[row], apex, begin, squared[row])
    return squared


@kernel
def _squared_clearance(mask: Flags) -> Floats:
    """Return squared distances from cell centres to the nearest True cell's closed square, half cells².

    The nearest point of a square to a centre lies on the lattice of half cells: straight across, or at a
    corner. So each row becomes a line of 2·columns + 1 sites: cells at odd positions, lines between them at
    even ones.
    """
    away = _rows_away(mask)
    rows, columns = mask.shape
    sites = 2 * columns + 1
    heights = np.empty(sites)
    lowest = np.empty(sites)
    apex = np.empty(sites, np.int64)
    begin = np.empty(sites)
    squared = np.empty((rows, columns))
    for row in range(rows):
        heights[0] = np.inf
        for column in range(columns):
            half_cells = max(2.0 * away[row, column] - 1.0, 0.0)
            heights[2 * column + 1] = half_cells * half_cells
            heights[2 * column + 2] = half_cells * half_cells
            heights[2 * column] = min(heights[2 * column], half_cells * half_cells)
        _envelope(heights, apex, begin, lowest)
        for column in range(columns):
            squared[row, column] = lowest[2 * column + 1]
    return squared


def flood(passable: Flags, row: int, column: int) -> Flags:
    """Return the 4-connected region of passable cells around one cell; empty if that is not passable."""
    if _without_kernels(passable):
        labels = raster_arrays.regions(passable)[0]
        region: Flags = (labels == labels[row, column]) & passable[row, column]
        return region
    return _flood(np.ascontiguousarray(passable), row, column)


def largest_region(passable: Flags) -> Flags:
    """Return the 4-connected region with the most cells; of equals the first in row order."""
    labels, largest = _labelled(passable)
    region: Flags = passable & (labels == largest)
    return region


def regions(passable: Flags) -> Int32s:
    """Return the number of each passable cell's 4-connected region, from 1 in row order; 0 elsewhere."""
    return _labelled(passable)[0]


def _labelled(passable: Flags) -> tuple[Int32s, int]:
    if _without_kernels(passable):
        return raster_arrays.regions(passable)
    return _regions(np.ascontiguousarray(passable))


def fingerprint() -> dict[str, bytes]:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    row, column = np.indices((23, 31))
    mask = (row * 7 + column * column * 3) % 37 == 0
    passable = (row * 5 + column * column * 3) % 7 != 0
    labels, largest = _regions(passable)
    return {
        "distance": _squared_distance(mask).tobytes() + np.sqrt(_squared_clearance(mask)).tobytes(),
        "flood": _flood(passable, 11, 16).tobytes() + (labels == largest).tobytes(),
    }


@kernel
def _spread(passable: Flags, labels: Int32s, queue: Int64s, start: int, label: int) -> int:
    """Give `label` to the unlabelled passable cells connected to the cell `start`; return their number."""
    rows, columns = passable.shape
    labels.flat[start] = label
    queue[0] = start
    count = 1
    done = 0
    while done < count:
        row, column = divmod(queue[done], columns)
        done += 1
        for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            r, c = row + down, column + right
            if 0 <= r < rows and 0 <= c < columns and passable[r, c] and labels[r, c] == 0:
                labels[r, c] = label
                queue[count] = r * columns + c
                count += 1
    return count


@kernel
def _flood(passable: Flags, row: int, column: int) -> Flags:
    labels = np.zeros(passable.shape, np.int32)
    if passable[row, column]:
        queue = np.empty(passable.size, np.int64)
        _spread(passable, labels, queue, row * passable.shape[1] + column, 1)
    return labels > 0


@kernel
def _regions(passable: Flags) -> tuple[Int32s, int]:
    """Return each cell's region from 1 (0 = not passable), and the number of the largest region."""
    labels = np.zeros(passable.shape, np.int32)
    queue = np.empty(passable.size, np.int64)
    regions = 0
    most = 0
    largest = 1
    for start in range(passable.size):
        if passable.flat[start] and labels.flat[start] == 0:
            regions += 1
            count = _spread(passable, labels, queue, start, regions)
            if count > most:
                most = count
                largest = regions
    return labels, largest


@kernel
def bearing_to(x: float, y: float, heading: float, first_angle: float) -> float:
    """Return the bearing of (x, y) relative to the first ray, in [0, 2π) rad.

    `first_angle`: of that ray relative to `heading`, the sensor's.
    """
    bearing = atan2(y, x) - heading - first_angle
    return bearing - 2 * math.pi * math.floor(bearing / (2 * math.pi))


@kernel
def half_width(apart: float, radius: float) -> float:
    """Return half the viewing angle of a disc at this distance, rad; π from inside."""
    return asin(radius / apart) if apart > radius else math.pi


@kernel
def window(bearing: float, half: float, turn: int, increment: float, rays: int) -> tuple[int, int]:
    """Return the range of rays, last exclusive, that can hit a disc; see `bearing_to` and `half_width`.

    A disc may appear at both ends of the scan, so there are three windows, of the turns −1, 0 and 1. One more
    ray on both sides allows for rounding.
    """
    low = (bearing + 2 * math.pi * turn - half) / increment
    high = (bearing + 2 * math.pi * turn + half) / increment
    return max(math.ceil(low) - 1, 0), min(math.floor(high) + 2, rays)


MAX_SIDE: Final = 255
"""Maximum side of a square, cells, as it is stored in one byte."""


class Ray(NamedTuple):
    """A ray from a point along a unit vector."""

    x: float
    y: float
    dx: float
    dy: float
    per_x: float
    """Distance along the ray per unit of x; negative westward."""
    per_y: float
    quadrant: int
    """Index of the squares that it leaps over: bit 0 set if it goes westward, bit 1 if southward."""


class Square(NamedTuple):
    """A square that contains a ray's position, with the ray's exits."""

    left: int
    bottom: int
    side: int
    border_x: int
    """Column of the border ahead."""
    border_y: int
    """Row of the border ahead."""
    to_x: float
    """Distance along the ray to the column border."""
    to_y: float
    """Distance to the row border; the ray leaves at the nearer one."""


def equal_squares(kinds: Octets) -> Octets:
    """Return how far a ray may leap: (4, rows, columns) for (rows, columns) of kinds of cells.

    For each cell and each quadrant of directions (bit 0 set: westward, bit 1 set: southward) this is the
    side, in cells, of the largest square of one kind with the cell in its near corner; MAX_SIDE at most.
    """
    squares = np.empty((4, *kinds.shape), np.uint8)
    _equal_squares(kinds, squares)
    return squares


def free_squares(blocking: Flags) -> Octets:
    """Return `equal_squares` of free cells: (4, rows + 2, columns + 2), with a ring of blocking cells added.

    0 in a blocking cell.
    """
    ringed = np.ones((blocking.shape[0] + 2, blocking.shape[1] + 2), np.uint8)
    ringed[1:-1, 1:-1] = blocking
    squares = equal_squares(ringed)
    squares[:, ringed != 0] = 0
    return squares


@kernel
def ray(x: float, y: float, dx: float, dy: float) -> Ray:
    """Return the ray from (x, y) along the unit vector (dx, dy)."""
    per_x = 1 / dx if dx != 0 else 1e300
    per_y = 1 / dy if dy != 0 else 1e300
    return Ray(x, y, dx, dy, per_x, per_y, quadrant(dx, dy))


@kernel
def quadrant(dx: float, dy: float) -> int:
    """Return `Ray.quadrant` of a direction."""
    return (0 if dx >= 0 else 1) + (0 if dy >= 0 else 2)


@kernel
def square_at(ray: Ray, column: int, row: int, side: int) -> Square:
    """Return the square of this side, ≥ 1, with its near corner in the ray's cell."""
    east, north = ray.dx >= 0, ray.dy >= 0
    left = column if east else column - side + 1
    bottom = row if north else row - side + 1
    border_x = left + side if east else left
    border_y = bottom + side if north else bottom
    to_x, to_y = (border_x - ray.x) * ray.per_x, (border_y - ray.y) * ray.per_y
    return Square(left, bottom, side, border_x, border_y, to_x, to_y)


@kernel
def cell_after(ray: Ray, square: Square, distance: float) -> tuple[int, int]:
    """Return column and row of the cell that the ray enters after the square, at this distance from its
    start.

    Clamped so that rounding cannot move the ray out of the square except through the border that it meets.
    """
    left, bottom, last = square.left, square.bottom, square.side - 1
    if square.to_x < square.to_y:
        column = square.border_x if ray.dx >= 0 else square.border_x - 1
        return column, min(max(int(ray.y + distance * ray.dy), bottom), bottom + last)
    row = square.border_y if ray.dy >= 0 else square.border_y - 1
    return min(max(int(ray.x + distance * ray.dx), left), left + last), row


@kernel
def _equal_squares(kinds: Octets, squares: Octets) -> None:
    rows, columns = kinds.shape
    for quadrant in range(4):
        east = 1 if quadrant & 1 == 0 else -1
        north = 1 if quadrant & 2 == 0 else -1
        for a in range(rows):
            row = rows - 1 - a if north > 0 else a
            for b in range(columns):
                column = columns - 1 - b if east > 0 else b
                side = 0
                if a > 0 and b > 0:
                    kind = kinds[row, column]
                    if (
                        kinds[row + north, column] == kind
                        and kinds[row, column + east] == kind
                        and kinds[row + north, column + east] == kind
                    ):
                        side = min(
                            squares[quadrant, row + north, column],
                            squares[quadrant, row, column + east],
                            squares[quadrant, row + north, column + east],
                        )
                squares[quadrant, row, column] = min(side, MAX_SIDE - 1) + 1
