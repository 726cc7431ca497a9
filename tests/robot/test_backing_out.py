"""Backing out along the own trail because a behaviour says so; the plan that it sees."""

import math

import pytest

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant, in_seconds
from actors.portable import cos_sin
from actors.robot.behaviour import FARTHEST_BACK, GoalOrder, GoalPhase
from actors.robot.behaviour.devices import RobotNavigation
from actors.robot.navigation.navigator import Navigator
from actors.robot.navigation.planning import Planner, ground
from actors.robot.navigation.trail import Trail, backward
from tests.robot.base import TWO_ROOMS
from tests.robot.trip import Memory, Obedient

FLOOR = ground(TWO_ROOMS, 0.177)
STEP_S = 0.1


class Driven:
    """A robot that goes as it is told."""

    def __init__(self, pose: Pose) -> None:
        self.map = Memory()
        self.navigation = Navigator(Planner(FLOOR), self.map, Obedient())
        self.pose, self.step = pose, 0
        self.been: list[Point] = []

    def carried(self, *to: Pose) -> None:
        """Forward along some poses, as if it had driven."""
        for pose in to:
            self.pose = pose
            self._sense()

    def steps(self, number: int) -> list[Twist]:
        twists = []
        for _ in range(number):
            self._sense()
            twist = self.navigation.advance(self._now, self.pose, self.pose, STILL)
            c, s = cos_sin(self.pose.heading)
            self.pose = Pose(
                self.pose.x + c * twist.vx * STEP_S,
                self.pose.y + s * twist.vx * STEP_S,
                self.pose.heading + twist.omega * STEP_S,
            )
            self.been.append(self.pose.point)
            twists.append(twist)
        return twists

    @property
    def _now(self) -> Instant:
        return Instant(self.step * 100_000)

    def _sense(self) -> None:
        self.step += 1
        self.navigation.sense(self._now, self.pose, None)


def bend() -> Driven:
    """It came 1 m east, and then 1 m north-east round a quarter of a circle."""
    driven = Driven(Pose(1.0, 1.0, 0.0))
    driven.carried(*(Pose(1.0 + 0.05 * n, 1.0, 0.0) for n in range(21)))
    arc = [0.05 * n * math.pi / 2 for n in range(21)]
    driven.carried(*(Pose(2.0 + math.sin(a), 2.0 - math.cos(a), a) for a in arc))
    return driven


def test_it_goes_back_round_the_bend_as_it_came_and_stops_where_it_is_to() -> None:
    driven = bend()
    driven.navigation.take(GoalOrder.KEEP, None, 2.0)
    assert driven.navigation.backing_out
    assert min(twist.vx for twist in driven.steps(150)) == -0.2
    assert not driven.navigation.backing_out and driven.steps(1) == [STILL]
    assert driven.pose.point.distance_to(Point(1.57, 1.0)) < 0.2
    for point in driven.been:
        off = abs(point.distance_to(Point(2.0, 2.0)) - 1.0) if point.x > 2.0 else abs(point.y - 1.0)
        assert off < 0.06


def test_it_ends_with_the_trail_and_where_something_stands_behind() -> None:
    driven = Driven(Pose(1.0, 1.0, 0.0))
    driven.carried(*(Pose(1.0 + 0.05 * n, 1.0, 0.0) for n in range(11)))
    driven.navigation.take(GoalOrder.KEEP, None, FARTHEST_BACK)
    driven.steps(60)
    assert not driven.navigation.backing_out and 1.0 < driven.pose.x < 1.3
    driven = bend()
    driven.map.behind = False
    driven.navigation.take(GoalOrder.KEEP, None, 1.0)
    assert driven.steps(2) == [STILL, STILL] and not driven.navigation.backing_out


def test_a_goal_waits_in_the_phase_of_retreating_and_a_stop_ends_it() -> None:
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


def test_a_paused_robot_backs_out_once_it_goes_on() -> None:
    driven = bend()
    driven.navigation.take(GoalOrder.KEEP, True, 0.5)
    assert driven.steps(3) == [STILL] * 3
    driven.navigation.take(GoalOrder.KEEP, False)
    assert driven.steps(1)[0].vx < 0


def test_it_turns_its_back_first_to_what_is_not_behind() -> None:
    here = Pose(0.0, 0.0, 0.0)
    assert backward(here, Point(1.0, 0.1)).omega < 0 < backward(here, Point(1.0, -0.1)).omega
    assert backward(here, Point(-1.0, 0.0)) == Twist(-0.2, 0.0, 0.0)
    left, right = backward(here, Point(-1.0, 0.5)), backward(here, Point(-1.0, -0.5))
    assert left.vx == right.vx == -0.2 and left.omega == -right.omega < 0


def test_the_trail_is_as_long_as_anybody_may_back_out() -> None:
    trail, metre = Trail(), 1.02  # points 0.051 m apart
    for n in range(200):
        trail.take(Point(0.05 * metre * n, 0.0))
    ahead = [trail.behind(Point(0.05 * metre * (199 - n), 0.0)) for n in range(70)]
    assert ahead[0] is not None and ahead[0].x == pytest.approx(0.05 * metre * 194)
    assert sum(target is not None for target in ahead) == pytest.approx(56, abs=1)


def test_a_plan_says_how_far_and_how_long_it_is() -> None:
    driven = Driven(Pose(2.0, 1.7, 0.0))
    driven.navigation.take(Point(8.0, 1.7))
    driven.steps(1)
    plan = driven.navigation.plan
    assert plan is not None and plan.points[-1] == Point(8.0, 1.7)
    here = Point(5.0, 1.7)
    assert plan.distance_to_go(here) == pytest.approx(3.0, abs=0.3)
    assert in_seconds(plan.time_to_go(here)) == pytest.approx(9.0, abs=1.0)
    assert plan.ahead(here)[0].distance_to(here) < 0.2


def test_the_device_gives_the_order_once_and_a_stop_takes_it_back() -> None:
    device = RobotNavigation()
    device.back_out(1.0)
    assert device.backing_out and device.give() == (GoalOrder.KEEP, None, 1.0)
    assert device.give() == (GoalOrder.KEEP, None, None)
    device.back_out(1.0)
    device.stop()
    assert not device.backing_out and device.give() == (GoalOrder.CANCEL, None, None)
    device.stop()
    device.back_out(0.5)
    assert device.give() == (GoalOrder.CANCEL, None, 0.5)
