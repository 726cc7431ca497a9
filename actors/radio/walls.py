"""Loss by walls along the straight line between two antennas on a floor plan.

The loss of a wall at 2.45 GHz depends on its material. The table of ITU-R P.2040-3 has permittivity and
conductivity, from which follow, at perpendicular incidence, the reflection at both faces and the absorption
per metre. In addition there are the wall types of COST 231, whose loss does not depend on the thickness.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Final, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from actors.array_types import Flags, Floats, Int32s, Octets
from actors.floor.grid import OCCUPIED, OccupancyGrid
from actors.floor.raster import Ray, cell_after, equal_squares, ray, square_at
from actors.kernels import kernel
from actors.portable import exp, log, log10
from actors.runtime.errors import AcrcError
from actors.settings import Settings, Span, check_spans

_GHZ: Final = 2.45
"""Centre of the band, channels 11 to 26."""


class Material(msgspec.Struct, frozen=True):
    """Loss of signals through walls of a material."""

    crossing_db: float
    """Loss of each wall that is entered, dB, whatever its thickness."""
    per_metre_db: float
    """Loss per metre inside, dB."""


def dielectric(permittivity: float, conductivity: float, growth: float) -> Material:
    """Return a material of real relative permittivity and conductivity · GHz^growth, S/m, at 2.45 GHz.

    Faces: Fresnel reflection at perpendicular incidence, twice, without multiple internal reflections.
    Absorption: 1636 σ / √η' dB/m, for low losses (ITU-R P.2040-3, section 2.1, table 3).
    """
    index = math.sqrt(permittivity)
    reflected = (index - 1.0) / (index + 1.0)
    face = 1.0 - reflected * reflected
    growing = exp(growth * log(_GHZ))
    return Material(-20.0 * log10(face), 1636.0 * conductivity * growing / index)


MATERIALS: Final = {
    "air": Material(0.0, 0.0),
    "concrete": dielectric(5.24, 0.0462, 0.7822),
    "brick": dielectric(3.91, 0.0238, 0.16),
    "plasterboard": dielectric(2.73, 0.0085, 0.9395),
    "wood": dielectric(1.99, 0.0047, 1.0718),
    "chipboard": dielectric(2.58, 0.0217, 0.78),
    "glass": dielectric(6.31, 0.0036, 1.3394),
    "metal": Material(20.0, 0.0),
    "light_wall": Material(3.4, 0.0),
    "heavy_wall": Material(6.9, 0.0),
    "inet_brick": Material(0.6, 0.0),
}
"""Materials by name. `metal`: own choice; as nothing passes, the value represents indirect paths, as measured
at doors. `light_wall` and `heavy_wall`: thin walls without load, and thick or load-bearing ones of brick or
concrete (COST 231, final report, chapter 4, multi-wall model, fitted at 1800 MHz). `inet_brick`: INET 3.1.1's
brick of resistivity 3 kΩm and permittivity 4.5, the walls of d3scomp/ROSOMNeT: reflection at the first face
and hardly any absorption (TracingObstacleLoss, which omits the second face)."""


def material(name: str) -> Material:
    """Return the material of this name. Raises AcrcError for an unknown one."""
    if name not in MATERIALS:
        raise AcrcError(f"Wall material {name!r} is unknown; known are {', '.join(MATERIALS)}.")
    return MATERIALS[name]


TILE: Final = 16
"""Side of a tile, cells."""


class Walls(NamedTuple):
    """Floor plan of kinds of cells, 0 of which is air; made by `walls_of`."""

    leaps: Octets
    """Side, in tiles, of the largest square of air tiles with the tile in its near corner, (2, rows,
    columns), for rays going east and north, and east and south; 0: the tile has walls."""
    begins: Int32s
    """Index of each tile's first block, (rows · columns + 1,); the blocks end at the next tile's first."""
    blocks: Octets
    """Rectangles of one kind, without overlap, (blocks, 5): first column and row within the tile, last ones
    (exclusive), and kind."""
    resolution: float
    """Side of a cell, m."""
    west: float
    south: float
    """The map's corner, m."""
    crossing_db: Floats
    """Loss of each wall that is entered, (kinds,), dB."""
    per_metre_db: Floats
    """Loss per metre inside, (kinds,), dB."""


