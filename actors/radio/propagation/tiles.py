"""A floor plan's walls as rectangles by tile: a line over a large floor stays within a processor's caches."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.traversal import equal_squares
from actors.kernels import njit

TILE: Final = 16
"""Side of a tile, cells."""


class Tiles(NamedTuple):
    """A floor plan of kinds of cells, 0 of which is air; made by `tiles_of`."""

    leaps: NDArray[np.uint8]
    """(2, rows, columns): side, in tiles, of the largest square of tiles of nothing but air that has the tile
    in its near corner, for rays that go east and north, and east and south; 0: the tile has walls."""
    begins: NDArray[np.int32]
    """(rows · columns + 1,): a tile's first block; the next tile's first is behind its last."""
    blocks: NDArray[np.uint8]
    """(blocks, 5): rectangles that do not overlap, all of one kind: first column and row within the tile,
    those behind the last, and which kind."""


def tiles_of(kinds: NDArray[np.uint8]) -> Tiles:
    """The tiles of (rows, columns) of kinds; beyond its edges everything is air."""
    rows, columns = (-(-size // TILE) for size in kinds.shape)
    begins = np.zeros(rows * columns + 1, np.int32)
    _find_blocks(kinds, columns, begins, np.zeros((0, 5), np.uint8))
    blocks = np.zeros((int(begins[-1]), 5), np.uint8)
    _find_blocks(kinds, columns, begins, blocks)
    walled = (np.diff(begins) > 0).reshape(rows, columns)
    leaps = equal_squares(walled.astype(np.uint8))[::2].copy()
    leaps[:, walled] = 0
    return Tiles(leaps, begins, blocks)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _find_blocks(
    kinds: NDArray[np.uint8], columns: int, begins: NDArray[np.int32], blocks: NDArray[np.uint8]
) -> None:
    """Write down how many blocks tiles have, and the blocks where there is room for them.

    From each cell that is not taken yet the run of its kind to the east, and the same run further north.
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
