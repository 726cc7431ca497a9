"""Ways around what the floor plan does not show."""

import numpy as np
import pytest

from actors.geometry import Point
from actors.robot.navigation.planning import Planner, ground, occupied
from tests.robot.base import TWO_ROOMS

RADIUS = 0.177
FLOOR = ground(TWO_ROOMS, RADIUS)
START, GOAL = Point(1.0, 1.75), Point(8.0, 1.75)
DOOR = np.array([[4.7, 1.75], [4.75, 1.6], [4.75, 1.9]])  # of a robot that stands in it


def test_nothing_strange_leaves_the_costs_as_they_are() -> None:
    at_walls = np.array([[0.27, 1.0], [4.7, 3.0], [-3.0, 99.0]])
    assert occupied(FLOOR, at_walls) is FLOOR.costs
    assert occupied(FLOOR, np.empty((0, 2))) is FLOOR.costs


def test_the_body_keeps_clear_of_a_mark_and_pays_for_being_near() -> None:
    x, y = 2.525, 1.775  # the middle of a cell
    costs = occupied(FLOOR, np.array([[x, y]]))
    east, north = FLOOR.grid.centres()
    distance = np.hypot(east[None, :] - x, north[:, None] - y)
    passable = FLOOR.costs > 0
    assert not costs[distance < FLOOR.reach - 1e-9].any()
    assert np.array_equal(costs > 0, passable & (distance >= FLOOR.reach - 1e-9))
    near = passable & (distance >= FLOOR.reach) & (distance < 0.3)
    assert (costs[near] > FLOOR.costs[near]).all()
    far = distance > 0.55
    assert np.array_equal(costs[far], FLOOR.costs[far])


def test_a_way_leads_around_a_mark() -> None:
    planner = Planner(FLOOR)
    straight = planner.path(START, GOAL)
    mark = np.array([[2.5, 1.75]])
    around = planner.path(START, GOAL, mark)
    assert straight is not None and around is not None
    assert np.hypot(*(straight - mark).T).min() < 0.1
    assert np.hypot(*(around - mark).T).min() >= FLOOR.reach - FLOOR.grid.resolution


def test_a_door_that_is_taken_leaves_no_way_and_the_plan_is_back_when_it_is_free() -> None:
    planner = Planner(FLOOR)
    before = planner.path(START, GOAL)
    assert planner.path(START, GOAL, DOOR) is None
    after = planner.path(START, GOAL)
    assert before is not None and after is not None and np.array_equal(before, after)


def test_a_goal_on_a_mark_becomes_the_nearest_point_beside_it() -> None:
    way = Planner(FLOOR).path(START, GOAL, np.array([GOAL]))
    assert way is not None
    assert Point(*way[-1]).distance_to(GOAL) == pytest.approx(FLOOR.reach, abs=2 * FLOOR.grid.resolution)
