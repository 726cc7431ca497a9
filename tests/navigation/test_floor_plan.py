"""Random places: where they may lie, how often, and that they repeat."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from actors.floor.grid import OccupancyGrid, reachable
from actors.floor.map_file import load_map
from actors.floor.placement import Area, PlacementError
from actors.geometry import Point
from actors.randomness import generator
from actors.robot.navigation.floor_plan import ReachableFloor
from actors.robot.navigation.planning import Planner, ground
from tests.robot.base import TWO_ROOMS, plan

RADIUS = 0.177
CORRIDOR = load_map(Path(__file__).parents[2] / "maps" / "corridor.yaml")
COARSE = OccupancyGrid(
    np.kron(TWO_ROOMS.cells[::5, ::5], np.ones((2, 2), dtype=np.uint8)), TWO_ROOMS.resolution * 5
)
"""The same rooms twice as large, of cells as wide as a robot."""
WEST = Area("west", 1.0, 1.0, 3.0, 2.0)
NORTH = Area("north", 2.0, 1.5, 4.0, 2.5)
"""Shares 1 m by 0.5 m with WEST."""
START = Point(1.0, 1.0)


def floor(
    grid: OccupancyGrid, *areas: Area, start: Point = START, robot: str = "r1", radius: float = RADIUS
) -> ReachableFloor:
    return ReachableFloor(ground(grid, radius), radius, start, areas, generator(5, "behaviour", robot))


def draws(of: ReachableFloor, count: int) -> list[Point]:
    return [of.random_place() for _ in range(count)]


def within(area: Area, point: Point) -> bool:
    return area.x0 <= point.x <= area.x1 and area.y0 <= point.y <= area.y1


@pytest.mark.parametrize(
    ("grid", "start", "radius"),
    [(CORRIDOR, Point(12.0, 5.0), RADIUS), (TWO_ROOMS, START, RADIUS), (COARSE, Point(2.0, 2.0), 0.34)],
    ids=["corridor", "rooms", "coarse"],
)
def test_the_robot_can_stand_and_get_there(grid: OccupancyGrid, start: Point, radius: float) -> None:
    region = reachable(grid, start, radius)
    for place in draws(floor(grid, start=start, radius=radius), 500):
        assert grid.clearance_at(place, 1.0) >= radius
        assert region[grid.cell(place)]


def test_navigation_goes_to_the_very_point() -> None:
    planner = Planner(ground(CORRIDOR, RADIUS))
    for place in draws(floor(CORRIDOR, start=Point(12.0, 5.0)), 10):
        way = planner.path(Point(12.0, 5.0), place)
        assert way is not None and tuple(way[-1]) == place


def test_points_are_uniform_over_the_union_of_areas() -> None:
    # the overlap is 0.5 of 3.5 m², in no way more likely for lying in two areas
    places = draws(floor(TWO_ROOMS, WEST, NORTH), 3500)
    counts = [0, 0, 0]
    for place in places:
        counts[0 if not within(NORTH, place) else 1 if within(WEST, place) else 2] += 1
    assert stats.chisquare(counts, [1500, 500, 1500]).pvalue > 0.01
    west = np.array([place for place in places if within(WEST, place)])
    assert stats.kstest(west[:, 0], "uniform", args=(1.0, 2.0)).pvalue > 0.01
    assert stats.kstest(west[:, 1], "uniform", args=(1.0, 1.0)).pvalue > 0.01


def test_cells_that_an_area_cuts_count_by_what_is_left_of_them() -> None:
    # the cells meet at x = 1.05: 0.04 m of one and 0.02 m of the other
    slim = Area("slim", 1.01, 1.0, 1.07, 2.0)
    xs = [place.x for place in draws(floor(TWO_ROOMS, slim), 2000)]
    assert stats.kstest(xs, "uniform", args=(1.01, 0.06)).pvalue > 0.01


def test_an_area_in_a_wall_counts_as_far_as_the_robot_can_stand_there() -> None:
    edge = Area("edge", -5.0, 1.0, 1.0, 2.0)
    xs = [place.x for place in draws(floor(TWO_ROOMS, edge), 300)]
    assert 0.25 + RADIUS <= min(xs) < 0.55 and 0.9 < max(xs) <= 1.0


def test_without_areas_all_reachable_floor_counts_and_no_more() -> None:
    parted = plan("###########\n#    #    #\n#    #    #\n#    #    #\n###########")
    xs = [place.x for place in draws(floor(parted, start=Point(0.7, 0.7)), 200)]
    assert max(xs) < 1.25
    xs = [place.x for place in draws(floor(parted, start=Point(2.0, 0.7)), 200)]
    assert min(xs) > 1.5
    both = [place.x for place in draws(floor(TWO_ROOMS), 200)]
    assert min(both) < 4.0 and max(both) > 6.0


def test_a_start_where_planning_would_not_let_it_stand_is_as_good_as_the_nearest_that_would() -> None:
    places = draws(floor(TWO_ROOMS, WEST, start=Point(0.25 + RADIUS, 1.0)), 3)
    assert all(within(WEST, place) for place in places)


def test_the_same_stream_gives_the_same_points_whatever_the_order_of_areas() -> None:
    first = draws(floor(TWO_ROOMS, WEST, NORTH), 50)
    assert draws(floor(TWO_ROOMS, NORTH, WEST), 50) == first
    assert draws(floor(TWO_ROOMS, WEST, NORTH, robot="r2"), 50) != first


def test_three_numbers_are_drawn_each_time_and_none_before() -> None:
    own, twin = generator(5, "behaviour", "r1"), generator(5, "behaviour", "r1")
    asked = ReachableFloor(ground(TWO_ROOMS, RADIUS), RADIUS, Point(1.0, 1.0), (WEST,), own)
    assert own.bit_generator.state == twin.bit_generator.state
    for _ in range(2):
        asked.random_place()
        twin.random(3)
        assert own.bit_generator.state == twin.bit_generator.state


def test_areas_out_of_reach_are_one_sentence() -> None:
    wall = Area("wall", 0.0, 0.0, 0.4, 0.4)
    with pytest.raises(PlacementError) as caught:
        floor(TWO_ROOMS, wall).random_place()
    assert str(caught.value) == (
        "a robot that starts at (1.00, 1.00) gets to no point of 'wall' at least 0.177 m from walls;"
        " there must be one to draw"
    )
