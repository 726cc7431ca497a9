"""Where a base believes to be: against the truth, over counters that wrap, with and without its gyro."""

import dataclasses
import math

import pytest

from actors.geometry import Pose, wrap
from actors.instant import Instant
from actors.world.odometry import KobukiErrors
from firmware_bridge.kobuki.base import BaseParameters
from firmware_bridge.kobuki.motion import KobukiOdometry
from firmware_bridge.kobuki.wire import Basic, Inertial
from tests.kobuki.drives import Rig

DRIVE = (
    (4.0, 0.5, 0.0), (6.0, 0.4, 0.8), (2.0, 0.0, -2.0),
    (5.0, -0.3, 0.4), (60.0, 0.4, 0.25), (2.0, 0.0, 0.0),
)  # fmt: skip
"""Seconds, m/s, rad/s: straight, arcs, on the spot, backward; 79 s, 29 m, 3 turns left."""
WRAPPING = BaseParameters(stamp_ms=60_000, left_ticks=65_000, right_ticks=200, angle=3.0)
"""All counters wrap: stamp once or twice, the encoders five times, the angle in each turn."""


def drive(rig: Rig) -> float:
    """Drive all of it; the length of the way, m."""
    way = 0.0
    last = rig.body.truth().pose

    def follow() -> None:
        nonlocal way, last
        here = rig.body.truth().pose
        way += here.point.distance_to(last.point)
        last = here

    for seconds, v, omega in DRIVE:
        rig.run(seconds, (v, omega), follow)
    return way


def errors(rig: Rig, start: Pose) -> tuple[float, float]:
    """Of position, m, and heading, rad."""
    truth = start.relative(rig.body.truth().pose)
    odometry = rig.driver.odometry.read()
    return (
        math.hypot(odometry.x - truth.x, odometry.y - truth.y),
        abs(wrap(odometry.heading - truth.heading)),
    )


def test_an_exact_base_is_followed_to_the_millimetre_over_all_wraps() -> None:
    rig = Rig(WRAPPING, pose=Pose(10.0, 8.0, 2.0))
    start = rig.body.truth().pose
    way = drive(rig)
    assert rig.driver.reception.skipped == 0
    assert way == pytest.approx(29.0, abs=2.0)
    position, heading = errors(rig, start)
    assert position < 0.001
    assert heading < 0.0005
    counts = rig.driver.odometry.counts
    assert (counts.implausible, counts.restarts, counts.gaps, counts.on_wheels) == (0, 0, 0, 0)
    assert rig.driver.odometry.heading > 3 * math.pi  # unwrapped


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_base_with_a_real_ones_errors_stays_within_a_hundredth_of_its_way(seed: int) -> None:
    rig = Rig(dataclasses.replace(WRAPPING, errors=KobukiErrors()), pose=Pose(10.0, 8.0, 2.0), seed=seed)
    start = rig.body.truth().pose
    way = drive(rig)
    position, heading = errors(rig, start)
    assert position < 0.01 * way
    assert heading < 0.05
    assert rig.driver.odometry.counts.implausible == 0


def test_velocity_is_that_of_the_body() -> None:
    rig = Rig()
    rig.run(4.0, (0.3, 0.5))
    odometry, truth = rig.driver.odometry.read(), rig.body.truth()
    assert odometry.vx == pytest.approx(truth.v, abs=0.005)  # a tick in 20 ms is 4 mm/s
    assert odometry.vy == 0.0
    assert odometry.omega == pytest.approx(truth.omega, abs=0.01)


@pytest.mark.parametrize("gyro", ["absent", "frozen"])
def test_without_its_gyro_the_wheels_give_the_heading_and_that_is_counted(gyro: str) -> None:
    rig = Rig(pose=Pose(10.0, 8.0, 2.0))
    start = rig.body.truth().pose
    counts = rig.driver.odometry.counts
    rig.run(2.0, (0.3, 0.5))
    assert counts.on_wheels == 0
    rig.base.faults.gyro = gyro  # type: ignore[assignment]
    rig.run(0.55, (0.3, 0.5))
    assert rig.driver.odometry.gyro_is_still == (gyro == "frozen")
    if gyro == "frozen":
        rig.driver.odometry.trust_wheels()
    rig.run(5.45, (0.3, 0.5))
    assert counts.on_wheels > 200
    position, heading = errors(rig, start)
    assert position < 0.05
    assert heading < 0.02
    rig.base.faults.gyro = "works"
    rig.run(0.1, (0.3, 0.5))
    on_wheels = counts.on_wheels
    rig.run(3.9, (0.3, 0.5))
    assert counts.on_wheels == on_wheels
    assert errors(rig, start)[1] < 0.03
    assert (counts.implausible, counts.restarts) == (0, 0)


def test_a_still_gyro_of_a_still_base_is_not_frozen() -> None:
    rig = Rig()
    rig.run(3.0, (0.0, 0.0))
    assert rig.driver.odometry.counts.on_wheels == 0


def test_a_gyro_free_of_noise_is_believed_whatever_wheels_add_up_to_on_a_long_straight_way() -> None:
    # 17 m, and by the wheels a fifth of a radian
    ticks = [(20 * k, 100 * k, 100 * k + k // 4, 0) for k in range(2000)]
    odometry = fed(ticks)
    assert odometry.counts.on_wheels == 0
    assert odometry.heading == 0.0


def basic(stamp_ms: int, left: int, right: int) -> Basic:
    return Basic(stamp_ms, 0, 0, 0, left, right, 0, 0, 0, 0, 160, 0)


def fed(readings: list[tuple[int, int, int, int]]) -> KobukiOdometry:
    odometry = KobukiOdometry()
    for ms, left, right, angle in readings:
        odometry.take(Instant(1000 * ms), basic(ms & 0xFFFF, left, right), Inertial(angle, 0))
    return odometry


def test_damaged_numbers_are_left_out_and_the_way_is_not_lost() -> None:
    odometry = fed([(0, 0, 0, 0), (20, 100, 100, 0), (40, 30_000, 200, 0), (60, 300, 300, 0)])
    assert odometry.counts.implausible == 1
    assert odometry.read().x == pytest.approx(300 * 85.292e-6, rel=1e-5)


def test_a_base_that_was_switched_off_and_on_goes_on_from_where_it_was() -> None:
    odometry = fed([(40_000, 0, 0, 0), (40_020, 100, 100, 0)])
    before = odometry.read().x
    for ms, ticks in ((5, 30_000), (25, 30_100), (45, 30_200)):
        odometry.take(Instant(41_000_000 + 1000 * ms), basic(ms, ticks, ticks), Inertial(9000, 0))
    assert odometry.counts.restarts == 1
    assert odometry.read().x == pytest.approx(before + 100 * 85.292e-6, rel=1e-5)
    assert odometry.read().heading == 0.0


def test_after_a_long_gap_ticks_say_nothing() -> None:
    odometry = fed([(0, 0, 0, 0), (3_020, 20_000, 20_000, 0), (3_040, 20_100, 20_100, 0)])
    assert odometry.counts.gaps == 1
    assert odometry.read().x == pytest.approx(100 * 85.292e-6, rel=1e-5)


def test_the_same_stamp_twice_is_no_motion() -> None:
    odometry = fed([(0, 0, 0, 0), (20, 100, 100, 0), (20, 100, 100, 0)])
    assert odometry.counts.repeated == 1
    assert odometry.read().vx == pytest.approx(100 * 85.292e-6 / 0.02, rel=1e-5)
