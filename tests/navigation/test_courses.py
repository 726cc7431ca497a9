"""Whole drives: round corners, through doors, past what stands about, or not."""

import itertools
import math

import numpy as np
import pytest

from actors.floor.map_file import load_map
from actors.geometry import STILL, Point, Pose
from actors.installation.repository import SHIPPED
from actors.robot.cost_maps.cell_distance import half_gaps
from actors.robot.navigation.planning import PLANNER_PRESETS, narrowest_door
from tests.navigation.course import CELL, DOOR, HALL, RADIUS, Pilot, drive, neck
from tests.robot.base import plan

CORNERS = plan(
    """
####################
#                  #
#                  #
#                  #
#                  #
#                  #
##########         #
##########         #
#                  #
#                  #
#                  #
#                  #
#                  #
####################
"""
)
"""4.5 m by 3 m; a wall reaches in from the west."""
PRESETS = ["disc", "robust"]
ALL = ["chapter", *PRESETS]


@pytest.mark.parametrize(
    ("preset", "goal"), [("disc", Point(3.4, 0.8)), ("robust", Point(3.4, 0.8)), ("robust", Point(0.8, 0.8))]
)
def test_it_reaches_a_goal_round_a_corner_and_touches_nothing(preset: str, goal: Point) -> None:
    pilot = Pilot(CORNERS, Pose(0.8, 2.6, 0.0), goal, preset=preset)
    drive(pilot, steps=350)
    assert pilot.record.arrived
    assert pilot.record.gap > 0.01


@pytest.mark.parametrize("preset", ALL)
def test_it_gets_through_a_door_with_an_estimate_that_jumps_by_5_cm(preset: str) -> None:
    noise = np.random.default_rng(1)
    pilot = Pilot(DOOR, Pose(0.8, 0.8, 1.0), Point(7.5, 2.7), preset=preset, noise=noise)
    drive(pilot, steps=400)
    assert pilot.record.arrived
    assert pilot.record.gap > 0.0


def test_robust_drives_through_the_narrowest_door_that_it_plans_through() -> None:
    width = narrowest_door(RADIUS, PLANNER_PRESETS["robust"], CELL)
    pilot = Pilot(neck(width), Pose(2.4, 1.5, 0.8), Point(6.0, 1.76), preset="robust")
    drive(pilot, steps=300)
    assert pilot.record.arrived and pilot.record.gap > 0.0


@pytest.mark.parametrize("preset", PRESETS)
def test_before_a_door_that_something_blocks_it_stands_without_any_trajectory(preset: str) -> None:
    pilot = Pilot(DOOR, Pose(0.8, 1.76, 0.0), Point(7.5, 1.76), preset=preset)
    pilot.fixed = [(Point(4.2, 1.76), RADIUS)]
    drive(pilot, steps=150)
    assert pilot.record.invalid > 30
    assert pilot.base.velocity == (0.0, 0.0, 0.0)
    assert 0.3 < pilot.base.pose.x < 3.9 and pilot.record.gap > 0.1


@pytest.mark.parametrize("offset", [0.0, 0.25])
def test_robust_goes_round_what_stands_in_the_open(offset: float) -> None:
    pilot = Pilot(HALL, Pose(0.6, 1.76, 0.0), Point(6.4, 1.76), preset="robust")
    pilot.fixed = [(Point(3.2, 1.76 + offset), RADIUS)]
    drive(pilot, steps=250)
    assert pilot.record.arrived
    assert pilot.record.gap > 0.01


def test_the_chapters_weights_hold_it_before_what_stands_right_on_its_plan() -> None:
    """The plan pulls more than twice as much as the goal: turning before it seems better than leaving it."""
    pilot = Pilot(HALL, Pose(0.6, 1.76, 0.0), Point(6.4, 1.76))
    pilot.fixed = [(Point(3.2, 1.76), RADIUS)]
    drive(pilot, steps=250)
    assert not pilot.record.arrived
    assert pilot.base.pose.x < 3.0 and pilot.record.gap > 0.1


@pytest.mark.parametrize("offset", [0.01, 0.4])
def test_two_robots_that_meet_in_the_open_pass(offset: float) -> None:
    """Without any offset the two are mirror images, and only the navigator's recovery parts them."""
    east = Pilot(HALL, Pose(0.6, 1.76, 0.0), Point(6.4, 1.76), preset="robust")
    west = Pilot(HALL, Pose(6.4, 1.76 + offset, math.pi), Point(0.6, 1.76 + offset), preset="robust")
    drive(east, west, steps=300)
    assert east.record.arrived and west.record.arrived
    assert min(east.record.gap, west.record.gap) > 0.01


def test_half_of_a_gap_is_left_to_what_moves() -> None:
    squared, arrivals = np.full((40, 40), 100, np.int16), np.zeros((40, 40), np.int64)
    squared[20, [10, 30]], arrivals[20, 30] = 0, 7
    bounds = half_gaps(squared, arrivals, 7, np.array([20.5, 20.5]), 4.0, 5.0)
    assert bounds.tolist() == [[1.0, 0.0, 3.0]]
    for since, farthest in ((8, 5.0), (7, 2.9)):
        assert not half_gaps(squared, arrivals, since, np.array([20.5, 20.5]), 4.0, farthest).size


