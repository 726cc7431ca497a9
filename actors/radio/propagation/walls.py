"""What walls cost: the straight line between two antennas, followed over the floor plan."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.traversal import Ray, cell_after, ray, square_at
from actors.kernels import njit
from actors.radio.propagation.materials import Material, material
from actors.radio.propagation.tiles import TILE, Tiles, tiles_of

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

    tiles: Tiles
    """Where which material is; 0 is air."""
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
        tiles_of(kinds),
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
def _within(line: Ray, blocks: NDArray[np.uint8], k: int, left: int, bottom: int) -> tuple[float, float]:
    """Where a ray that goes east enters and leaves a block of the tile with that corner; all in tiles."""
    low, high = bottom + blocks[k, 1] / TILE, bottom + blocks[k, 3] / TILE
    if line.dy < 0:
        low, high = high, low
    enters = max((left + blocks[k, 0] / TILE - line.x) * line.per_x, (low - line.y) * line.per_y)
    leaves = min((left + blocks[k, 2] / TILE - line.x) * line.per_x, (high - line.y) * line.per_y)
    return enters, leaves


@njit(cache=True)  # type: ignore[untyped-decorator]
def _along(
    leaps: NDArray[np.uint8],
    begins: NDArray[np.int32],
    blocks: NDArray[np.uint8],
    crossing_db: Floats,
    per_tile_db: Floats,
    x: float,
    y: float,
    dx: float,
    dy: float,
    length: float,
    most_db: float,
) -> float:
    """The loss, dB, from (x, y) along the unit vector (dx, dy), dx ≥ 0, in tiles; inf if above most_db."""
    southward = 0 if dy >= 0 else 1
    rows, columns = leaps.shape[1:]
    at, last = _clipped(x, dx, columns, 0.0, length)
    at, last = _clipped(y, dy, rows, at, last)
    line = ray(x, y, dx, dy)
    column = min(max(math.floor(x + at * dx), 0), columns - 1)
    row = min(max(math.floor(y + at * dy), 0), rows - 1)
    loss, before, until = 0.0, 0, at
    while at < last and 0 <= column < columns and 0 <= row < rows:
        side = int(leaps[southward, row, column])
        square = square_at(line, column, row, max(side, 1))
        border = min(square.to_x, square.to_y, last)
        tile = row * columns + column
        while side == 0:
            first, end, kind, met = border, border, 0, 0
            for k in range(begins[tile], begins[tile + 1]):
                enters, leaves = _within(line, blocks, k, column, row)
                enters, leaves = max(enters, at), min(leaves, border)
                met += enters < leaves
                if enters < leaves and enters < first:
                    first, end, kind = enters, leaves, int(blocks[k, 4])
            if met == 0:
                break
            if kind != before or first > until:
                loss += crossing_db[kind]
            loss += (end - first) * per_tile_db[kind]
            if loss > most_db:
                return math.inf
            before, until, at = kind, end, end
            if met == 1:
                break
        at = max(border, at)
        column, row = cell_after(line, square, at)
    return loss


@njit(cache=True)  # type: ignore[untyped-decorator]
def between(
    leaps: NDArray[np.uint8],
    begins: NDArray[np.int32],
    blocks: NDArray[np.uint8],
    crossing_db: Floats,
    per_tile_db: Floats,
    x0: float,
    y0: float,
    x1: float,
    y1: float,
    most_db: float,
) -> float:
    """The loss by walls, dB, between two places, in tiles from the map's corner; inf if above most_db.

    The same, to the last bit, in both directions. leaps … blocks: the fields of `Tiles`.
    """
    if x1 < x0 or (x1 == x0 and y1 < y0):
        x0, y0, x1, y1 = x1, y1, x0, y0
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    loss: float = _along(
        leaps, begins, blocks, crossing_db, per_tile_db, x0, y0, dx / length, dy / length, length, most_db
    )
    return loss
