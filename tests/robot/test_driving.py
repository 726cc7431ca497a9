"""What the driver commands in single situations."""

import math
from dataclasses import replace

import numpy as np
import pytest

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Odometry, Scan
from actors.robot.driving import Driver, DrivingParameters
from actors.robot.planning import ground
from actors.robot.surroundings import Surroundings
from tests.robot.base import TWO_ROOMS, FakeBase, model

RADIUS = 0.177
NOW = Instant(0)
DEFAULTS = DrivingParameters()
EAST = np.column_stack((np.linspace(1.0, 4.0, 61), np.full(61, 1.75)))


class Cockpit:
    """A driver on a path to the east, at a pose, with what it sees there."""

    def __init__(self, pose: Pose, parameters: DrivingParameters = DEFAULTS) -> None:
        self.base = FakeBase(TWO_ROOMS, model(), pose)
        self.surroundings = Surroundings(model().sensor)
        self.driver = Driver(ground(TWO_ROOMS, RADIUS), self.surroundings, RADIUS, 0.1, parameters)
        self.driver.follow(EAST)

    def see(self, *obstacles: tuple[Point, float]) -> None:
        self.base.obstacles = list(obstacles)
        senses = self.base.senses(0)
        self.surroundings.take(NOW, senses.odometry, senses.scan)


def dead_end(free: float) -> list[tuple[Point, float]]:
    """Round obstacles around a robot at (1.5, 1.75), so that it gets `free` forward, and no way around."""
    ahead = 1.5 + RADIUS + DEFAULTS.gap + free + 0.2
    return [(Point(ahead, 1.75 + y), 0.2) for y in (0.0, -0.3, 0.3)] + [
        (Point(1.5 + x, 1.75 + y), 0.2) for x in (0.0, 0.3) for y in (-0.5, 0.5)
    ]


def test_on_the_path_it_drives_straight_and_speeds_up_no_faster_than_the_base_can() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    cockpit.see()
    for speed, commanded in [(0.0, 0.1), (0.2, 0.3), (0.45, 0.5), (0.5, 0.5)]:
        steering = cockpit.driver.steer(NOW, cockpit.base.pose, Twist(speed, 0.0, 0.0))
        assert not steering.blocked
        assert steering.twist == pytest.approx((commanded, 0.0, 0.0), abs=1e-9)


def test_it_starts_from_rest_in_steps_of_any_length() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    cockpit.see()
    driver = Driver(ground(TWO_ROOMS, RADIUS), cockpit.surroundings, RADIUS, 0.01, DrivingParameters())
    driver.follow(EAST)
    assert driver.steer(NOW, cockpit.base.pose, STILL).twist.vx == DrivingParameters().creep


@pytest.mark.parametrize(("heading", "sign"), [(1.5, -1), (-1.5, 1), (3.0, -1), (-3.0, 1)])
def test_facing_away_it_turns_on_the_spot_the_short_way_round(heading: float, sign: int) -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, heading))
    cockpit.see((Point(1.5 + 0.3 * math.cos(heading), 1.75 + 0.3 * math.sin(heading)), 0.05))
    twist, blocked = cockpit.driver.steer(NOW, cockpit.base.pose, STILL)
    assert not blocked
    assert twist == pytest.approx((0.0, 0.0, sign * 0.2))  # 2 rad/s² for 0.1 s
    turning = Twist(0.0, 0.0, sign * 1.4)
    assert cockpit.driver.steer(NOW, cockpit.base.pose, turning).twist.omega == sign * 1.5


def test_it_slows_down_so_that_it_stops_before_an_obstacle() -> None:
    p = DrivingParameters()
    for free in [0.1, 0.2, 0.3]:
        cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
        cockpit.see(*dead_end(free))
        twist, blocked = cockpit.driver.steer(NOW, cockpit.base.pose, Twist(0.5, 0.0, 0.0))
        assert not blocked
        needed = twist.vx * p.delay + twist.vx**2 / (2 * p.braking)
        assert needed == pytest.approx(free, abs=0.015)  # the fake rays go in strides of 1 cm


def test_before_an_obstacle_it_is_blocked_and_stands() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    cockpit.see((Point(1.95, 1.75), 0.2))
    twist, blocked = cockpit.driver.steer(NOW, cockpit.base.pose, STILL)
    assert blocked and twist == pytest.approx((0.0, 0.0, 0.0))


def test_it_passes_what_stands_beside_the_path() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    cockpit.see((Point(1.7, 1.75 + RADIUS + 0.22), 0.2), (Point(1.6, 1.75 - RADIUS - 0.22), 0.2))
    twist, blocked = cockpit.driver.steer(NOW, cockpit.base.pose, Twist(0.5, 0.0, 0.0))
    assert not blocked and twist.vx == 0.5


def test_once_blocked_it_waits_for_more_room_than_it_needed_to_go_on() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    blocked = []
    for free in [0.05, 0.0, 0.05, 0.08, 0.05]:
        cockpit.see(*dead_end(free))
        blocked.append(cockpit.driver.steer(NOW, cockpit.base.pose, STILL).blocked)
    assert blocked == [False, True, True, False, False]


def test_a_new_goal_forgets_the_wait() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    cockpit.see((Point(1.95, 1.75), 0.2))
    assert cockpit.driver.steer(NOW, cockpit.base.pose, STILL).blocked
    cockpit.driver.begin()
    cockpit.see((Point(1.5 + RADIUS + 0.08 + 0.05 + 0.2, 1.75), 0.2))
    assert not cockpit.driver.steer(NOW, cockpit.base.pose, STILL).blocked


def test_without_a_fresh_scan_it_stands() -> None:
    cockpit = Cockpit(Pose(1.5, 1.75, 0.0))
    driving = Twist(0.5, 0.0, 0.0)
    assert cockpit.driver.steer(NOW, cockpit.base.pose, driving) == (STILL, True)
    cockpit.see()
    assert not cockpit.driver.steer(Instant(500_000), cockpit.base.pose, driving).blocked
    assert cockpit.driver.steer(Instant(500_001), cockpit.base.pose, driving) == (STILL, True)


def test_towards_the_end_of_the_path_it_slows_down() -> None:
    cockpit = Cockpit(Pose(3.9, 1.75, 0.0))
    cockpit.driver.follow(EAST[50:])
    cockpit.see()
    twist, _ = cockpit.driver.steer(NOW, cockpit.base.pose, Twist(0.5, 0.0, 0.0))
    assert twist.vx == pytest.approx(math.sqrt(2 * 0.4 * 0.1))


def test_no_command_exceeds_the_limits() -> None:
    parameters = replace(DrivingParameters(), speed=0.3, turn_rate=0.8)
    rng = np.random.default_rng(5)
    for _ in range(200):
        pose = Pose(*rng.uniform((0.6, 0.6, -3), (4.4, 3.0, 3)).tolist())
        cockpit = Cockpit(pose, parameters)
        ranges = rng.integers(300, 3000, 180).astype("<u2")
        ranges[rng.random(180) < 0.5] = NO_ECHO_MM
        cockpit.surroundings.take(NOW, Odometry(0, 0, 0, 0, 0, 0), Scan(0, ranges.tobytes()))
        twist = cockpit.driver.steer(NOW, pose, STILL).twist
        assert 0.0 <= twist.vx <= 0.3 and abs(twist.omega) <= 0.8 and twist.vy == 0.0
