"""Costs near what is lethal, as the formulas of costmap_2d give them."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.robot.cost_maps import footprint
from actors.robot.cost_maps.inflation import INSCRIBED, LETHAL, Inflation, fingerprint

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


def outline(radius: float, padding: float) -> list[complex]:
    """The corners as costmap_2d makes and pads them, with the sines and cosines of the C library."""

    def padded(value: float) -> float:
        return value + math.copysign(padding, value) if value else 0.0

    corners = (math.tau * k / 16 for k in range(16))
    return [complex(padded(radius * math.cos(a)), padded(radius * math.sin(a))) for a in corners]


@pytest.mark.parametrize("radius", [0.1, 0.18, 0.5])
@pytest.mark.parametrize("padding", [0.0, 0.01, 0.1])
def test_the_inscribed_radius_is_that_of_the_padded_outline(radius: float, padding: float) -> None:
    corners = outline(radius, padding)
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    distances = [(a.conjugate() * b).imag / abs(b - a) for a, b in sides]
    assert footprint.inscribed(radius, padding) == pytest.approx(min(distances))


def test_the_inscribed_radius_of_the_chapters_files() -> None:
    assert footprint.inscribed(0.18, 0.01) == pytest.approx(0.18626, abs=5e-6)
