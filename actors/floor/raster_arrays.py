"""Raster algorithms on whole arrays, with the results of the kernels of `raster`.

They take less time than loading numba, for a command that calls no other kernel.
"""

from typing import Final

import numpy as np

from actors.array_types import Flags, Floats, Indices, Int32s

FAR: Final = 1 << 30
"""Squared distance of infinity; the sum with the square of a row's length fits 32 bits."""


def squared_distance(mask: Flags, limit: int = FAR) -> Floats:
    """Return squared distances between cell centres to the nearest True cell, cells²; inf without any.

    `mask` and result: (rows, columns). Distances are exact below `limit`, cells², and at least that beyond.
    """
    away = np.minimum(_rows_away(mask), 1 << 15)
    squared = _lowest(away * away, 1, limit)
    return np.where(squared >= FAR, np.inf, squared)


def squared_clearance(mask: Flags) -> Floats:
    """Return squared distances from cell centres to the nearest True cell's closed square, half cells².

    `mask` and result: (rows, columns); the cells at the border are True.
    """
    half_cells = np.maximum(2 * _rows_away(mask) - 1, 0)
    return _lowest(half_cells * half_cells, 2, FAR).astype(np.float64)


def _rows_away(mask: Flags) -> Int32s:
    """Return each cell's distance to the nearest True cell of its column, rows; large without any."""
    row = np.arange(len(mask), dtype=np.int32)[:, None]
    before = np.maximum.accumulate(np.where(mask, row, np.int32(-FAR // 2)), axis=0)
    after = np.minimum.accumulate(np.where(mask, row, np.int32(FAR // 2))[::-1], axis=0)[::-1]
    away: Int32s = np.minimum(row - before, after - row)
    return away


def _lowest(heights: Int32s, side: int, limit: int) -> Int32s:
    """Return the minimum along each row of the squared gap to a cell and that cell's height.

    `side`: of a cell; the gap is between centres if it is 1, from a centre to the other square if it is 2.
    """
    lowest = heights.copy()
    for apart in range(1, heights.shape[1]):
        gap = side * apart - side + 1
        squared = gap * gap
        if squared >= min(int(lowest.max()), limit):
            break
        raised = heights + np.int32(squared)
        np.minimum(lowest[:, apart:], raised[:, :-apart], out=lowest[:, apart:])
        np.minimum(lowest[:, :-apart], raised[:, apart:], out=lowest[:, :-apart])
    return lowest


def runs(flags: Flags) -> tuple[Indices, Indices, Indices]:
    """Return line, begin and end (exclusive) of each run of True along the rows of `flags`, in order."""
    ended = np.zeros((flags.shape[0], flags.shape[1] + 2), dtype=np.int8)
    ended[:, 1:-1] = flags
    change = np.diff(ended, axis=1)
    line, begin = np.nonzero(change == 1)
    _, end = np.nonzero(change == -1)
    return line, begin, end


def regions(passable: Flags) -> tuple[Int32s, int]:
    """Return each cell's 4-connected region, from 1 in row order (0 = not passable), and the (first) largest.

    1 if there is none. `passable` and regions: (rows, columns).
    """
    labels = np.zeros(passable.shape, np.int32)
    line, begin, end = runs(passable)
    if not line.size:
        return labels, 1
    length, width = end - begin, passable.shape[1] + 1
    above = (line + 1) * width
    first = np.searchsorted(line * width + end, above + begin, side="right")
    count = np.searchsorted(line * width + begin, above + end, side="left") - first
    below = np.repeat(np.arange(line.size), count)
    touching = np.arange(below.size) - np.repeat(np.cumsum(count) - count - first, count)
    _, number = np.unique(_first_connected(below, touching, line.size), return_inverse=True)
    labels[passable] = np.repeat(number + 1, length)
    return labels, int(np.argmax(np.bincount(number, weights=length))) + 1


def _first_connected(one: Indices, other: Indices, count: int) -> Indices:
    """Return the first node connected to each of `count` nodes by edges from `one` to `other`."""
    first = np.arange(count)
    while (apart := first[one] != first[other]).any():
        ends = first[one[apart]], first[other[apart]]
        np.minimum.at(first, np.maximum(*ends), np.minimum(*ends))
        while (nearer := first[first]).tobytes() != first.tobytes():
            first = nearer
    return first
