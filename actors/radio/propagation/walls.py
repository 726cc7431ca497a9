"""What walls cost: the straight line between two antennas, followed over the floor plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.radio.propagation.materials import Material, material

Floats = NDArray[np.float64]
_AIR: Final = 0
_MOST_SIDE: Final = 255


@dataclass(frozen=True)
class WallPatch:
    """A rectangle of the floor in which what is occupied is of a material of its own."""

    material: str
    """Name, see `materials.MATERIALS`."""
    x: tuple[float, float]
    """From west to east, m."""
    y: tuple[float, float]
    """From south to north, m."""


@dataclass(frozen=True, eq=False)
class Walls:
    """The floor plan as the wave sees it; made by `build`."""

    squares: NDArray[np.uint8]
    """`uniform_squares` of `kinds`."""
    kinds: NDArray[np.uint8]
    """(rows, columns): which material; 0 is air."""
    resolution: float
    """Side of a cell, m."""
    west: float
    south: float
    """The map's corner, m."""
    crossing_db: Floats
    """(materials,): loss of each wall that is entered, dB."""
    per_metre_db: Floats
    """(materials,): loss of each metre in it, dB."""


def build(grid: OccupancyGrid, everywhere: str, patches: Sequence[WallPatch] = ()) -> Walls:
    """The walls of a floor plan: occupied cells are of `everywhere`, in a patch of its material.

    Where patches overlap the last one counts.
    What is unknown costs nothing: maps know the faces of thick walls only, and what lies between rooms is
    mostly not wall. Nor does anything outside of the map. AcrcError if a material is unknown.
    """
    names = list(dict.fromkeys(["air", everywhere, *(patch.material for patch in patches)]))
    stuff: list[Material] = [material(name) for name in names]
    kinds = np.where(grid.cells == OCCUPIED, names.index(everywhere), _AIR).astype(np.uint8)
    for patch in patches:
        kinds[inside(grid, patch) & (grid.cells == OCCUPIED)] = names.index(patch.material)
    return Walls(
        uniform_squares(kinds),
        kinds,
        grid.resolution,
        grid.origin.x,
        grid.origin.y,
        np.array([one.crossing_db for one in stuff]),
        np.array([one.per_metre_db for one in stuff]),
    )


def inside(grid: OccupancyGrid, patch: WallPatch) -> NDArray[np.bool_]:
    """(rows, columns): which cells have their middle in the patch."""
    x, y = grid.centres()
    rows = (patch.y[0] <= y) & (y <= patch.y[1])
    return rows[:, None] & (patch.x[0] <= x) & (x <= patch.x[1])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _uniform_squares(kinds: NDArray[np.uint8], squares: NDArray[np.uint8]) -> None:
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
                squares[quadrant, row, column] = min(side, _MOST_SIDE - 1) + 1


def uniform_squares(kinds: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """How far a ray may leap: (4, rows, columns) for (rows, columns) of materials.

    For each cell and each quadrant of directions (bit 0 set: westward, bit 1 set: southward) the side, in
    cells, of the largest square of one material that has the cell in its near corner; 255 at most.
    """
    squares = np.empty((4, *kinds.shape), np.uint8)
    _uniform_squares(kinds, squares)
    return squares


@njit(cache=True)  # type: ignore[untyped-decorator]
def _clipped(x: float, y: float, dx: float, dy: float, length: float, columns: int, rows: int) -> Floats:
    """Where the ray enters and leaves the map, distances from its start; entry ≥ exit: never in it.

    Liang and Barsky, "A New Concept and Method for Line Clipping", ACM Transactions on Graphics 3, 1984.
    """
    span = np.array([0.0, length])
    for start, slope, end in ((x, dx, columns), (y, dy, rows)):
        if slope > 0:
            span[0], span[1] = max(span[0], -start / slope), min(span[1], (end - start) / slope)
        elif slope < 0:
            span[0], span[1] = max(span[0], (end - start) / slope), min(span[1], -start / slope)
        elif not 0.0 <= start < end:
            span[1] = -1.0
    return span


@njit(cache=True)  # type: ignore[untyped-decorator]
def _along(
    squares: NDArray[np.uint8],
    kinds: NDArray[np.uint8],
    crossing_db: Floats,
    per_cell_db: Floats,
    x: float,
    y: float,
    dx: float,
    dy: float,
    length: float,
) -> float:
    """The loss, dB, from (x, y) along the unit vector (dx, dy), everything in cells.

    The traversal of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics
    1987, but from border to border of squares of one material, not cells.
    """
    rows, columns = kinds.shape
    span = _clipped(x, y, dx, dy, length, columns, rows)
    at, last = span[0], span[1]
    east, north = dx >= 0, dy >= 0
    quadrant = (0 if east else 1) + (0 if north else 2)
    per_x = 1 / dx if dx != 0 else 1e300
    per_y = 1 / dy if dy != 0 else 1e300
    column = min(max(math.floor(x + at * dx), 0), columns - 1)
    row = min(max(math.floor(y + at * dy), 0), rows - 1)
    loss, before = 0.0, 0
    while at < last and 0 <= column < columns and 0 <= row < rows:
        side = int(squares[quadrant, row, column])
        kind = int(kinds[row, column])
        left = column if east else column - side + 1
        bottom = row if north else row - side + 1
        border_x = left + side if east else left
        border_y = bottom + side if north else bottom
        to_x, to_y = (border_x - x) * per_x, (border_y - y) * per_y
        border = min(to_x, to_y, last)
        if kind != before:
            loss += crossing_db[kind]
            before = kind
        loss += max(border - at, 0.0) * per_cell_db[kind]
        at = max(border, at)
        # Rounding must not carry the ray out of the square anywhere but through the border that it meets.
        if to_x < to_y:
            column = border_x if east else border_x - 1
            row = min(max(int(y + at * dy), bottom), bottom + side - 1)
        else:
            row = border_y if north else border_y - 1
            column = min(max(int(x + at * dx), left), left + side - 1)
    return loss


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_walls(
    squares: NDArray[np.uint8],
    kinds: NDArray[np.uint8],
    resolution: float,
    west: float,
    south: float,
    crossing_db: Floats,
    per_metre_db: Floats,
    senders: Floats,
    receivers: Floats,
    loss_db: Floats,
) -> None:
    """Add the loss by walls between senders, (s, 2) m, and receivers, (r, 2) m, to loss_db, (s, r) dB.

    The same, to the last bit, in both directions. squares … per_metre_db: the fields of `Walls`.
    """
    per_cell_db = per_metre_db * resolution
    for i in range(senders.shape[0]):
        for j in range(receivers.shape[0]):
            x0, y0 = (senders[i, 0] - west) / resolution, (senders[i, 1] - south) / resolution
            x1, y1 = (receivers[j, 0] - west) / resolution, (receivers[j, 1] - south) / resolution
            if x1 < x0 or (x1 == x0 and y1 < y0):
                x0, y0, x1, y1 = x1, y1, x0, y0
            dx, dy = x1 - x0, y1 - y0
            length = math.sqrt(dx * dx + dy * dy)
            if length > 0.0:
                loss_db[i, j] += _along(
                    squares, kinds, crossing_db, per_cell_db, x0, y0, dx / length, dy / length, length
                )
