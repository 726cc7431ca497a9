"""What navigation is measured against: shortest ways, gaps, passages and intervals."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid, outline
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.geometry import Point, Pose
from actors.world.physics import Arena
from actors.world.world_setup import BodySetup, WorldSetup
from benchmarks.navigation.yardsticks import (
    RetracingError,
    ShortestWays,
    closest,
    retrace,
    robot_gaps,
    touches,
    wall_gaps,
)
from benchmarks.statistics.measured import average, proportion
from benchmarks.world.plain_swarm import strewn, turtlebot, wishes
from observation.accounting.passage import Passages
from observation.accounting.tracks import Tracks

MAPS = Path(__file__).parents[2] / "maps"
RADIUS = 0.177


def walled() -> OccupancyGrid:
    """10 m by 6 m, border closed; in the middle, x 5 to 5.1, a wall from the south border up to y = 4."""
    cells = np.full((120, 200), FREE, np.uint8)
    cells[[0, -1]] = OCCUPIED
    cells[:, [0, -1]] = OCCUPIED
    cells[:80, 100:102] = OCCUPIED
    return OccupancyGrid(cells, 0.05)


def around(start: Point, goal: Point) -> float:
    """The taut string from the west of that wall to its east: tangents to discs around its two corners."""
    west, east = Point(5.0, 4.0), Point(5.1, 4.0)

    def tangent(point: Point, corner: Point) -> tuple[float, float]:
        away = point.distance_to(corner)
        angle = math.atan2(point.y - corner.y, abs(point.x - corner.x)) + math.acos(RADIUS / away)
        return math.sqrt(away**2 - RADIUS**2), math.pi / 2 - angle

    (first, arc), (last, other_arc) = tangent(start, west), tangent(goal, east)
    return first + RADIUS * (arc + other_arc) + 0.1 + last


def standing_at(robot: str, pose: Pose) -> BodySetup:
    return BodySetup(robot, "turtlebot2", None, "exact", (pose.x, pose.y, pose.heading), ())


@pytest.mark.parametrize(
    ("start", "goal"),
    [((4.0, 1.0), (6.0, 1.0)), ((1.0, 3.0), (9.0, 1.0)), ((4.5, 3.5), (9.0, 3.0)), ((2.0, 0.5), (5.5, 2.5))],
)
def test_a_way_around_a_wall_is_as_long_as_a_taut_string(
    start: tuple[float, float], goal: tuple[float, float]
) -> None:
    length = ShortestWays(walled(), RADIUS).length(Point(*start), Point(*goal))
    assert length == pytest.approx(around(Point(*start), Point(*goal)), rel=0.02)


def test_straight_ways_are_straight() -> None:
    ways = ShortestWays(walled(), RADIUS)
    assert ways.length(Point(1.0, 5.0), Point(9.0, 4.5)) == pytest.approx(math.hypot(8.0, 0.5), rel=0.001)
    assert ways.length(Point(1.0, 1.0), Point(1.0, 1.0)) == pytest.approx(0.0, abs=0.1)


def test_no_way_where_the_disc_does_not_fit() -> None:
    grid = walled()
    cells = grid.cells.copy()
    cells[86:, 100:102] = OCCUPIED  # a gap of 0.3 m is left
    closed = OccupancyGrid(cells, 0.05)
    assert ShortestWays(closed, RADIUS).length(Point(1.0, 1.0), Point(9.0, 1.0)) is None
    assert ShortestWays(closed, 0.12).length(Point(1.0, 1.0), Point(9.0, 1.0)) is not None
    assert ShortestWays(grid, RADIUS).length(Point(1.0, 1.0), Point(5.05, 1.0)) is None, "into the wall"


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_no_way_is_shorter_than_the_crow_flies_nor_longer_than_by_a_third_point(seed: int) -> None:
    grid = load_map(MAPS / "apartment.yaml")
    ways = ShortestWays(grid, RADIUS)
    a, b, c = draw_points(
        grid, 3, rng=np.random.default_rng(seed), clearance=0.25, apart=0.5, passage=RADIUS + 0.03
    )
    ab, bc, ac = ways.length(a, b), ways.length(b, c), ways.length(a, c)
    assert ab is not None and bc is not None and ac is not None
    assert ac >= a.distance_to(c) - 1e-9
    assert ac <= 1.08 * (ab + bc), "up to what eight directions may take for shorter"


def test_gaps_to_walls_are_exact_near_them() -> None:
    true = np.array([[[1.0, 1.0, 0.0], [4.8, 2.0, 0.0]], [[0.3, 3.0, 0.0], [5.1 + RADIUS, 2.0, 0.0]]])
    gaps = wall_gaps(walled(), true, RADIUS)
    assert gaps[0, 1] == pytest.approx(0.2 - RADIUS)
    assert gaps[1] == pytest.approx([0.25 - RADIUS, 0.0])
    assert gaps[0, 0] == pytest.approx(0.95 - RADIUS, abs=0.05)
    assert closest(gaps) == pytest.approx(0.0)


def test_gaps_between_robots_and_how_often_they_touch() -> None:
    x = [1.0, 0.353, 0.355, 0.5, 0.354 - 1e-9, 0.35]
    true = np.array([[(0.0, 0.0), (away, 0.0), (0.0, 9.0)] for away in x])
    gaps = robot_gaps(true, RADIUS)
    assert gaps.shape == (6, 3)
    assert gaps[:, 0] == pytest.approx(np.array(x) - 0.354)
    assert touches(gaps) == 2
    assert touches(gaps[1:]) == 2, "one that touches at first counts"
    assert touches(robot_gaps(true[:, :1], RADIUS)) == 0
    assert closest(robot_gaps(true[:, :1], RADIUS)) == math.inf


def test_every_contact_is_one_with_a_wall_or_with_a_robot() -> None:
    grid = load_map(MAPS / "corridor.yaml")
    starts = strewn(grid, 20, np.random.default_rng(1))
    robots = tuple(standing_at(f"r{number}", pose) for number, pose in enumerate(starts))
    world = WorldSetup(str(MAPS / "corridor.yaml"), 1, 100_000, 40_000_000, robots)
    names = tuple(robot.id for robot in robots)
    arena = Arena(outline(grid), names, [turtlebot(2)] * 20, starts)
    true, wished = [], []
    for wish in (wish for second in wishes(20, 40, 3) for wish in [second] * 10):
        for robot, twist in enumerate(wish):
            arena.command(robot, twist, arena.now)
        true.append(arena.poses)
        wished.append(wish)
        arena.advance(10)
    always = np.ones((len(true), len(names)), np.bool_)
    tracks = Tracks(names, 100_000, np.array(true), np.array(true), np.array(wished), always, always)
    fine, contacts = retrace(world, tracks)
    assert fine.shape == (4000, 20, 3) and np.array_equal(fine[9::10][:-1], true[1:])
    with_walls, with_robots = touches(wall_gaps(grid, fine, RADIUS)), touches(robot_gaps(fine, RADIUS))
    assert with_walls > 10 and with_robots > 5
    assert with_walls + with_robots == contacts == arena.contacts


def test_another_motion_than_that_of_the_run_is_refused() -> None:
    robot = standing_at("r1", Pose(15.0, 11.5, 0.0))
    world = WorldSetup(str(MAPS / "corridor.yaml"), 1, 100_000, 200_000, (robot,))
    true = np.array([[[15.0, 11.5, 0.0]], [[15.0, 11.5, 0.0]]])
    always = np.ones((2, 1), np.bool_)
    tracks = Tracks(("r1",), 100_000, true, true, np.array([[[0.5, 0.0, 0.0]]] * 2), always, always)
    with pytest.raises(RetracingError, match="step 1 begins elsewhere than in the run"):
        retrace(world, tracks)


def test_passages_are_where_one_robot_closes_the_way() -> None:
    passages = Passages(load_map(MAPS / "corridor.yaml"), RADIUS)
    assert passages.closed_by(Point(12.4, 9.0)) and passages.closed_by(Point(17.2, 10.0))
    for open_floor in (Point(15.0, 11.0), Point(14.8, 11.2), Point(12.4, 5.0), Point(14.2, 4.9)):
        assert not passages.closed_by(open_floor), "corridor, beside a cabinet, office, niche"
    assert passages.beside(Point(12.4, 10.9)) and not passages.closed_by(Point(12.4, 10.9))
    assert not passages.beside(Point(12.4, 11.5))


def test_a_proportion_has_the_interval_of_wilson() -> None:
    """81 of 263 is an example of Newcombe, Statistics in Medicine 17, 1998, table I, method 3."""
    assert proportion(0, 20) == pytest.approx((0.0, 0.0, 0.1611), abs=1e-4)
    assert proportion(20, 20) == pytest.approx((1.0, 0.8389, 1.0), abs=1e-4)
    assert proportion(81, 263) == pytest.approx((0.3080, 0.2553, 0.3662), abs=1e-4)


def test_an_average_has_students_interval() -> None:
    interval = average([1.0, 2.0, 3.0, 4.0])
    assert interval == pytest.approx((2.5, 0.4457, 4.5543), abs=0.02)
    assert average([5.0]) == (5.0, -math.inf, math.inf)
