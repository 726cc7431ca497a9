"""Paths on small floor plans and on the original testbed's corridor, and backing out."""

import heapq
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace

from actors.array_types import Flags, Floats, Int32s
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, in_seconds
from actors.robot.behaviour import MAX_BACK_OUT, GoalOrder, GoalPhase
from actors.robot.behaviour.node_host import RobotNavigation
from actors.robot.navigation.navigator import Trail, reverse_velocity
from actors.robot.navigation.planning import (
    PLANNER_PRESETS,
    GridPlanner,
    PlanningGrid,
    narrowest_door,
    occupied,
    planning_grid,
)
from actors.robot.navigation.potential import UNREACHABLE, descent, potential
from actors.settings import ParameterError
from tests.robot.base import TWO_ROOMS, plan
from tests.robot.rig import FakeCostMap, FakeLocalPlanner, navigator

RADIUS = 0.177
FLOOR = planning_grid(TWO_ROOMS, RADIUS)
GRID = PLANNER_PRESETS["robust"]
CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


@pytest.fixture(scope="module")
def corridor() -> PlanningGrid:
    return planning_grid(load_map(CORRIDOR), RADIUS)


def least_clearance(floor: PlanningGrid, path: Floats) -> float:
    return float(min(floor.clearance[floor.grid.cell(Point(*point))] for point in path))


def test_a_path_has_no_gaps_and_leads_through_the_middle_of_a_door() -> None:
    path = GridPlanner(FLOOR).path(Point(1.0, 0.5), Point(9.0, 3.0))
    assert path is not None
    in_door = path[(path[:, 0] > 4.75) & (path[:, 0] < 5.0)]
    assert len(in_door) >= 4
    assert np.abs(in_door[:, 1] - 1.75).max() <= 0.075
    assert tuple(path[-1]) == (9.0, 3.0)
    assert np.hypot(path[0, 0] - 1.0, path[0, 1] - 0.5) <= 0.05
    assert np.hypot(*np.diff(path, axis=0).T).max() <= 0.05 * 2**0.5 + 0.05


def test_goals_and_starts_near_walls_are_replaced_by_free_points() -> None:
    path = GridPlanner(FLOOR).path(Point(1.0, 1.0), Point(0.1, 2.0))
    assert path is not None
    assert Point(*path[-1]).distance_to(Point(0.1, 2.0)) < 0.5
    assert least_clearance(FLOOR, path[-1:]) >= RADIUS
    path = GridPlanner(FLOOR).path(Point(0.25 + RADIUS, 1.0), Point(3.0, 1.0))
    assert path is not None
    assert Point(*path[0]).distance_to(Point(0.25 + RADIUS, 1.0)) < 0.1


@pytest.mark.parametrize("goal", [Point(-1.0, 1.0), Point(50.0, 50.0), Point(10.5, 2.0), Point(9.95, 3.5)])
def test_there_is_no_path_without_a_free_point_within_the_tolerance(goal: Point) -> None:
    assert GridPlanner(FLOOR).path(Point(1.0, 1.0), goal) is None
    assert GridPlanner(FLOOR).path(Point(-3.0, 1.0), Point(1.0, 1.0)) is None


def test_there_is_no_path_into_a_closed_room() -> None:
    closed = plan("#########\n#   #   #\n#   #   #\n#   #   #\n#########\n")
    planner = GridPlanner(planning_grid(closed, RADIUS))
    assert planner.path(Point(0.6, 0.6), Point(1.7, 0.6)) is None
    assert planner.path(Point(0.6, 0.6), Point(0.7, 0.7)) is not None
    assert planner.path(Point(1.6, 0.6), Point(1.7, 0.6)) is not None  # as after being moved by hand


def test_a_cached_potential_gives_the_same_path() -> None:
    goals = [Point(9.0, 0.5 + 0.3 * i) for i in range(6)]
    small = GridPlanner(FLOOR, replace(GRID, cached=2))
    for goal in [*goals, *goals[:3], goals[0]]:
        again, anew = small.path(Point(1.0, 1.0), goal), GridPlanner(FLOOR).path(Point(1.0, 1.0), goal)
        assert again is not None and anew is not None
        assert np.array_equal(again, anew)


