"""The kernels of navfn: what a potential and a way down it must be like."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.floor import flood
from actors.robot.navigation.navfn_potential import IMPASSABLE, UNREACHED, fingerprint, wave, way_down

Costs = NDArray[np.uint8]


def closed(costs: Costs) -> Costs:
    costs = costs.copy()
    costs[[0, -1]] = costs[:, [0, -1]] = IMPASSABLE
    return costs


def around(field: NDArray[np.float32], row: int, column: int) -> list[float]:
    """The potentials of the four neighbours."""
    return [float(field[row + up, column + right]) for up, right in ((0, 1), (1, 0), (0, -1), (-1, 0))]


maps = (
    arrays(
        np.uint8,
        st.tuples(st.integers(3, 16), st.integers(3, 16)),
        elements=st.integers(30, 283).map(lambda v: min(v, 254)),
    )
    .map(lambda costs: np.maximum(costs, 50))
    .map(closed)
)


@settings(max_examples=100, deadline=None)
@given(costs=maps, data=st.data())
def test_a_wave_comes_wherever_a_way_leads_and_every_cell_costs_about_a_step_more_than_the_one_before(
    costs: Costs, data: st.DataObject
) -> None:
    rows, columns = costs.shape
    root = data.draw(st.integers(1, rows - 2)), data.draw(st.integers(1, columns - 2))
    field = wave(costs, root, 50)
    passable = costs < IMPASSABLE
    passable[root] = True
    assert np.array_equal(field < UNREACHED, flood.flood(passable, *root))
    for row, column in np.argwhere(field < UNREACHED):
        if (row, column) == root:
            continue
        cost = float(costs[row, column])
        low = min(around(field, row, column))
        # from 0.704, where the front comes diagonally, to 1.0046, as the fit has it where it comes straight
        assert low + 0.7039 * cost <= field[row, column] <= low + 1.0047 * cost


@settings(max_examples=100, deadline=None)
@given(costs=maps, data=st.data())
def test_a_way_down_comes_from_every_cell_to_the_root(costs: Costs, data: st.DataObject) -> None:
    rows, columns = costs.shape
    root = data.draw(st.integers(1, rows - 2)), data.draw(st.integers(1, columns - 2))
    field = wave(costs, root, 50)
    reached = [(int(row), int(column)) for row, column in np.argwhere(field < UNREACHED)]
    cell = data.draw(st.sampled_from(reached))
    way = way_down(field, *cell, 50)
    assert tuple(way[0]) == cell and tuple(way[-1]) == root
    row, column = np.rint(way).astype(int).T
    assert (field[row, column] < UNREACHED).all()


def test_on_open_floor_a_potential_is_the_distance_and_a_way_is_straight() -> None:
    costs = closed(np.full((61, 61), 50, np.uint8))
    field = wave(costs, (30, 30), 50)
    row, column = np.indices(costs.shape)
    distance = np.hypot(row - 30, column - 30)
    far = (field < UNREACHED) & (distance > 10)
    assert field[far] / 50 == pytest.approx(distance[far], rel=0.1)
    way = way_down(field, 50, 40, 50)
    assert np.hypot(*np.diff(way, axis=0).T).sum() == pytest.approx(np.hypot(20, 10), rel=0.02)


def test_a_wave_ends_as_it_comes_to_a_cell() -> None:
    costs = closed(np.full((61, 61), 50, np.uint8))
    field = wave(costs, (30, 30), 50, (30, 40))
    assert field[30, 40] < UNREACHED
    assert (field < UNREACHED).sum() < (wave(costs, (30, 30), 50) < UNREACHED).sum() / 2


def test_a_way_longer_than_the_original_follows_is_followed_to_its_end() -> None:
    costs = closed(np.full((43, 12), 50, np.uint8))
    for wall in range(2, 41, 4):
        costs[wall, 1:-2] = costs[wall + 2, 2:-1] = IMPASSABLE
    way = way_down(wave(costs, (1, 1), 50), 41, 1, 50)
    assert tuple(way[-1]) == (1, 1) and len(way) > 4 * 12


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
