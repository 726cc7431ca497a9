"""Swerving in a closed loop: past what stands there, past each other, and not at all where it cannot be."""

import numpy as np
import pytest

from actors.geometry import Point, Pose
from actors.grid import FREE, OCCUPIED, OccupancyGrid
from actors.messages import Drive
from actors.robot.detour import Detour
from actors.robot.driving import Driver, DrivingParameters
from actors.robot.navigation import Navigation
from actors.robot.planning import Planner, ground
from actors.robot.ports import AbortReason, GoalStatus
from actors.robot.surroundings import Surroundings
from tests.robot.base import FakeBase, at_step, model

RADIUS = 0.177


def corridor(narrow: float | None = None) -> OccupancyGrid:
    """10 m by 3.4 m; with `narrow`, m, it is only so wide from x = 4 to 6, m."""
    cells = np.full((70, 202), FREE, np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = OCCUPIED
    if narrow is not None:
        half = round(narrow / 0.1)
        cells[: 35 - half, 80:120] = cells[35 + half :, 80:120] = OCCUPIED
    return OccupancyGrid(cells, 0.05)


WIDE = corridor()


class Traveller:
    """A robot on its way to one point."""

    def __init__(self, floor: OccupancyGrid, start: Pose, goal: Point) -> None:
        self.base = FakeBase(floor, model(), start)
        self.seen = Surroundings(model().sensor)
        self.ground = ground(floor, RADIUS)
        self.navigation = Navigation(
            Planner(self.ground), Driver(self.ground, self.seen, RADIUS, 0.1, DrivingParameters())
        )
        self.navigation.take(goal)
        self.track = [start]
        self.least_gap = self.base.wall_gap()

    def take_step(self) -> None:
        step = len(self.track) - 1
        senses = self.base.senses(step)
        self.seen.take(at_step(step), senses.odometry, senses.scan)
        twist = self.navigation.advance(at_step(step), self.base.pose, self.base.velocity)
        self.base.drive(Drive(step, *twist, 0))
        self.track.append(self.base.pose)
        self.least_gap = min(self.least_gap, self.base.wall_gap())

    @property
    def outcome(self) -> tuple[GoalStatus, AbortReason | None]:
        assert self.navigation.goal is not None
        return self.navigation.goal.status, self.navigation.goal.reason


def meet(floor: OccupancyGrid, y_west: float, y_east: float, steps: int) -> tuple[Traveller, Traveller]:
    """Two robots drive at each other."""
    west = Traveller(floor, Pose(1.5, y_west, 0.0), Point(8.5, y_west))
    east = Traveller(floor, Pose(8.5, y_east, 3.1), Point(1.5, y_east))
    for _ in range(steps):
        west.base.obstacles = [(east.base.pose.point, RADIUS)]
        east.base.obstacles = [(west.base.pose.point, RADIUS)]
        west.take_step()
        east.take_step()
    return west, east


@pytest.mark.parametrize(
    ("y_west", "y_east"), [(1.75, 1.75), (1.85, 1.65), (1.65, 1.85), (0.6, 0.6), (2.9, 2.9)]
)
def test_two_robots_head_on_pass_each_other_on_the_right(y_west: float, y_east: float) -> None:
    west, east = meet(WIDE, y_west, y_east, 250)
    assert west.outcome == east.outcome == (GoalStatus.SUCCEEDED, None)
    assert min(west.least_gap, east.least_gap) > 0.02
    passing = next(i for i, (a, b) in enumerate(zip(west.track, east.track, strict=True)) if a.x >= b.x)
    assert west.track[passing].y < east.track[passing].y - 2 * RADIUS


@pytest.mark.parametrize("narrow", [0.9, 0.7])
def test_two_robots_head_on_in_a_passage_stop_and_report_that_they_are_blocked(narrow: float) -> None:
    west, east = meet(corridor(narrow), 1.75, 1.75, 150)
    assert west.outcome == east.outcome == (GoalStatus.ABORTED, AbortReason.BLOCKED)
    assert west.base.velocity == east.base.velocity == (0, 0, 0)
    assert 4.0 < west.base.pose.x < east.base.pose.x < 6.0
    assert min(west.least_gap, east.least_gap) > 0.02


@pytest.mark.parametrize("y", [1.75, 1.5, 2.0])
def test_it_passes_what_stands_in_the_way(y: float) -> None:
    robot = Traveller(WIDE, Pose(1.5, 1.75, 0.0), Point(8.5, 1.75))
    robot.base.obstacles = [(Point(5.0, y), 0.2)]
    for _ in range(200):
        robot.take_step()
    assert robot.outcome == (GoalStatus.SUCCEEDED, None)
    assert robot.least_gap > 0.08


def test_where_the_right_stays_shut_it_passes_on_the_left() -> None:
    robot = Traveller(WIDE, Pose(1.5, 0.6, 0.0), Point(8.5, 0.6))
    robot.base.obstacles = [(Point(5.0, 0.4), 0.3)]
    for _ in range(250):
        robot.take_step()
    assert robot.outcome == (GoalStatus.SUCCEEDED, None)
    assert max(pose.y for pose in robot.track) > 0.9
    assert robot.least_gap > 0.08


def test_before_a_doorway_that_is_taken_it_ends_up_standing_and_reports_that_it_is_blocked() -> None:
    robot = Traveller(corridor(0.9), Pose(1.5, 1.75, 0.0), Point(8.5, 1.75))
    robot.base.obstacles = [(Point(4.2, 1.75), 0.2)]
    for _ in range(400):
        robot.take_step()
    assert robot.outcome == (GoalStatus.ABORTED, AbortReason.BLOCKED)
    assert robot.least_gap > 0.02


@pytest.mark.parametrize("heading", [-3.0, -1.5, 0.0, 1.0, 2.0, 3.0])
def test_where_nothing_is_in_the_way_it_changes_nothing(heading: float) -> None:
    pose = Pose(1.5, 0.6, heading)
    robot = Traveller(corridor(0.9), pose, Point(8.5, 2.9))
    robot.base.obstacles = [(Point(2.2, 2.2), 0.15), (Point(0.8, 0.6), 0.15)]
    robot.take_step()
    way = Planner(robot.ground).path(pose.point, Point(8.5, 2.9))
    assert way is not None
    detour = Detour(robot.ground, robot.seen, RADIUS, 0.1)
    assert detour.around(pose, way, 0, 1.9, 0.8) == (1.9, 0.8)
