"""Complete drives around corners, through doors, and past obstacles."""

import math

import numpy as np
import pytest

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.geometry import STILL, Point, Pose
from actors.installation.repository import SHIPPED
from actors.robot.navigation.planning import PLANNER_PRESETS, narrowest_door
from actors.robot.navigation.ray_tracing import half_gaps
from tests.navigation.course import CELL, DOOR, HALL, RADIUS, Pilot, drive, neck
from tests.robot.base import plan

ROW, WALL = "#                  #", "##########         #"
CORNERS = plan("\n".join(["#" * 20, *[ROW] * 5, WALL, WALL, *[ROW] * 6, "#" * 20]))
"""4.5 m by 3 m, with a wall from the west."""
MAZE = load_map(SHIPPED / "maps" / "maze.yaml")
NARROWEST = neck(narrowest_door(RADIUS, PLANNER_PRESETS["robust"], CELL))
SIDE_DOOR, FAR = Pose(0.8, 0.8, 1.0), Point(7.5, 2.7)


@pytest.mark.parametrize(
    ("preset", "floor", "start", "goal", "gap"),
    [
        ("disc", CORNERS, Pose(0.8, 2.6, 0.0), Point(3.4, 0.8), 0.01),
        ("robust", CORNERS, Pose(0.8, 2.6, 0.0), Point(0.8, 0.8), 0.01),
        ("robust", NARROWEST, Pose(2.4, 1.5, 0.8), Point(6.0, 1.76), 0.0),
        # attracting the nose to the goal would hold it at the wall's end, oscillating
        ("robust", MAZE, Pose(2.63, 7.67, -2.62), Point(2.1257, 7.1375), 0.01),
        *((preset, DOOR, SIDE_DOOR, FAR, 0.0) for preset in ("chapter", "disc", "robust")),
    ],
)
def test_it_reaches_its_goal_without_contact(
    preset: str, floor: OccupancyGrid, start: Pose, goal: Point, gap: float
) -> None:
    """At the door the estimate jumps by 5 cm."""
    noise = np.random.default_rng(1) if floor is DOOR else None
    pilot = Pilot(floor, start, goal, preset=preset, noise=noise)
    drive(pilot, steps=400)
    assert pilot.record.arrived and pilot.record.gap > gap


@pytest.mark.parametrize("preset", ["disc", "robust"])
def test_before_a_blocked_door_it_stands_without_a_trajectory(preset: str) -> None:
    pilot = Pilot(DOOR, Pose(0.8, 1.76, 0.0), Point(7.5, 1.76), preset=preset)
    pilot.fixed = [(Point(4.2, 1.76), RADIUS)]
    drive(pilot, steps=150)
    assert pilot.record.invalid > 30
    assert pilot.base.velocity == (0.0, 0.0, 0.0)
    assert 0.3 < pilot.base.pose.x < 3.9 and pilot.record.gap > 0.1


def test_robust_drives_around_an_obstacle_on_open_floor() -> None:
    pilot = Pilot(HALL, Pose(0.6, 1.76, 0.0), Point(6.4, 1.76), preset="robust")
    pilot.fixed = [(Point(3.2, 1.76), RADIUS)]
    drive(pilot, steps=250)
    assert pilot.record.arrived and pilot.record.gap > 0.01


def test_two_robots_pass_each_other_on_open_floor() -> None:
    """Without an offset the two are mirror images, and only a recovery separates them."""
    east = Pilot(HALL, Pose(0.6, 1.76, 0.0), Point(6.4, 1.76), preset="robust")
    west = Pilot(HALL, Pose(6.4, 1.77, math.pi), Point(0.6, 1.77), preset="robust")
    drive(east, west, steps=300)
    assert east.record.arrived and west.record.arrived
    assert min(east.record.gap, west.record.gap) > 0.01


def test_a_robot_leaves_half_of_the_gap_to_a_moving_obstacle() -> None:
    squared, arrivals = np.full((40, 40), 100, np.int16), np.zeros((40, 40), np.int64)
    squared[20, [10, 30]], arrivals[20, 30] = 0, 7
    bounds = half_gaps(squared, arrivals, 7, np.array([20.5, 20.5]), 4.0, 5.0)
    assert bounds.tolist() == [[1.0, 0.0, 3.0]]
    for since, farthest in ((8, 5.0), (7, 2.9)):
        assert not half_gaps(squared, arrivals, since, np.array([20.5, 20.5]), 4.0, farthest).size


@pytest.mark.parametrize(("preset", "aside"), [("disc", 0.0), ("robust", 0.3)])
def test_it_comes_to_rest_at_the_goal_without_passing_it(preset: str, aside: float) -> None:
    pilot = Pilot(HALL, Pose(3.0, 1.76, 0.0), Point(5.0, 1.76 + aside), preset=preset)
    drive(pilot, steps=200)
    assert pilot.record.arrived
    along = [pose.x for pose in pilot.record.poses]
    assert max(along) < 5.0 and along == sorted(along)
    assert pilot.base.velocity.vx <= 0.1 + 1e-9


def test_the_originals_goal_is_reached_once_it_stands_there_with_the_goals_heading() -> None:
    """It turns on the spot to heading 0 near the goal, whatever its path."""
    pilot = Pilot(HALL, Pose(5.0, 1.76, 2.5), Point(2.5, 2.06), preset="chapter")
    drive(pilot, steps=300)
    assert pilot.record.arrived and pilot.base.velocity == STILL
    assert abs(pilot.base.pose.heading) <= 0.3 and pilot.base.pose.point.distance_to(pilot.goal) < 0.3
    near = next(k for k, pose in enumerate(pilot.record.poses) if pose.point.distance_to(pilot.goal) <= 0.15)
    assert abs(pilot.record.poses[near].heading) > 2.0, "it came from the east"
    last = [steering.twist for steering in pilot.record.steerings if steering.twist != STILL][-3:]
    assert all(twist.vx == 0.0 and abs(twist.omega) >= 0.4 for twist in last)


def test_beside_a_wall_the_original_never_finds_a_trajectory() -> None:
    start, goal = Pose(0.16 + 0.19, 1.76, 1.57), Point(3.0, 1.76)
    pilots = {preset: Pilot(HALL, start, goal, preset=preset) for preset in ("chapter", "robust")}
    for pilot in pilots.values():
        drive(pilot, steps=150)
    assert pilots["chapter"].record.invalid == 150 and pilots["robust"].record.arrived
