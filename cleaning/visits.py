"""Kernel that finds the places within reach of robots."""

import numpy as np

from actors.array_types import Floats, Int64s
from actors.kernels import kernel


def fingerprint() -> bytes:
    """Return the kernel's output for fixed inputs, which reveals differences of processors and compilers."""
    places = np.array([[0.0, 0.0], [1.0, 0.5], [5.0, 5.0]])
    # a view, as in the world, so that the same variant is compiled
    positions = np.array([[1.1, 0.3, 0.0], [0.1, 0.2, 0.0], [1.0, 0.4, 0.0]])[:, :2]
    return find_visits(places, np.arange(3), positions, 0.5).tobytes()


@kernel
def find_visits(places: Floats, watched: Int64s, positions: Floats, reach: float) -> Int64s:
    """Return (k, 2): indices of each visited place and of the first robot less than `reach` away from it.

    places (m, 2) and positions (n, 2), m; watched (w,): indices of the places to check, in order.
    """
    found = np.empty((watched.size, 2), np.int64)
    count = 0
    for number in watched:
        for robot in range(positions.shape[0]):
            dx = places[number, 0] - positions[robot, 0]
            dy = places[number, 1] - positions[robot, 1]
            if dx * dx + dy * dy < reach * reach:
                found[count, 0], found[count, 1] = number, robot
                count += 1
                break
    return found[:count].copy()