def test_the_cache_of_potentials_has_the_documented_size() -> None:
    with pytest.raises(ParameterError):
        replace(GRID, cached_mb=0.0)
    for megabytes, kept in ((1e-9, 1), (2.5 * FLOOR.costs.nbytes / 1e6, 2), (100.0, 6)):
        planner = GridPlanner(FLOOR, replace(GRID, cached_mb=megabytes))
        for i in range(6):
            planner.path(Point(1.0, 1.0), Point(9.0, 0.5 + 0.3 * i))
        assert planner._field.cache_info().currsize == kept


@settings(max_examples=60, deadline=None)
@given(
    walls=arrays(
        np.bool_, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(0, 9).map(bool)
    ),
    resolution=st.sampled_from([0.02, 0.03125, 0.05]),
)
def test_a_coarse_grid_never_overestimates_clearance(walls: Flags, resolution: float) -> None:
    fine = OccupancyGrid(np.where(walls, FREE, OCCUPIED).astype(np.uint8), resolution, Point(1.0, -2.0))
    coarse = planning_grid(fine, 0.0)
    assert 0.05 <= coarse.grid.resolution < 0.0626
    assert coarse.grid.origin == fine.origin
    for row, column in np.ndindex(coarse.clearance.shape):
        promised = coarse.clearance[row, column]
        if promised > 0:
            centre = coarse.grid.centre(Cell(row, column))
            assert promised <= fine.clearance_at(centre, within=5.0) + 1e-9


@pytest.mark.parametrize("office", [12.44, 17.25])
def test_paths_through_passages_of_the_corridor_keep_to_the_middle(
    corridor: PlanningGrid, office: float
) -> None:
    path = GridPlanner(corridor).path(Point(office, 5.0), Point(9.0, 12.0))
    assert path is not None
    neck = path[(path[:, 1] > 8.4) & (path[:, 1] < 10.3)]
    assert np.abs(neck[:, 0] - office).max() < 0.1
    assert least_clearance(corridor, path) > 0.3


@pytest.mark.parametrize("resolution", [0.02, 0.025, 0.03125, 0.05, 0.1])
@pytest.mark.parametrize("closed", [0.0, 0.56])
def test_a_door_has_a_plan_from_the_narrowest_width_on(closed: float, resolution: float) -> None:
    parameters = replace(PLANNER_PRESETS["robust"], narrowest=closed)
    narrowest = round(narrowest_door(RADIUS, parameters, resolution) / resolution)
    planned = set()
    for width in range(narrowest - 3, narrowest + 2):
        side = round(1.6 / resolution)
        walls = np.ones((side + 4, 2 * side + 4 + round(0.2 / resolution)), np.bool_)
        walls[2:-2, 2 : side + 2] = walls[2:-2, -side - 2 : -2] = False
        first = side // 2 - width // 2
        walls[first : first + width, 2:-2] = False
        floor = OccupancyGrid(np.where(walls, OCCUPIED, FREE).astype(np.uint8), resolution)
        start, goal = Point(0.8, 0.8), Point(floor.columns * resolution - 0.8, 0.8)
        if GridPlanner(planning_grid(floor, RADIUS, parameters), parameters).path(start, goal) is not None:
            planned.add(width)
    assert {narrowest, narrowest + 1} <= planned
    assert not closed or planned == {narrowest, narrowest + 1}


SIDES = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if (down, right) != (0, 0)]


def neighbours(costs: Int32s, row: int, column: int) -> list[tuple[int, int, int]]:
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


def textbook(costs: Int32s, goal: tuple[int, int]) -> Int32s:
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
def test_the_potential_is_that_of_a_textbook_dijkstra(costs: Int32s, data: st.DataObject) -> None:
    goal = data.draw(st.tuples(*[st.integers(0, side - 1) for side in costs.shape]))
    if costs.max() == 0:
        costs[goal] = 1
    assert np.array_equal(potential(costs, *goal), textbook(costs, goal))


