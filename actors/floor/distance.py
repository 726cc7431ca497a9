"""Exact Euclidean distances on a grid: how far every cell is from the nearest wall.

The lower envelope of parabolas of Felzenszwalb & Huttenlocher, "Distance Transforms of Sampled Functions",
Theory of Computing 8 (2012), algorithm 1. All squared distances are whole numbers, hence exact in float64.
"""

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit


def squared_distance(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Squared distance from every cell's centre to that of the nearest True cell, cells²; inf without any.

    `mask`: (rows, columns), and so is the result.
    """
    squared: NDArray[np.float64] = _squared_distance(np.ascontiguousarray(mask))
    return squared


def clearance(blocking: NDArray[np.bool_], resolution: float) -> NDArray[np.float64]:
    """Distance from the centre of every cell that does not block to the nearest point that does, m.

    `blocking`: (rows, columns), and so is the result; `resolution`: a cell's side, m. Blocking cells count as
    closed squares and have 0, and everything outside the map blocks: a free cell beside a wall has half a
    cell of clearance. Exact.
    """
    rows, columns = blocking.shape
    ringed = np.ones((rows + 2, columns + 2), dtype=np.bool_)
    ringed[1:-1, 1:-1] = blocking
    half_cells: NDArray[np.float64] = np.sqrt(_squared_clearance(ringed)[1:-1, 1:-1])
    return half_cells * (resolution / 2)


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((23, 31))
    mask = (row * 7 + column * column * 3) % 37 == 0
    outputs = squared_distance(mask), np.sqrt(_squared_clearance(mask))
    return b"".join(output.tobytes() for output in outputs)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _rows_away(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """How many rows each cell is from the nearest True cell of its column; inf without any."""
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _envelope(
    heights: NDArray[np.float64],
    apex: NDArray[np.int64],
    begin: NDArray[np.float64],
    lowest: NDArray[np.float64],
) -> None:
    """Fill `lowest[q]` with the minimum over all p of (q − p)² + heights[p].

    `apex` and `begin` are scratch of the same length: which parabolas are lowest, and from where on.
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _squared_distance(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    away = _rows_away(mask)
    rows, columns = mask.shape
    apex = np.empty(columns, np.int64)
    begin = np.empty(columns)
    squared = np.empty((rows, columns))
    for row in range(rows):
        _envelope(away[row] * away[row], apex, begin, squared[row])
    return squared


@njit(cache=True)  # type: ignore[untyped-decorator]
def _squared_clearance(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Squared distance from cell centres to the nearest point of any True cell's closed square, half cells².

    The nearest point of a square to a centre lies on the lattice of half cells: straight across, or at a
    corner. So each row becomes a line of 2·columns + 1 sites: cells at odd places, the lines between at even.
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
