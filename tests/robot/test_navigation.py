"""Stories of goals: reached, given up for each reason, replaced, cancelled; driven in a closed loop."""

from collections.abc import Callable

import pytest

from actors.geometry import Point, Pose, Twist
from actors.messages import Drive
from actors.robot.driving import Driver, DrivingParameters
from actors.robot.navigation import Navigation
from actors.robot.planning import Planner, ground
from actors.robot.ports import AbortReason, Goal, GoalOrder, GoalStatus
from actors.robot.surroundings import Surroundings
from tests.robot.base import TWO_ROOMS, FakeBase, at_step, model

FLOOR = ground(TWO_ROOMS, 0.177)
FAR = Point(9.0, 3.0)
WEST = Pose(1.0, 1.0, 2.0)
ACTIVE, SUCCEEDED, ABORTED = GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED


class Trip:
    """A robot in the western room, from one goal to the next."""

    def __init__(self, start: Pose = WEST) -> None:
        self.base = FakeBase(TWO_ROOMS, model(), start)
        self.surroundings = Surroundings(model().sensor)
        driver = Driver(FLOOR, self.surroundings, 0.177, 0.1, DrivingParameters())
        self.navigation = Navigation(Planner(FLOOR), driver)
        self.step = 0
        self.least_gap = self.base.wall_gap()

    def take_step(self) -> Twist:
        senses = self.base.senses(self.step)
        self.surroundings.take(at_step(self.step), senses.odometry, senses.scan)
        twist = self.navigation.advance(at_step(self.step), self.base.pose, self.base.velocity)
        self.base.drive(Drive(self.step, *twist, 0))
        self.step += 1
        self.least_gap = min(self.least_gap, self.base.wall_gap())
        return twist

    def until(self, done: Callable[[], bool], seconds: float) -> None:
        """Take steps until `done`, which must be so within so many seconds."""
        for _ in range(round(10 * seconds)):
            self.take_step()
            if done():
                return
        pytest.fail(f"not within {seconds} s: at {self.base.pose}, {self.navigation.goal}")

    def closed(self) -> bool:
        return self.navigation.goal is not None and self.navigation.goal.status is not ACTIVE

    def standing(self) -> bool:
        return self.base.velocity.vx == 0 and abs(self.base.velocity.omega) < 0.01


def test_without_a_goal_it_stands() -> None:
    trip = Trip()
    assert trip.take_step() == (0, 0, 0)
    assert trip.navigation.goal is None


@pytest.mark.parametrize("heading", [0.0, 1.6, 3.1, -1.6])
def test_a_goal_behind_a_door_is_reached_without_touching_anything(heading: float) -> None:
    trip = Trip(Pose(1.0, 1.0, heading))
    trip.navigation.take(FAR)
    assert trip.navigation.goal == Goal(FAR, ACTIVE)
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)
    assert trip.base.pose.point.distance_to(FAR) <= 0.15
    assert trip.least_gap > 0.1
    assert trip.take_step() == (0, 0, 0)


def test_a_goal_at_a_wall_is_reached_as_near_as_the_body_can() -> None:
    trip = Trip()
    corner = Point(9.75, 3.25)
    trip.navigation.take(corner)
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(corner, SUCCEEDED)
    assert trip.base.pose.point.distance_to(corner) < 0.5
    assert trip.least_gap > 0.0


def test_a_goal_without_a_way_is_given_up_after_the_planners_patience() -> None:
    trip = Trip()
    nowhere = Point(30.0, 1.0)
    trip.navigation.take(nowhere)
    for _ in range(5):
        assert trip.take_step() == (0, 0, 0)
        assert trip.navigation.goal == Goal(nowhere, ACTIVE)
    trip.take_step()
    assert trip.navigation.goal == Goal(nowhere, ABORTED, AbortReason.NO_PLAN)


def test_a_goal_behind_a_blocked_door_is_given_up_two_patiences_after_the_robot_stopped() -> None:
    trip = Trip(Pose(2.0, 1.75, 0.0))
    trip.base.obstacles = [(Point(4.9, 1.75), 0.2)]
    trip.navigation.take(FAR)
    stopped = []

    def closed() -> bool:
        if trip.standing():
            stopped.append(trip.step)
        return trip.closed()

    trip.until(closed, 20)
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.BLOCKED)
    assert 18 <= trip.step - stopped[0] <= 21
    assert trip.base.wall_gap() == pytest.approx(0.09, abs=0.03)
    assert trip.least_gap > 0.05


def test_a_robot_that_stands_is_still_to_less_than_a_centimetre() -> None:
    trip = Trip(Pose(2.0, 1.75, 0.0))
    trip.base.obstacles = [(Point(4.9, 1.75), 0.2)]
    trip.navigation.take(FAR)
    trip.until(trip.closed, 20)
    stood = trip.base.pose.point
    for _ in range(5):
        trip.navigation.take(FAR)
        trip.until(trip.closed, 5)
        assert trip.base.pose.point.distance_to(stood) < 0.01