@settings(max_examples=100, deadline=None)
@given(costs=maps, data=st.data())
def test_the_descent_takes_allowed_steps_and_ends_at_the_goal(costs: Int32s, data: st.DataObject) -> None:
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


START, GOAL = Point(1.0, 1.75), Point(8.0, 1.75)
DOOR = np.array([[4.7, 1.75], [4.75, 1.6], [4.75, 1.9]])  # marks of a robot in the door


def test_without_obstacles_the_costs_are_unchanged() -> None:
    at_walls = np.array([[0.27, 1.0], [4.7, 3.0], [-3.0, 99.0]])
    assert occupied(FLOOR, at_walls) is FLOOR.costs
    assert occupied(FLOOR, np.empty((0, 2))) is FLOOR.costs


def test_cells_near_a_mark_are_occupied_or_cost_more() -> None:
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


def test_paths_lead_around_marks_which_may_close_a_door_or_move_the_goal() -> None:
    planner = GridPlanner(FLOOR)
    straight = planner.path(START, GOAL)
    mark = np.array([[2.5, 1.75]])
    around = planner.path(START, GOAL, mark)
    assert straight is not None and around is not None
    assert np.hypot(*(straight - mark).T).min() < 0.1
    assert np.hypot(*(around - mark).T).min() >= FLOOR.reach - FLOOR.grid.resolution
    assert planner.path(START, GOAL, DOOR) is None
    after = planner.path(START, GOAL)
    assert after is not None and np.array_equal(straight, after)
    path = GridPlanner(FLOOR).path(START, GOAL, np.array([GOAL]))
    assert path is not None
    assert Point(*path[-1]).distance_to(GOAL) == pytest.approx(FLOOR.reach, abs=2 * FLOOR.grid.resolution)


STEP_S = 0.1


class BackingOutRun:
    def __init__(self, pose: Pose) -> None:
        self.map = FakeCostMap()
        self.navigation = navigator(GridPlanner(FLOOR), self.map, FakeLocalPlanner())
        self.pose, self.step = pose, 0
        self.been: list[Point] = []

    def carried(self, *to: Pose) -> None:
        for pose in to:
            self.pose = pose
            self._sense()

    def steps(self, number: int) -> list[Twist]:
        twists = []
        for _ in range(number):
            self._sense()
            twist = self.navigation.advance(self._now, self.pose, self.pose, STILL)
            self.pose = self.pose.compose(Pose(twist.vx * STEP_S, 0.0, twist.omega * STEP_S))
            self.been.append(self.pose.point)
            twists.append(twist)
        return twists

    @property
    def _now(self) -> Instant:
        return Instant(self.step * 100_000)

    def _sense(self) -> None:
        self.step += 1
        self.navigation.sense(self._now, self.pose, None)


def bend() -> BackingOutRun:
    driven = BackingOutRun(Pose(1.0, 1.0, 0.0))
    driven.carried(*(Pose(1.0 + 0.05 * n, 1.0, 0.0) for n in range(21)))
    arc = [0.05 * n * math.pi / 2 for n in range(21)]
    driven.carried(*(Pose(2.0 + math.sin(a), 2.0 - math.cos(a), a) for a in arc))
    return driven


def test_it_backs_out_along_a_curved_trail_by_the_distance() -> None:
    driven = bend()
    driven.navigation.take(GoalOrder.KEEP, None, 2.0)
    assert driven.navigation.backing_out
    assert min(twist.vx for twist in driven.steps(150)) == -0.2
    assert not driven.navigation.backing_out and driven.steps(1) == [STILL]
    assert driven.pose.point.distance_to(Point(1.57, 1.0)) < 0.2
    for point in driven.been:
        off = abs(point.distance_to(Point(2.0, 2.0)) - 1.0) if point.x > 2.0 else abs(point.y - 1.0)
        assert off < 0.06


