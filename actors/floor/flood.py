"""Connected regions of a grid: which cells can be reached from which, going east, north, west and south."""

import math

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import asin, atan2


def flood(passable: NDArray[np.bool_], row: int, column: int) -> NDArray[np.bool_]:
    """The 4-connected region of passable cells around one cell of the grid; empty if that is not passable."""
    region: NDArray[np.bool_] = _flood(np.ascontiguousarray(passable), row, column)
    return region


def largest_region(passable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The 4-connected region with the most cells, of equals the one that begins first in row order."""
    labels, largest = _regions(np.ascontiguousarray(passable))
    region: NDArray[np.bool_] = passable & (labels == largest)
    return region


def regions(passable: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(rows, columns): every passable cell's 4-connected region, counted from 1 in row order; 0 elsewhere."""
    labels: NDArray[np.int32] = _regions(np.ascontiguousarray(passable))[0]
    return labels


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((23, 31))
    passable = (row * 5 + column * column * 3) % 7 != 0
    return flood(passable, 11, 16).tobytes() + largest_region(passable).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _spread(
    passable: NDArray[np.bool_], labels: NDArray[np.int32], queue: NDArray[np.int64], start: int, label: int
) -> int:
    """Give `label` to the unlabelled passable cells connected to the cell `start`; how many they are."""
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _flood(passable: NDArray[np.bool_], row: int, column: int) -> NDArray[np.bool_]:
    labels = np.zeros(passable.shape, np.int32)
    if passable[row, column]:
        queue = np.empty(passable.size, np.int64)
        _spread(passable, labels, queue, row * passable.shape[1] + column, 1)
    return labels > 0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _regions(passable: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Every cell's region, counted from 1 (0 = not passable), and which region is the largest."""
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def bearing_to(x: float, y: float, heading: float, first_angle: float) -> float:
    """The bearing of (x, y) counted from the first ray, in [0, 2π) rad; that lies at `first_angle` from
    `heading`, the sensor's."""
    bearing: float = atan2(y, x) - heading - first_angle
    return bearing - 2 * math.pi * math.floor(bearing / (2 * math.pi))


@njit(cache=True)  # type: ignore[untyped-decorator]
def half_width(apart: float, radius: float) -> float:
    """Half the angle under which a disc appears so far away, rad; from within it is all around."""
    half: float = asin(radius / apart) if apart > radius else math.pi
    return half


@njit(cache=True)  # type: ignore[untyped-decorator]
def window(bearing: float, half: float, turn: int, increment: float, rays: int) -> tuple[int, int]:
    """The rays that may meet it, from the first to before the last; see `bearing_to` and `half_width`.

    It may appear at both ends of the scan, so there are three windows, of the turns −1, 0 and 1. One ray more
    on both sides makes up for rounding.
    """
    low = (bearing + 2 * math.pi * turn - half) / increment
    high = (bearing + 2 * math.pi * turn + half) / increment
    return max(math.ceil(low) - 1, 0), min(math.floor(high) + 2, rays)
