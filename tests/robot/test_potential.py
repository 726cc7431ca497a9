"""The planning kernels against a textbook Dijkstra, and what a way down must be like."""

import heapq
import itertools

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.robot.navigation.potential import UNREACHABLE, descent, potential

Costs = NDArray[np.int32]
SIDES = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if (down, right) != (0, 0)]


def neighbours(costs: Costs, row: int, column: int) -> list[tuple[int, int, int]]:
    """Row, column and cost of the steps from a cell, by the rules in the module's first lines."""
    found = []
    for down, right in SIDES:
        r, c = row + down, column + right
        if not (0 <= r < costs.shape[0] and 0 <= c < costs.shape[1]) or costs[r, c] == 0:
            continue
        if down and right and (costs[row, c] == 0 or costs[r, column] == 0):
            continue
        length = 7 if down and right else 5
        found.append((r, c, length * int(costs[row, column] + costs[r, c])))
    return found


def textbook(costs: Costs, goal: tuple[int, int]) -> Costs:
    """Dijkstra with a heap."""
    field = np.full(costs.shape, UNREACHABLE, np.int32)
    if costs[goal] == 0:
        return field
    field[goal] = 0
    queue = [(0, *goal)]
    while queue:
        distance, row, column = heapq.heappop(queue)
        if distance > field[row, column]:
            continue
        for r, c, cost in neighbours(costs, row, column):
            if distance + cost < field[r, c]:
                field[r, c] = distance + cost
                heapq.heappush(queue, (distance + cost, r, c))
    return field


maps = arrays(np.int32, st.tuples(st.integers(1, 14), st.integers(1, 14)), elements=st.integers(0, 30)).map(
    lambda values: np.where(values < 8, 0, values).astype(np.int32)
)


@settings(max_examples=150, deadline=None)
@given(costs=maps, data=st.data())
def test_the_potential_is_that_of_a_textbook_dijkstra(costs: Costs, data: st.DataObject) -> None:
    goal = (
        data.draw(st.integers(0, costs.shape[0] - 1)),
        data.draw(st.integers(0, costs.shape[1] - 1)),
    )
    if costs.max() == 0:
        costs[goal] = 1
    assert np.array_equal(potential(costs, *goal), textbook(costs, goal))


@settings(max_examples=100, deadline=None)
@given(costs=maps, data=st.data())
def test_the_way_down_takes_allowed_steps_and_ends_at_the_goal(costs: Costs, data: st.DataObject) -> None:
    passable = [(int(row), int(column)) for row, column in np.argwhere(costs > 0)]
    if not passable:
        return
    goal = data.draw(st.sampled_from(passable))
    field = potential(costs, *goal)
    start = data.draw(st.sampled_from([cell for cell in passable if field[cell] != UNREACHABLE]))
    cells = [(int(row), int(column)) for row, column in descent(costs, field, *start)]
    assert cells[0] == start and cells[-1] == goal
    for cell, following in itertools.pairwise(cells):
        assert following in [(r, c) for r, c, _ in neighbours(costs, *cell)]
        assert field[following] < field[cell]


def test_a_goal_that_is_not_passable_is_reached_from_nowhere() -> None:
    costs = np.ones((3, 3), np.int32)
    costs[1, 1] = 0
    assert (potential(costs, 1, 1) == UNREACHABLE).all()
