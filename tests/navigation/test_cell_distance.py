"""Distances on small grids against looking at every marked cell."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.bounds import ParameterError
from actors.robot.cost_maps.cell_distance import MOST_REACH, fingerprint, squared_within
from actors.robot.cost_maps.cost_map import CostMap, CostMapParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, Planner, ground
from actors.robot_model import load_model
from tests.robot.base import TWO_ROOMS

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
    assert np.array_equal(squared_within(marks, MOST_REACH), looked_up(marks, MOST_REACH))
    marks[:] = 0
    assert (squared_within(marks, MOST_REACH) == (MOST_REACH + 1) ** 2).all()


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: CostMap(
                load_model("turtlebot2").sensor,
                0.177,
                CostMapParameters(body="disc", allowance=0.0, padding=7.0),
            ),
            "local_map: the radius of the body with its padding is 7.177, but must be at most 126 cells of "
            "0.05 m",
        ),
        (
            lambda: Planner(
                ground(TWO_ROOMS, 0.177), replace(PLANNER_PRESETS["robust"], inflation_radius=6.4)
            ),
            "planner: the reach of what is marked is 6.4, but must be at most 126 cells of 0.05 m",
        ),
    ],
    ids=["local map", "planner"],
)
def test_parameters_beyond_it_are_refused_at_the_start(make: Callable[[], object], sentence: str) -> None:
    with pytest.raises(ParameterError) as raised:
        make()
    assert str(raised.value) == sentence


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
