"""Kernel: the point of a path to head for, in sight across floor that the body fits on."""

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

SEARCH: Final = 32
"""So many points of the path, from the last nearest one on, are looked at for the new nearest one: 2 m with
cells of 6 cm, many times what a robot drives in a step."""


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((40, 40))
    clearance = 0.05 * np.minimum(row, 39 - column) + 0.01
    clearance.setflags(write=False)  # as the ground's: this compiles the very variant that the robot calls
    way = np.column_stack((np.linspace(0.2, 1.7, 30), 0.4 + np.linspace(0, 1, 30) ** 2))
    frame = np.array([0.0, 0.0, 0.05])
    return np.array([aim(way, 0, x, 0.5, 0.5, clearance, frame, 0.2) for x in (0.2, 0.9)]).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def room(clearance: NDArray[np.float64], frame: NDArray[np.float64], x: float, y: float) -> float:
    """Clearance of the cell around a point, 0 outside."""
    row = math.floor((y - frame[1]) / frame[2])
    column = math.floor((x - frame[0]) / frame[2])
    if row < 0 or column < 0 or row >= clearance.shape[0] or column >= clearance.shape[1]:
        return 0.0
    return float(clearance[row, column])


@njit(cache=True)  # type: ignore[untyped-decorator]
def in_sight(
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    x: float,
    y: float,
    to_x: float,
    to_y: float,
    need: float,
) -> bool:
    """True if every sample of the line, one per half cell, has a clearance of at least `need`."""
    samples = int(math.hypot(to_x - x, to_y - y) / (0.5 * frame[2])) + 1
    for sample in range(1, samples + 1):
        part = sample / samples
        if room(clearance, frame, x + part * (to_x - x), y + part * (to_y - y)) < need:
            return False
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def aim(
    way: NDArray[np.float64],
    index: int,
    x: float,
    y: float,
    lookahead: float,
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    need: float,
) -> tuple[int, float, float]:
    """Index of the path's nearest point, and x, y of the point to head for, m.

    `way`: (n, 2), m; `index`: its nearest point the last time. `clearance`: (rows, columns), m, on a grid
    whose corner and cell are `frame`: x, y, side, m. Headed for is the farthest point within `lookahead`, m,
    to which the line has a clearance of at least `need`, m, or of what the robot has where it is, if that is
    less; without one, the point after the nearest.
    """
    nearest = index
    least = math.inf
    for i in range(index, min(index + SEARCH, way.shape[0])):
        apart = math.hypot(way[i, 0] - x, way[i, 1] - y)
        if apart < least:
            least, nearest = apart, i
    need = min(need, room(clearance, frame, x, y))
    target = min(nearest + 1, way.shape[0] - 1)
    for i in range(target, way.shape[0]):
        if math.hypot(way[i, 0] - x, way[i, 1] - y) > lookahead:
            break
        if in_sight(clearance, frame, x, y, way[i, 0], way[i, 1], need):
            target = i
    return nearest, way[target, 0], way[target, 1]
