"""Costs near what is lethal, as the formulas of costmap_2d give them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.robot.navigation.inflation import INSCRIBED, LETHAL, Inflation, fingerprint

LOCAL = Inflation(0.222, 0.75, 15.0)


@pytest.mark.parametrize(
    ("distance", "cost"),
    [(0.0, LETHAL), (0.01, INSCRIBED), (0.222, INSCRIBED), (0.2221, 251), (0.322, 56), (0.75, 0), (0.8, 0)],
)
def test_costs_of_single_distances(distance: float, cost: int) -> None:
    assert LOCAL.costs(distance) == cost


def test_a_cost_at_the_inflation_radius_is_the_last() -> None:
    wide = Inflation(0.2, 0.5, 1.0)
    assert wide.costs([0.5, 0.5001]).tolist() == [int(252 * math.exp(-0.3)), 0]


@given(st.lists(st.floats(0, 3), min_size=2, max_size=20))
def test_the_cost_never_rises_with_the_distance(distances: list[float]) -> None:
    costs = LOCAL.costs(sorted(distances)).astype(int)
    assert (np.diff(costs) <= 0).all()


@pytest.mark.parametrize("cell", [0.05, 0.04, 0.1])
def test_the_table_gives_the_cost_of_every_distance_between_cells(cell: float) -> None:
    table = LOCAL.table(cell)
    reach = LOCAL.reach(cell)
    assert reach * cell >= 0.75 > (reach - 1) * cell
    for rows in range(reach + 1):
        for columns in range(reach + 1):
            squared = min(rows**2 + columns**2, len(table) - 1)
            assert table[squared] == LOCAL.costs(cell * math.hypot(rows, columns))


def test_a_table_cannot_be_changed_and_is_the_same_each_time() -> None:
    with pytest.raises(ValueError, match="read-only"):
        LOCAL.table(0.05)[0] = 1
    assert fingerprint() == fingerprint()
