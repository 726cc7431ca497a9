"""What walls cost: the straight line between two antennas, followed over the floor plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.traversal import cell_after, equal_squares, ray, square_at
from actors.kernels import njit
from actors.radio.propagation.materials import Material, material

Floats = NDArray[np.float64]
_AIR: Final = 0


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
    """`equal_squares` of `kinds`."""
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
        equal_squares(kinds),
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
def _clipped(start: float, slope: float, end: int, entry: float, leave: float) -> tuple[float, float]:
    """Where a ray is between 0 and `end` along one axis, and between `entry` and `leave`: distances from its
    start; entry ≥ leave: nowhere.

    Liang and Barsky, "A New Concept and Method for Line Clipping", ACM Transactions on Graphics 3, 1984.
    """
    if slope > 0:
        return max(entry, -start / slope), min(leave, (end - start) / slope)
    if slope < 0:
        return max(entry, (end - start) / slope), min(leave, -start / slope)
    return entry, leave if 0.0 <= start < end else -1.0


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
    most_db: float,
) -> float:
    """The loss, dB, from (x, y) along the unit vector (dx, dy), everything in cells; inf if above most_db."""
    rows, columns = kinds.shape
    at, last = _clipped(x, dx, columns, 0.0, length)
    at, last = _clipped(y, dy, rows, at, last)
    line = ray(x, y, dx, dy)
    column = min(max(math.floor(x + at * dx), 0), columns - 1)
    row = min(max(math.floor(y + at * dy), 0), rows - 1)
    loss, before = 0.0, 0
    while at < last and 0 <= column < columns and 0 <= row < rows:
        square = square_at(line, column, row, int(squares[line.quadrant, row, column]))
        kind = int(kinds[row, column])
        border = min(square.to_x, square.to_y, last)
        if kind != before:
            loss += crossing_db[kind]
            before = kind
        loss += max(border - at, 0.0) * per_cell_db[kind]
        if loss > most_db:
            return math.inf
        at = max(border, at)
        column, row = cell_after(line, square, at)
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
    most_db: float,
    loss_db: Floats,
) -> None:
    """Add the loss by walls between senders, (s, 2) m, and receivers, (r, 2) m, to loss_db, (s, r) dB.

    The same, to the last bit, in both directions; what comes to more than most_db may be any value above it.
    squares … per_metre_db: the fields of `Walls`.
    """
    per_cell_db = per_metre_db * resolution
    for i in range(senders.shape[0]):
        for j in range(receivers.shape[0]):
            if loss_db[i, j] > most_db:
                continue
            x0, y0 = (senders[i, 0] - west) / resolution, (senders[i, 1] - south) / resolution
            x1, y1 = (receivers[j, 0] - west) / resolution, (receivers[j, 1] - south) / resolution
            if x1 < x0 or (x1 == x0 and y1 < y0):
                x0, y0, x1, y1 = x1, y1, x0, y0
            dx, dy = x1 - x0, y1 - y0
            length = math.sqrt(dx * dx + dy * dy)
            if length > 0.0:
                loss_db[i, j] += _along(
                    squares, kinds, crossing_db, per_cell_db, x0, y0, dx / length, dy / length, length,
                    most_db - loss_db[i, j],
                )  # fmt: skip