def test_backing_out_ends_with_the_trail_or_at_an_obstacle() -> None:
    driven = BackingOutRun(Pose(1.0, 1.0, 0.0))
    driven.carried(*(Pose(1.0 + 0.05 * n, 1.0, 0.0) for n in range(11)))
    driven.navigation.take(GoalOrder.KEEP, None, MAX_BACK_OUT)
    driven.steps(60)
    assert not driven.navigation.backing_out and 1.0 < driven.pose.x < 1.3
    driven = bend()
    driven.map.behind = False
    driven.navigation.take(GoalOrder.KEEP, None, 1.0)
    assert driven.steps(2) == [STILL, STILL] and not driven.navigation.backing_out


def test_a_goal_waits_while_retreating_and_a_stop_ends_it() -> None:
    driven = bend()
    driven.navigation.take(Point(8.0, 1.7), None, 0.5)
    driven.steps(2)
    goal = driven.navigation.goal
    assert goal is not None and goal.phase is GoalPhase.RETREATING and driven.navigation.plan is None
    driven.steps(40)
    goal = driven.navigation.goal
    assert goal is not None and goal.phase is GoalPhase.CONTROLLING and driven.navigation.plan is not None
    driven.navigation.take(GoalOrder.KEEP, None, 0.5)
    driven.navigation.take(GoalOrder.CANCEL)
    assert not driven.navigation.backing_out and driven.navigation.plan is None and driven.steps(1) == [STILL]


def test_a_paused_robot_backs_out_once_resumed() -> None:
    driven = bend()
    driven.navigation.take(GoalOrder.KEEP, True, 0.5)
    assert driven.steps(3) == [STILL] * 3
    driven.navigation.take(GoalOrder.KEEP, False)
    assert driven.steps(1)[0].vx < 0


def test_it_turns_first_if_the_target_is_not_behind() -> None:
    here = Pose(0.0, 0.0, 0.0)
    assert reverse_velocity(here, Point(1.0, 0.1)).omega < 0 < reverse_velocity(here, Point(1.0, -0.1)).omega
    assert reverse_velocity(here, Point(-1.0, 0.0)) == Twist(-0.2, 0.0, 0.0)
    left, right = reverse_velocity(here, Point(-1.0, 0.5)), reverse_velocity(here, Point(-1.0, -0.5))
    assert left.vx == right.vx == -0.2 and left.omega == -right.omega < 0


def test_the_trail_covers_the_longest_distance_of_backing_out() -> None:
    trail, metre = Trail(), 1.02  # points 0.051 m apart
    for n in range(200):
        trail.take(Point(0.05 * metre * n, 0.0))
    ahead = [trail.behind(Point(0.05 * metre * (199 - n), 0.0)) for n in range(70)]
    assert ahead[0] is not None and ahead[0].x == pytest.approx(0.05 * metre * 194)
    assert sum(target is not None for target in ahead) == pytest.approx(56, abs=1)


def test_a_plan_has_distance_and_time_to_go() -> None:
    driven = BackingOutRun(Pose(2.0, 1.7, 0.0))
    driven.navigation.take(Point(8.0, 1.7))
    driven.steps(1)
    plan = driven.navigation.plan
    assert plan is not None and plan.points[-1] == Point(8.0, 1.7)
    here = Point(5.0, 1.7)
    assert plan.distance_to_go(here) == pytest.approx(3.0, abs=0.3)
    assert in_seconds(plan.time_to_go(here)) == pytest.approx(9.0, abs=1.0)
    assert plan.ahead(here)[0].distance_to(here) < 0.2


def test_a_stop_cancels_backing_out() -> None:
    order: dict[str, object] = {}
    device = RobotNavigation(order)
    device.back_out(1.0)
    assert device.backing_out and order == {"back_out": 1.0}
    device.stop()
    assert not device.backing_out and order == {"goal": GoalOrder.CANCEL}
    device.back_out(0.5)
    assert order == {"goal": GoalOrder.CANCEL, "back_out": 0.5}