def walls_of(
    kinds: Octets,
    resolution: float,
    west: float,
    south: float,
    crossing_db: Floats,
    per_metre_db: Floats,
) -> Walls:
    """Return the walls of (rows, columns) of kinds; outside everything is air."""
    rows, columns = (-(-size // TILE) for size in kinds.shape)
    begins = np.zeros(rows * columns + 1, np.int32)
    _find_blocks(kinds, columns, begins, np.zeros((0, 5), np.uint8))
    blocks = np.zeros((int(begins[-1]), 5), np.uint8)
    _find_blocks(kinds, columns, begins, blocks)
    walled = (np.diff(begins) > 0).reshape(rows, columns)
    leaps = equal_squares(walled.astype(np.uint8))[::2].copy()
    leaps[:, walled] = 0
    losses = crossing_db, per_metre_db
    return Walls(leaps, begins, blocks, resolution, west, south, *losses)


@kernel
def _find_blocks(kinds: Octets, columns: int, begins: Int32s, blocks: Octets) -> None:
    """Write the number of blocks of all tiles, and the blocks as far as there is room.

    Blocks are grown greedily: from each free cell eastward along its kind, then northward.
    """
    found = 0
    for tile in range(begins.size - 1):
        south, west = tile // columns * TILE, tile % columns * TILE
        part = kinds[south : south + TILE, west : west + TILE].copy()
        for row in range(part.shape[0]):
            for column in range(part.shape[1]):
                kind = part[row, column]
                if kind == 0:
                    continue
                right, top = column + 1, row + 1
                while right < part.shape[1] and part[row, right] == kind:
                    right += 1
                while top < part.shape[0] and (part[top, column:right] == kind).all():
                    top += 1
                part[row:top, column:right] = 0
                if found < blocks.shape[0]:
                    block = blocks[found]
                    block[0], block[1], block[2], block[3], block[4] = column, row, right, top, kind
                found += 1
        begins[tile + 1] = found


MaterialName = Annotated[
    str,
    Meta(
        pattern=rf"\A({'|'.join(MATERIALS)})\Z",
        description="a material: " + ", ".join(f'"{name}"' for name in MATERIALS),
    ),
]


class WallPatch(Settings, frozen=True):
    """A rectangle of the floor whose walls are of another material."""

    material: MaterialName
    """Name, see `MATERIALS`."""
    x: Span
    """Range from west to east, m."""
    y: Span
    """Range from south to north, m."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_spans(self, "x", "y")


def build(grid: OccupancyGrid, everywhere: str, patches: Sequence[WallPatch] = ()) -> Walls:
    """Return the walls of a floor plan: occupied cells are of `everywhere`, in patches of their material.

    The last of overlapping patches counts. Unknown cells and everything outside the map cost nothing: maps
    contain only the faces of thick walls, and most unknown space between rooms is not wall. Raises AcrcError
    for an unknown material.
    """
    names = list(dict.fromkeys(["air", everywhere, *(patch.material for patch in patches)]))
    materials = [material(name) for name in names]
    kinds = np.where(grid.cells == OCCUPIED, names.index(everywhere), 0).astype(np.uint8)
    for patch in patches:
        kinds[cells_in(grid, patch) & (grid.cells == OCCUPIED)] = names.index(patch.material)
    crossing_db = np.array([one.crossing_db for one in materials])
    per_metre_db = np.array([one.per_metre_db for one in materials])
    return walls_of(kinds, grid.resolution, *grid.origin, crossing_db, per_metre_db)


def cells_in(grid: OccupancyGrid, patch: WallPatch) -> Flags:
    """Return which cells have their centre in the patch, (rows, columns)."""
    x, y = grid.centres()
    rows = (patch.y[0] <= y) & (y <= patch.y[1])
    return rows[:, None] & (patch.x[0] <= x) & (x <= patch.x[1])


@kernel
def _clipped(start: float, slope: float, end: int, entry: float, leave: float) -> tuple[float, float]:
    """Return where a ray is between 0 and `end` along one axis, within `entry` and `leave`.

    Distances from its start; entry ≥ leave: nowhere. Liang and Barsky, "A New Concept and Method for Line
    Clipping", ACM Transactions on Graphics 3, 1984.
    """
    if slope > 0:
        return max(entry, -start / slope), min(leave, (end - start) / slope)
    if slope < 0:
        return max(entry, (end - start) / slope), min(leave, -start / slope)
    return entry, leave if 0.0 <= start < end else -1.0


@kernel
def _block_span(line: Ray, blocks: Octets, k: int, left: int, bottom: int) -> tuple[float, float]:
    """Return where an eastward ray enters and leaves a block of the tile with this corner; all in tiles."""
    low, high = bottom + blocks[k, 1] / TILE, bottom + blocks[k, 3] / TILE
    if line.dy < 0:
        low, high = high, low
    enters = max((left + blocks[k, 0] / TILE - line.x) * line.per_x, (low - line.y) * line.per_y)
    leaves = min((left + blocks[k, 2] / TILE - line.x) * line.per_x, (high - line.y) * line.per_y)
    return enters, leaves


@kernel
def _loss_along(
    walls: Walls,
    per_tile_db: Floats,
    x: float,
    y: float,
    dx: float,
    dy: float,
    length: float,
    most_db: float,
) -> float:
    """Return the loss, dB, from (x, y) along the unit vector (dx, dy), dx ≥ 0, in tiles; inf above
    most_db."""
    leaps, begins, blocks = walls.leaps, walls.begins, walls.blocks
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
                enters, leaves = _block_span(line, blocks, k, column, row)
                enters, leaves = max(enters, at), min(leaves, border)
                met += enters < leaves
                if enters < leaves and enters < first:
                    first, end, kind = enters, leaves, int(blocks[k, 4])
            if met == 0:
                break
            if kind != before or first > until:
                loss += walls.crossing_db[kind]
            loss += (end - first) * per_tile_db[kind]
            if loss > most_db:
                return math.inf
            before, until, at = kind, end, end
            if met == 1:
                break
        at = max(border, at)
        column, row = cell_after(line, square, at)
    return loss


@kernel
def wall_loss(
    walls: Walls, per_tile_db: Floats, x0: float, y0: float, x1: float, y1: float, most_db: float
) -> float:
    """Return the loss by walls, dB, between two places, in tiles from the map's corner; inf above most_db.

    Bit-equal in both directions. per_tile_db: as `walls.per_metre_db`.
    """
    if x1 < x0 or (x1 == x0 and y1 < y0):
        x0, y0, x1, y1 = x1, y1, x0, y0
    dx, dy = x1 - x0, y1 - y0
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return 0.0
    return _loss_along(walls, per_tile_db, x0, y0, dx / length, dy / length, length, most_db)
