"""Waves, plans and goals on the window's cells against plain twins."""

import itertools
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.robot.local_planning.map_grid import bearing, cut, detour, fingerprint, free_goal, wavefront

Squares = NDArray[np.int16]
squares = arrays(np.int16, st.tuples(st.integers(2, 16), st.integers(2, 16)), elements=st.integers(0, 9))


def cells(*pairs: tuple[int, int]) -> NDArray[np.int32]:
    return np.array(pairs, np.int32)


def searched(squared: Squares, limit: float, starts: NDArray[np.int32]) -> NDArray[np.int64]:
    """Breadth-first search; what it meets and may not enter counts as one step less than what it never
    meets."""
    steps = np.full(squared.shape, squared.size + 1)
    queue = deque((int(r), int(c)) for r, c in starts)
    for cell in queue:
        steps[cell] = 0
    while queue:
        row, column = queue.popleft()
        for r, c in ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1)):
            inside = 0 <= r < squared.shape[0] and 0 <= c < squared.shape[1]
            if not inside or steps[r, c] < squared.size:
                continue
            if squared[r, c] <= limit:
                steps[r, c] = squared.size
            elif steps[r, c] > squared.size:
                steps[r, c] = steps[row, column] + 1
                queue.append((r, c))
    return steps


@settings(max_examples=150, deadline=None)
@given(squared=squares, limit=st.sampled_from([2.5, 4.0]), data=st.data())
def test_waves_are_those_of_a_breadth_first_search(
    squared: Squares, limit: float, data: st.DataObject
) -> None:
    rows, columns = squared.shape
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1))
    starts = np.array(data.draw(st.lists(cell, min_size=1, max_size=5)), np.int32)
    assert np.array_equal(wavefront(squared, limit, starts), searched(squared, limit, starts))


def straight(
    way: NDArray[np.float64], body: tuple[float, float], side: int = 40
) -> tuple[int, bool, list[list[int]]]:
    """`cut` without any motion between the frames, cells of 0.1 m."""
    motion = np.array([1.0, 0.0, 0.0, 0.0, 10.0])
    nearest, ended, found = cut(way, 0, motion, np.array([*body, 0.0]), side, side / 2)
    return nearest, ended, found.tolist()


def test_a_plan_begins_where_it_is_nearest_and_has_no_gaps() -> None:
    way = np.array([[0.55, 2.05], [1.05, 2.05], [1.55, 2.05], [2.05, 2.35]])
    nearest, ended, found = straight(way, (10.0, 20.0))
    assert (nearest, ended) == (1, True)
    assert found[:6] == [[20, 10], [20, 11], [20, 12], [20, 13], [20, 14], [20, 15]]
    assert found[-1] == [23, 20]
    assert all(max(abs(a - c), abs(b - d)) == 1 for (a, b), (c, d) in itertools.pairwise(found))


def test_a_plan_is_cut_at_half_the_windows_side() -> None:
    way = np.column_stack((np.linspace(0.5, 9.0, 80), np.full(80, 2.05)))
    _, ended, found = straight(way, (8.0, 20.0))
    assert not ended
    assert found[-1] == [20, 27]


def test_a_plan_that_is_elsewhere_gives_no_cells() -> None:
    assert straight(np.array([[9.0, 9.0]]), (10.0, 20.0)) == (0, False, [])


@settings(max_examples=50, deadline=None)
@given(turn=st.floats(-3, 3), x=st.floats(-5, 5), y=st.floats(-5, 5))
def test_a_plan_is_the_same_whatever_frame_it_is_given_in(turn: float, x: float, y: float) -> None:
    way = np.column_stack((np.linspace(1.02, 3.03, 30), 1.53 + 0.4 * np.sin(np.linspace(0, 3, 30))))
    c, s = math.cos(turn), math.sin(turn)
    elsewhere = (way - [x, y]) @ np.array([[c, -s], [s, c]])
    body = np.array([14.0, 17.0, 0.0])
    here = cut(way, 0, np.array([1.0, 0.0, 0.0, 0.0, 10.0]), body, 40, 20.0)
    there = cut(elsewhere, 0, np.array([c, s, x, y, 10.0]), body, 40, 20.0)
    assert here[:2] == there[:2]
    assert np.abs(here[2][[0, -1]] - there[2][[0, -1]]).max() <= 1
    assert abs(len(here[2]) - len(there[2])) <= 3


def test_what_has_been_passed_stays_behind_and_the_plan_does_not_jump_to_where_it_comes_back() -> None:
    out = np.column_stack((np.linspace(0.5, 3.5, 61), np.full(61, 2.0)))
    back = np.column_stack((np.linspace(3.5, 0.5, 61), np.full(61, 2.2)))
    way = np.concatenate([out, back])
    motion = np.array([1.0, 0.0, 0.0, 0.0, 10.0])
    nearest, _, _ = cut(way, 0, motion, np.array([10.0, 21.9, 0.0]), 40, 20.0)
    assert nearest == 10
    nearest, _, _ = cut(way, 60, motion, np.array([34.0, 20.1, 0.0]), 40, 20.0)
    assert nearest >= 60


@settings(max_examples=150, deadline=None)
@given(squared=squares, slack=st.sampled_from([-1.0, 1.0, 2.9]), data=st.data())
def test_the_goal_is_the_plans_last_cell_or_one_that_does_instead(
    squared: Squares, slack: float, data: st.DataObject
) -> None:
    rows, columns = squared.shape
    cell = st.tuples(st.integers(0, rows - 1), st.integers(0, columns - 1))
    plan = np.array(data.draw(st.lists(cell, min_size=1, max_size=6)), np.int32)
    last = (int(plan[-1, 0]), int(plan[-1, 1]))
    goal = free_goal(squared, 4.5, plan, slack)
    if squared[last] > 4.5:
        assert goal == last
    elif slack < 0:
        free = [(int(r), int(c)) for r, c in plan if squared[r, c] > 4.5]
        assert goal == (free[-1] if free else last)
    else:
        row, column = np.indices(squared.shape)
        apart = np.hypot(row - last[0], column - last[1])
        apart[squared <= 4.5] = np.inf
        assert goal == last if apart.min() > slack else apart[goal] == apart.min()


def test_a_detour_is_what_a_way_is_longer_than_the_plan() -> None:
    squared = np.full((20, 20), 9, np.int16)
    squared[0:15, 10] = 0
    plan = cells(*((5, column) for column in range(2, 19)))
    steps = wavefront(squared, 4.0, cells((5, 18)))
    assert detour(steps, plan, np.array([2.5, 5.5, 0.0])) == 20
    assert detour(wavefront(squared, 9.0, cells((5, 18))), plan, np.array([2.5, 5.5, 0.0])) == 0


@settings(max_examples=50)
@given(angle=st.floats(-3.1, 3.1), heading=st.floats(-3.1, 3.1))
def test_the_bearing_is_that_of_the_plan_ahead(angle: float, heading: float) -> None:
    assume(abs(abs(math.remainder(angle - heading, math.tau)) - math.pi) > 0.2)
    distances = np.arange(1, 18)
    plan = np.column_stack((20 + distances * math.sin(angle), 20 + distances * math.cos(angle))).astype(
        np.int32
    )
    squared, body = np.full((40, 40), 9, np.int16), np.array([20.5, 20.5, heading])
    seen = bearing(squared, 4.5, plan, body, 10.0)
    assert seen == pytest.approx(math.remainder(angle - heading, math.tau), abs=0.16)
    squared[plan[5, 0], plan[5, 1]] = 4
    assert bearing(squared, 4.5, plan, body, 10.0) == 0.0


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
