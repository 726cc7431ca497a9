"""Kernel: exact Euclidean distances on a small grid, up to a reach.

As actors.floor.distance, first along columns, then along rows. There are two, since a local map is made anew
with every scan, and where no more than a few cells around matter, to look at all of them, many columns at a
time, is quicker than the lower envelope of parabolas: with 80 × 80 cells and a reach of 15 three times.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.bounds import ParameterError
from actors.kernels import njit

MOST_REACH: Final = 126
"""Cells; 2 (reach + 1)² must fit into int16."""


def squared_within(marks: NDArray[np.uint8], reach: int) -> NDArray[np.int16]:
    """Squared distance from every cell to the nearest marked one, cells², at most (reach + 1)²; exact.

    `marks`: (rows, columns), 0 where nothing is marked; the result has that shape. `reach`: 1 to MOST_REACH.
    """
    assert 1 <= reach <= MOST_REACH
    squared: NDArray[np.int16] = _squared_within(marks, reach)
    return squared


def check_reach(what: str, reach: float, cell: float) -> None:
    """Raise ParameterError if `reach`, m, is more cells of side `cell`, m, than distances are known for."""
    if reach > MOST_REACH * cell:
        raise ParameterError(what, reach, f"at most {MOST_REACH} cells of {cell:g} m")


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((40, 30))
    marks = ((row * 7 + column * column * 3) % 61 == 0).astype(np.uint8)
    squared, arrivals = squared_within(marks, 9), (column * 7 % 5).astype(np.int64)
    gaps: NDArray[np.float64] = half_gaps(squared, arrivals, 3, np.array([17.6, 16.4, 0.0]), 1.5, 4.0)
    return squared.tobytes() + gaps.tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _along_columns(marks: NDArray[np.uint8], reach: int) -> NDArray[np.int16]:
    """How many rows each cell is from the nearest marked one of its column, at most reach + 1."""
    away = np.empty(marks.shape, np.int16)
    far, one, zero = np.int16(reach + 1), np.int16(1), np.int16(0)
    before = np.full(marks.shape[1], far, np.int16)
    for row in range(marks.shape[0]):
        here, marked = away[row], marks[row]
        for column in range(marks.shape[1]):
            more = np.int16(before[column] + one)
            more = min(far, more)
            here[column] = zero if marked[column] else more
        before = here
    for row in range(marks.shape[0] - 2, -1, -1):
        here = away[row]
        for column in range(marks.shape[1]):
            more = np.int16(before[column] + one)
            here[column] = min(here[column], more)
        before = here
    return away


@njit(cache=True)  # type: ignore[untyped-decorator]
def _squared_within(marks: NDArray[np.uint8], reach: int) -> NDArray[np.int16]:
    rows, columns = marks.shape
    away = _along_columns(marks, reach)
    # one row with as many columns on both sides as a cell looks at: nothing is marked in them
    height = np.full(columns + 2 * reach, np.int16((reach + 1) * (reach + 1)), np.int16)
    squared = np.empty((rows, columns), np.int16)
    for row in range(rows):
        own, best = height[reach : reach + columns], squared[row]
        own[:] = away[row] * away[row]
        best[:] = own
        for aside in range(1, reach + 1):
            more = np.int16(aside * aside)
            left, right = height[reach - aside :], height[reach + aside :]
            for column in range(columns):
                near = np.int16(min(left[column], right[column]) + more)
                best[column] = min(best[column], near)
    return squared


@njit(cache=True)  # type: ignore[untyped-decorator]
def half_gaps(
    squared: NDArray[np.int16],
    arrivals: NDArray[np.int64],
    since: int,
    body: NDArray[np.float64],
    room: float,
    farthest: float,
) -> NDArray[np.float64]:
    """Return half of the gap to each moving mark where that is below `farthest`.

    (k, 3): the unit vector to the mark, and that half. The other half is left to what moves: two robots by
    this rule stop before they meet, wherever they go. `squared`: 0 in marked cells, of which those with
    `arrivals` from `since` on move. `body`: x and y. `room`: distance that the centre has to keep from marks.
    All lengths in cells.
    """
    reach = room + 2.0 * farthest
    bottom, top = max(int(body[1] - reach), 0), min(int(body[1] + reach) + 1, squared.shape[0])
    left, right = max(int(body[0] - reach), 0), min(int(body[0] + reach) + 1, squared.shape[1])
    bounds = np.empty((max(top - bottom, 0) * max(right - left, 0), 3))
    count = 0
    for row in range(bottom, top):
        for column in range(left, right):
            if squared[row, column] > 0 or arrivals[row, column] < since:
                continue
            x, y = column + 0.5 - body[0], row + 0.5 - body[1]
            apart = math.sqrt(x * x + y * y)
            half = max(apart - room, 0.0) / 2.0
            if apart > 0.0 and half < farthest:
                bounds[count, 0], bounds[count, 1], bounds[count, 2] = x / apart, y / apart, half
                count += 1
    return bounds[:count].copy()