def test_what_goes_away_in_time_costs_no_goal() -> None:
    trip = Trip(Pose(2.0, 1.75, 0.0))
    trip.base.obstacles = [(Point(4.9, 1.75), 0.2)]
    trip.navigation.take(FAR)
    trip.until(trip.standing, 10)
    for _ in range(10):
        trip.take_step()
    trip.base.obstacles = []
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)


def test_blocked_again_after_driving_on_the_patience_begins_anew() -> None:
    trip = Trip(Pose(2.0, 1.75, 0.0))
    trip.navigation.take(FAR)
    for _ in range(3):
        for _ in range(15):
            trip.take_step()
        trip.base.obstacles = [(Point(trip.base.pose.x + 0.5, 1.75), 0.2)]
        for _ in range(18):
            trip.take_step()
        trip.base.obstacles = []
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)


def test_a_goal_that_was_given_up_can_be_asked_for_again() -> None:
    trip = Trip(Pose(2.0, 1.75, 0.0))
    trip.base.obstacles = [(Point(4.9, 1.75), 0.2)]
    trip.navigation.take(FAR)
    trip.until(trip.closed, 20)
    trip.base.obstacles = []
    trip.navigation.take(FAR)
    assert trip.navigation.goal == Goal(FAR, ACTIVE)
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)


def test_a_base_that_does_not_follow_is_given_up_after_the_oscillation_timeout() -> None:
    trip = Trip(Pose(1.0, 1.0, 0.0))
    stuck = trip.base.pose
    trip.navigation.take(FAR)

    def closed() -> bool:
        trip.base.pose = stuck
        return trip.closed()

    trip.until(closed, 11)
    assert trip.navigation.goal == Goal(FAR, ABORTED, AbortReason.NO_PROGRESS)
    assert trip.step == 101


def test_a_cancelled_goal_is_gone_and_the_robot_stops() -> None:
    trip = Trip()
    trip.navigation.take(FAR)
    for _ in range(50):
        trip.take_step()
    assert not trip.standing()
    trip.navigation.take(GoalOrder.CANCEL)
    assert trip.navigation.goal is None
    trip.until(trip.standing, 1)


def test_keeping_changes_nothing_and_a_new_point_replaces_the_goal() -> None:
    trip = Trip()
    trip.navigation.take(FAR)
    trip.take_step()
    trip.navigation.take(GoalOrder.KEEP)
    assert trip.navigation.goal == Goal(FAR, ACTIVE)
    near = Point(1.0, 3.0)
    trip.navigation.take(near)
    trip.until(trip.closed, 15)
    assert trip.navigation.goal == Goal(near, SUCCEEDED)
    assert trip.base.pose.point.distance_to(near) <= 0.15


def test_two_robots_head_on_in_a_door_both_stop_and_give_up() -> None:
    west, east = Trip(Pose(3.0, 1.75, 0.0)), Trip(Pose(7.0, 1.75, 3.1))
    west.navigation.take(Point(9.0, 1.75))
    east.navigation.take(Point(1.0, 1.75))
    least = 9.0
    for _ in range(150):
        west.base.obstacles = [(east.base.pose.point, 0.177)]
        east.base.obstacles = [(west.base.pose.point, 0.177)]
        west.take_step()
        east.take_step()
        least = min(least, west.base.pose.point.distance_to(east.base.pose.point) - 2 * 0.177)
    for trip in (west, east):
        assert trip.navigation.goal is not None
        assert trip.navigation.goal.reason is AbortReason.BLOCKED
        assert trip.standing()
    assert 0.02 < least < 0.2


def test_a_robot_that_touches_something_backs_away_and_goes_on() -> None:
    trip = Trip(Pose(1.0, 1.0, 0.0))
    trip.navigation.take(FAR)
    for _ in range(10):
        trip.take_step()
    touched = trip.base.pose
    senses = trip.base.senses(trip.step)
    trip.surroundings.take(at_step(trip.step), senses.odometry, senses.scan)
    twist = trip.navigation.advance(at_step(trip.step), touched, trip.base.velocity, bumped=True)
    assert twist == Twist(-0.1, 0.0, 0.0)
    trip.until(lambda: trip.base.pose.point.distance_to(touched.point) >= 0.15, 3)
    assert trip.base.pose.x < touched.x - 0.14, "backward, as the robot faces east"
    trip.until(trip.closed, 30)
    assert trip.navigation.goal == Goal(FAR, SUCCEEDED)


def test_a_retreat_that_leads_nowhere_ends_and_a_robot_without_a_goal_does_not_retreat() -> None:
    trip = Trip(Pose(1.0, 1.0, 0.0))
    still, pose = Twist(0.0, 0.0, 0.0), Pose(1.0, 1.0, 0.0)
    assert trip.navigation.advance(at_step(0), pose, still, bumped=True) == still
    trip.navigation.take(FAR)
    backward = [
        trip.navigation.advance(at_step(step), pose, still, bumped=step == 1).vx < 0 for step in range(1, 40)
    ]
    assert backward == [True] * 30 + [False] * 9