@pytest.mark.parametrize("preset", ALL)
def test_two_robots_that_meet_in_a_passage_end_without_any_trajectory(preset: str) -> None:
    east = Pilot(DOOR, Pose(2.6, 1.76, 0.0), Point(7.5, 1.76), preset=preset)
    west = Pilot(DOOR, Pose(5.7, 1.76, math.pi), Point(0.8, 1.76), preset=preset)
    drive(east, west, steps=150)
    for pilot in (east, west):
        assert not pilot.record.arrived and pilot.record.invalid > 20
        assert pilot.base.velocity == (0.0, 0.0, 0.0) and pilot.record.gap > 0.05


def test_with_the_plan_behind_it_turns_on_the_spot() -> None:
    pilot = Pilot(HALL, Pose(2.0, 1.76, -2.2), Point(6.0, 1.76))
    drive(pilot, steps=60)
    poses = pilot.record.poses
    turned = next(k for k, pose in enumerate(poses) if abs(pose.heading) < 1.2)
    assert all(pose.point.distance_to(poses[0].point) < 0.15 for pose in poses[:turned])
    turns = [steering.twist.omega for steering in pilot.record.steerings[:turned]]
    assert len({math.copysign(1.0, turn) for turn in turns}) == 1


@pytest.mark.parametrize("heading", [-2.62, 0.0])
def test_robust_gets_round_the_end_of_a_wall_that_the_goal_is_behind(heading: float) -> None:
    """The goal's pull on the nose would hold it there, turning to and fro."""
    maze, goal = load_map(SHIPPED / "maps" / "maze.yaml"), Point(2.1257, 7.1375)
    pilot = Pilot(maze, Pose(2.63, 7.67, heading), goal, preset="robust")
    drive(pilot, steps=100)
    assert pilot.record.arrived and pilot.record.gap > 0.01


@pytest.mark.parametrize("preset", PRESETS)
def test_on_a_straight_plan_it_neither_weaves_nor_dawdles(preset: str) -> None:
    pilot = Pilot(HALL, Pose(0.8, 1.76, 0.3), Point(6.4, 1.76), preset=preset)
    drive(pilot, steps=250)
    assert pilot.record.arrived
    fast = [k for k, steering in enumerate(pilot.record.steerings) if steering.twist.vx > 0.45]
    assert len(fast) > 60
    settled = pilot.record.poses[fast[0] + 20 : fast[-1]]
    assert max(abs(pose.heading) for pose in settled) < 0.15
    crossings = sum(a.heading * b.heading < 0 for a, b in itertools.pairwise(settled))
    assert crossings <= 2


@pytest.mark.parametrize(("preset", "aside"), [("disc", 0.0), ("robust", 0.3)])
def test_it_comes_to_rest_at_the_goal_without_passing_it(preset: str, aside: float) -> None:
    pilot = Pilot(HALL, Pose(3.0, 1.76, 0.0), Point(5.0, 1.76 + aside), preset=preset)
    drive(pilot, steps=200)
    assert pilot.record.arrived
    along = [pose.x for pose in pilot.record.poses]
    assert max(along) < 5.0 and along == sorted(along)
    assert pilot.base.velocity.vx <= 0.1 + 1e-9


@pytest.mark.parametrize("aside", [0.0, 0.3])
def test_the_originals_goal_is_reached_once_it_stands_there_with_the_goals_heading(aside: float) -> None:
    """It turns on the spot to heading 0 once it is near, whatever way it came."""
    pilot = Pilot(HALL, Pose(5.0, 1.76, 2.5), Point(2.5, 1.76 + aside), preset="chapter")
    drive(pilot, steps=300)
    assert pilot.record.arrived and pilot.base.velocity == STILL
    assert abs(pilot.base.pose.heading) <= 0.3 and pilot.base.pose.point.distance_to(pilot.goal) < 0.3
    near = next(k for k, pose in enumerate(pilot.record.poses) if pose.point.distance_to(pilot.goal) <= 0.15)
    assert abs(pilot.record.poses[near].heading) > 2.0, "it came from the east"
    last = [steering.twist for steering in pilot.record.steerings if steering.twist != STILL][-3:]
    assert all(twist.vx == 0.0 and abs(twist.omega) >= 0.4 for twist in last)


def test_beside_a_wall_the_original_has_no_trajectory_for_ever() -> None:
    """Its outline meets what is marked where it stands; ours gets away."""
    start, goal = Pose(0.16 + 0.19, 1.76, 1.57), Point(3.0, 1.76)
    pilots = {preset: Pilot(HALL, start, goal, preset=preset) for preset in ("chapter", "robust")}
    for pilot in pilots.values():
        drive(pilot, steps=150)
    assert pilots["chapter"].record.invalid == 150 and pilots["robust"].record.arrived
