"""Ways on small floor plans and on the corridor of the original testbed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from actors.bounds import ParameterError
from actors.floor.grid import FREE, OCCUPIED, Cell, OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.robot.navigation.planning import PLANNER_PRESETS, Ground, Planner, ground, narrowest_door
from tests.robot.base import TWO_ROOMS, plan

RADIUS = 0.177
GRID = PLANNER_PRESETS["robust"]
CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


@pytest.fixture(scope="module")
def corridor() -> Ground:
    return ground(load_map(CORRIDOR), RADIUS)


def least_clearance(floor: Ground, way: NDArray[np.float64]) -> float:
    return float(min(floor.clearance[floor.grid.cell(Point(*point))] for point in way))


def test_the_way_leads_through_the_middle_of_a_door() -> None:
    way = Planner(ground(TWO_ROOMS, RADIUS)).path(Point(1.0, 0.5), Point(9.0, 3.0))
    assert way is not None
    in_door = way[(way[:, 0] > 4.75) & (way[:, 0] < 5.0)]
    assert len(in_door) >= 4
    assert np.abs(in_door[:, 1] - 1.75).max() <= 0.075
    assert tuple(way[-1]) == (9.0, 3.0)


def test_the_way_is_gapless_and_begins_at_the_robot() -> None:
    way = Planner(ground(TWO_ROOMS, RADIUS)).path(Point(1.0, 0.5), Point(9.0, 3.0))
    assert way is not None
    assert np.hypot(way[0, 0] - 1.0, way[0, 1] - 0.5) <= 0.05
    assert np.hypot(*np.diff(way, axis=0).T).max() <= 0.05 * 2**0.5 + 0.05


def test_a_goal_in_a_wall_becomes_the_nearest_point_with_room() -> None:
    floor = ground(TWO_ROOMS, RADIUS)
    way = Planner(floor).path(Point(1.0, 1.0), Point(0.1, 2.0))
    assert way is not None
    assert Point(*way[-1]).distance_to(Point(0.1, 2.0)) < 0.5
    assert least_clearance(floor, way[-1:]) >= RADIUS


@pytest.mark.parametrize("goal", [Point(-1.0, 1.0), Point(50.0, 50.0), Point(10.5, 2.0), Point(9.95, 3.5)])
def test_there_is_no_way_to_a_goal_without_room_within_the_tolerance(goal: Point) -> None:
    assert Planner(ground(TWO_ROOMS, RADIUS)).path(Point(1.0, 1.0), goal) is None


def test_there_is_no_way_into_a_closed_room() -> None:
    closed = plan("#########\n#   #   #\n#   #   #\n#   #   #\n#########\n")
    planner = Planner(ground(closed, RADIUS))
    assert planner.path(Point(0.6, 0.6), Point(1.7, 0.6)) is None
    assert planner.path(Point(0.6, 0.6), Point(0.7, 0.7)) is not None
    assert planner.path(Point(1.6, 0.6), Point(1.7, 0.6)) is not None  # as after a move by hand


def test_there_is_no_way_from_a_start_without_room() -> None:
    assert Planner(ground(TWO_ROOMS, RADIUS)).path(Point(-3.0, 1.0), Point(1.0, 1.0)) is None


def test_a_robot_pressed_to_a_wall_finds_its_way_out() -> None:
    way = Planner(ground(TWO_ROOMS, RADIUS)).path(Point(0.25 + RADIUS, 1.0), Point(3.0, 1.0))
    assert way is not None
    assert Point(*way[0]).distance_to(Point(0.25 + RADIUS, 1.0)) < 0.1


def test_a_potential_that_is_kept_gives_the_way_that_a_new_one_would() -> None:
    floor = ground(TWO_ROOMS, RADIUS)
    goals = [Point(9.0, 0.5 + 0.3 * i) for i in range(6)]
    small = Planner(floor, replace(GRID, cached=2))
    for goal in [*goals, *goals[:3], goals[0]]:
        again, anew = small.path(Point(1.0, 1.0), goal), Planner(floor).path(Point(1.0, 1.0), goal)
        assert again is not None and anew is not None
        assert np.array_equal(again, anew)


@pytest.mark.parametrize(("megabytes", "kept"), [(1e-9, 1), (0.0, 0), (100.0, 6)])
def test_potentials_take_as_much_memory_as_is_said(megabytes: float, kept: int) -> None:
    floor = ground(TWO_ROOMS, RADIUS)
    if not kept:
        with pytest.raises(ParameterError):
            replace(GRID, cached_mb=megabytes)
        return
    planner = Planner(floor, replace(GRID, cached_mb=megabytes))
    for i in range(6):
        planner.path(Point(1.0, 1.0), Point(9.0, 0.5 + 0.3 * i))
    assert len(planner._fields) == kept
    for_two = 2.5 * floor.costs.nbytes / 1e6
    two = Planner(floor, replace(GRID, cached_mb=for_two))
    for i in range(6):
        two.path(Point(1.0, 1.0), Point(9.0, 0.5 + 0.3 * i))
    assert len(two._fields) == 2


@settings(max_examples=60, deadline=None)
@given(
    walls=arrays(
        np.bool_, st.tuples(st.integers(1, 20), st.integers(1, 20)), elements=st.integers(0, 9).map(bool)
    ),
    resolution=st.sampled_from([0.02, 0.03125, 0.05]),
)
def test_a_coarse_grid_never_promises_more_room_than_there_is(
    walls: NDArray[np.bool_], resolution: float
) -> None:
    fine = OccupancyGrid(np.where(walls, FREE, OCCUPIED).astype(np.uint8), resolution, Point(1.0, -2.0))
    coarse = ground(fine, 0.0)
    assert 0.05 <= coarse.grid.resolution < 0.0626
    assert coarse.grid.origin == fine.origin
    for row, column in np.ndindex(coarse.clearance.shape):
        promised = coarse.clearance[row, column]
        if promised > 0:
            centre = coarse.grid.centre(Cell(row, column))
            assert promised <= fine.clearance_at(centre, within=5.0) + 1e-9


@pytest.mark.parametrize("office", [12.44, 17.25])
def test_ways_through_the_passages_of_the_corridor_map_keep_to_the_middle(
    corridor: Ground, office: float
) -> None:
    way = Planner(corridor).path(Point(office, 5.0), Point(9.0, 12.0))
    assert way is not None
    neck = way[(way[:, 1] > 8.4) & (way[:, 1] < 10.3)]
    assert np.abs(neck[:, 0] - office).max() < 0.1
    assert least_clearance(corridor, way) > 0.3


def test_every_area_of_the_corridor_map_can_be_reached_from_everywhere(corridor: Ground) -> None:
    spots = [Point(12, 5), Point(17.5, 5), Point(12, 13), Point(26, 11), Point(2.5, 11.2), Point(0.5, 12.5)]
    planner = Planner(corridor)
    for start in spots:
        for goal in spots:
            way = planner.path(start, goal)
            assert way is not None and tuple(way[-1]) == goal


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
        if Planner(ground(floor, RADIUS, parameters), parameters).path(start, goal) is not None:
            planned.add(width)
    assert {narrowest, narrowest + 1} <= planned
    assert not closed or planned == {narrowest, narrowest + 1}
