"""Distances on small grids against looking at every marked cell."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.robot.cell_distance import fingerprint, squared_within

grids = arrays(
    np.uint8, st.tuples(st.integers(1, 24), st.integers(1, 24)), elements=st.sampled_from([0] * 19 + [1])
)


def looked_up(marks: NDArray[np.uint8], reach: int) -> NDArray[np.int64]:
    """The distance to each marked cell in turn."""
    row, column = np.indices(marks.shape)
    least = np.full(marks.shape, (reach + 1) ** 2)
    for r, c in np.argwhere(marks):
        least = np.minimum(least, (row - r) ** 2 + (column - c) ** 2)
    return least


@settings(max_examples=200, deadline=None)
@given(marks=grids, reach=st.integers(1, 20))
def test_distances_are_exact_up_to_the_reach(marks: NDArray[np.uint8], reach: int) -> None:
    assert np.array_equal(squared_within(marks, reach), looked_up(marks, reach))


def test_the_largest_reach_does_not_overflow() -> None:
    marks = np.zeros((300, 300), np.uint8)
    marks[150, 150] = 1
    assert np.array_equal(squared_within(marks, 100), looked_up(marks, 100))


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
