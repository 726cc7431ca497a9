"""The point to head for against the same rule in plain numpy."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.robot.aim import SEARCH, aim, fingerprint

FRAME = np.array([-1.0, 2.0, 0.1])
Array = NDArray[np.float64]


def room(clearance: Array, x: float, y: float) -> float:
    row, column = math.floor((y - FRAME[1]) / FRAME[2]), math.floor((x - FRAME[0]) / FRAME[2])
    inside = 0 <= row < clearance.shape[0] and 0 <= column < clearance.shape[1]
    return float(clearance[row, column]) if inside else 0.0


def plain(
    way: Array, index: int, x: float, y: float, lookahead: float, clearance: Array, need: float
) -> tuple[int, float, float]:
    apart = np.hypot(way[:, 0] - x, way[:, 1] - y)
    nearest = index + int(np.argmin(apart[index : index + SEARCH]))
    need = min(need, room(clearance, x, y))
    target = min(nearest + 1, len(way) - 1)
    beyond = [i for i in range(target, len(way)) if apart[i] > lookahead]
    for i in range(target, beyond[0] if beyond else len(way)):
        samples = int(math.hypot(way[i, 0] - x, way[i, 1] - y) / (0.5 * FRAME[2])) + 1
        parts = [k / samples for k in range(1, samples + 1)]
        line = [(x + part * (way[i, 0] - x), y + part * (way[i, 1] - y)) for part in parts]
        if all(room(clearance, *point) >= need for point in line):
            target = i
    return nearest, float(way[target, 0]), float(way[target, 1])


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32), index=st.integers(0, 39), length=st.integers(1, 80))
def test_the_kernel_follows_the_rule(seed: int, index: int, length: int) -> None:
    rng = np.random.default_rng(seed)
    clearance = rng.uniform(0.1, 1.0, (20, 30))
    way = np.cumsum(rng.uniform(-0.05, 0.08, (length, 2)), axis=0) + np.array([0.0, 3.0])
    x, y = way[min(index, length - 1)] + rng.normal(0, 0.1, 2)
    index = min(index, length - 1)
    found = aim(way, index, float(x), float(y), 0.4, clearance, FRAME, 0.3)
    assert found == plain(way, index, float(x), float(y), 0.4, clearance, 0.3)


def test_a_corner_is_not_cut() -> None:
    clearance = np.ones((20, 20))
    clearance[3:, :8] = 0.1  # the inside of the corner
    east = [(FRAME[0] + 0.05 * i, FRAME[1] + 0.15) for i in range(20)]
    way = np.array(east + [(east[-1][0], FRAME[1] + 0.15 + 0.05 * i) for i in range(1, 20)])
    _, x, y = aim(way, 0, float(way[0, 0]), float(way[0, 1]), 1.6, clearance, FRAME, 0.3)
    assert (y - way[0, 1]) / (x - way[0, 0]) < 0.25
    assert x == east[-1][0]


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
