"""Paths, doors and regions on a robot's map, and its random places."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from actors.floor.grid import OccupancyGrid, reachable
from actors.floor.map_file import load_map
from actors.floor.placement import Area, PlacementError
from actors.geometry import Point
from actors.randomness import generator
from actors.robot.navigation.planning import planning_grid
from actors.robot.navigation.routes import ReachableFloor, Routes, routes
from tests.robot.base import TWO_ROOMS, plan

RADIUS = 0.177
CORRIDOR_PLAN = load_map(Path(__file__).parents[2] / "maps" / "corridor.yaml")
CORRIDOR = planning_grid(CORRIDOR_PLAN, RADIUS)
ROOMS = planning_grid(TWO_ROOMS, RADIUS)
WEST, EAST, DOOR = Point(2.0, 1.7), Point(8.0, 1.7), Point(4.87, 1.75)
APART = plan("#########\n#   #   #\n#   #   #\n#   #   #\n#   #   #\n#########")


def test_the_length_is_that_of_the_path_and_at_most_eight_percent_too_long() -> None:
    on = routes(ROOMS)
    length, path = on.length(WEST, EAST), on.path(WEST, EAST)
    assert length is not None and path is not None
    assert length == pytest.approx(6.0, abs=0.2)
    assert path[0].distance_to(WEST) < 0.1 and path[-1].distance_to(EAST) < 0.1
    steps = sum(a.distance_to(b) for a, b in pairwise(path))
    assert length == pytest.approx(steps, rel=0.011)
    aslant = on.length(Point(1.0, 0.6), Point(3.0, 1.4))
    assert aslant is not None and 1.0 <= aslant / Point(1.0, 0.6).distance_to(Point(3.0, 1.4)) < 1.15


def test_lengths_are_symmetric() -> None:
    on, numbers = routes(CORRIDOR), generator(3, "test", "ways")
    floor = ReachableFloor(CORRIDOR, RADIUS, Point(12.0, 5.0), (), numbers)
    points = [floor.random_point() for _ in range(12)]
    for a in points:
        for b in points:
            assert on.length(a, b) == on.length(b, a)
            there, back = on.doors_between(a, b), on.doors_between(b, a)
            assert there is not None and back is not None and sorted(there) == sorted(back)


def test_unreachable_points_have_no_length() -> None:
    on = routes(planning_grid(APART, RADIUS))
    west, east = Point(0.75, 0.75), Point(1.75, 0.75)
    assert on.length(west, east) is None and on.path(west, east) is None
    assert on.doors_between(west, east) is None
    outside = Point(99.0, 99.0)
    assert on.length(outside, west) is None and on.length(west, outside) is None
    assert on.path(west, outside) is None and on.doors_between(outside, west) is None


def test_two_rooms_have_a_door_between_them() -> None:
    on = routes(ROOMS)
    assert on.regions.count == 2 and [door.regions for door in on.regions.doors] == [(1, 2)]
    (door,) = on.regions.doors
    assert door.middle.distance_to(DOOR) < 0.3 and on.door(door.middle) == 0
    assert (on.region(WEST), on.region(EAST)) == (1, 2) and on.region(door.middle) is None
    assert on.door(WEST) is None and on.region(Point(0.0, 0.0)) is None and on.door(Point(99.0, 0.0)) is None


def test_doors_of_a_path_include_those_at_its_ends() -> None:
    on = routes(ROOMS)
    assert (
        on.doors_between(WEST, EAST) == on.doors_between(DOOR, EAST) == on.doors_between(WEST, DOOR) == (0,)
    )
    assert on.doors_between(WEST, Point(3.0, 2.8)) == ()
    assert on.doors_between(Point(4.2, 0.8), Point(4.2, 2.7)) == ()


def test_the_corridor_has_two_offices_four_halls_and_five_doors() -> None:
    on = routes(CORRIDOR)
    assert on.regions.count == 6
    assert sorted(door.regions for door in on.regions.doors) == [(1, 4), (2, 5), (3, 4), (4, 5), (5, 6)]
    assert on.doors_between(Point(12.0, 5.0), Point(17.5, 5.0)) == (0, 3, 1)
    everywhere = on.regions.labels > 0
    assert np.array_equal(everywhere, CORRIDOR.costs > 0)


def test_robots_of_one_process_share_a_bounded_number_of_fields(monkeypatch: pytest.MonkeyPatch) -> None:
    assert routes(CORRIDOR) is routes(CORRIDOR)
    monkeypatch.setattr("actors.robot.navigation.routes._FIELDS", 2)
    on = Routes(ROOMS)
    lengths = [on.length(WEST, Point(x, 1.7)) for x in (1.0, 2.0, 6.0, 8.0, 1.0)]
    assert lengths[0] == lengths[-1] and on._field.cache_info().currsize == 2
    one = ReachableFloor(CORRIDOR, RADIUS, Point(12.0, 5.0), (), generator(1, "test", "a"))
    assert one.region(Point(12.0, 5.0)) == 1 and one.door(one.doors[0].middle) == 0
    assert one.is_free(Point(12.0, 5.0)) and not one.is_free(Point(0.0, 0.0))
    assert one.path(WEST, WEST) is None


COARSE = OccupancyGrid(
    np.kron(TWO_ROOMS.cells[::5, ::5], np.ones((2, 2), dtype=np.uint8)), TWO_ROOMS.resolution * 5
)
"""The same rooms twice as large, with cells as wide as a robot."""
WESTERN = Area("west", 1.0, 1.0, 3.0, 2.0)
NORTH = Area("north", 2.0, 1.5, 4.0, 2.5)
"""Shares 1 m by 0.5 m with WESTERN."""
START = Point(1.0, 1.0)


def floor(
    grid: OccupancyGrid, *areas: Area, start: Point = START, robot: str = "r1", radius: float = RADIUS
) -> ReachableFloor:
    return ReachableFloor(planning_grid(grid, radius), radius, start, areas, generator(5, "behaviour", robot))


def draws(of: ReachableFloor, count: int) -> list[Point]:
    return [of.random_point() for _ in range(count)]


def within(area: Area, point: Point) -> bool:
    return area.x0 <= point.x <= area.x1 and area.y0 <= point.y <= area.y1


@pytest.mark.parametrize(
    ("grid", "start", "radius"),
    [
        (CORRIDOR_PLAN, Point(12.0, 5.0), RADIUS),
        (TWO_ROOMS, START, RADIUS),
        (COARSE, Point(2.0, 2.0), 0.34),
    ],
    ids=["corridor", "rooms", "coarse"],
)
def test_the_robot_can_stand_and_get_there(grid: OccupancyGrid, start: Point, radius: float) -> None:
    region = reachable(grid, start, radius)
    for place in draws(floor(grid, start=start, radius=radius), 500):
        assert grid.clearance_at(place, 1.0) >= radius
        assert region[grid.cell(place)]


def test_points_are_uniform_over_the_union_of_areas() -> None:
    # the overlap is 0.5 of 3.5 m², no more likely for lying in two areas
    places = draws(floor(TWO_ROOMS, WESTERN, NORTH), 3500)
    assert draws(floor(TWO_ROOMS, NORTH, WESTERN), 50) == places[:50], "independent of the order of areas"
    assert draws(floor(TWO_ROOMS, WESTERN, NORTH, robot="r2"), 50) != places[:50]
    counts = [0, 0, 0]
    for place in places:
        counts[0 if not within(NORTH, place) else 1 if within(WESTERN, place) else 2] += 1
    assert stats.chisquare(counts, [1500, 500, 1500]).pvalue > 0.01
    west = np.array([place for place in places if within(WESTERN, place)])
    assert stats.kstest(west[:, 0], "uniform", args=(1.0, 2.0)).pvalue > 0.01
    assert stats.kstest(west[:, 1], "uniform", args=(1.0, 1.0)).pvalue > 0.01


def test_without_areas_all_reachable_floor_counts_and_no_more() -> None:
    parted = plan("###########\n#    #    #\n#    #    #\n#    #    #\n###########")
    xs = [place.x for place in draws(floor(parted, start=Point(0.7, 0.7)), 200)]
    assert max(xs) < 1.25
    xs = [place.x for place in draws(floor(parted, start=Point(2.0, 0.7)), 200)]
    assert min(xs) > 1.5
    both = [place.x for place in draws(floor(TWO_ROOMS), 200)]
    assert min(both) < 4.0 and max(both) > 6.0


def test_unreachable_areas_give_one_sentence() -> None:
    wall = Area("wall", 0.0, 0.0, 0.4, 0.4)
    with pytest.raises(PlacementError) as caught:
        floor(TWO_ROOMS, wall).random_point()
    assert str(caught.value) == (
        "a robot that starts at (1.00, 1.00) can reach no point of 'wall' at least 0.177 m from walls;"
        " change its start or the areas"
    )


def test_an_occupied_start_is_replaced_by_the_nearest_free_cell() -> None:
    places = draws(floor(TWO_ROOMS, WESTERN, start=Point(0.25 + RADIUS, 1.0)), 3)
    assert all(within(WESTERN, place) for place in places)
