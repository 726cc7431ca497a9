"""Motion of a base: base control, odometry against the truth, and the emulated base."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.geometry import Pose, wrap
from actors.instant import Instant
from actors.world.odometry import KobukiErrors
from firmware_bridge.kobuki.base import BaseParameters
from firmware_bridge.kobuki.motion import KobukiOdometry, base_control, velocity
from firmware_bridge.kobuki.wire import (
    BaseControl,
    Basic,
    Inertial,
    WireMisuseError,
)
from tests.kobuki.drives import Rig
from tests.kobuki.room import Room, Unicycle

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
    rig.run(3.0, (0.0, 0.0))
    assert counts.on_wheels == 0, "a still gyro of a still base is not frozen"


@pytest.mark.parametrize("seed", [1, 2])
def test_a_base_with_a_real_ones_errors_stays_within_a_hundredth_of_its_way(seed: int) -> None:
    rig = Rig(dataclasses.replace(WRAPPING, errors=KobukiErrors()), pose=Pose(10.0, 8.0, 2.0), seed=seed)
    start = rig.body.truth().pose
    way = drive(rig)
    position, heading = errors(rig, start)
    assert position < 0.01 * way
    assert heading < 0.05
    assert rig.driver.odometry.counts.implausible == 0


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


@pytest.mark.parametrize(
    ("v", "omega", "speed", "radius"),
    [
        (0.0, 0.0, 0, 0),
        (0.5, 0.0, 500, 0),
        (0.0, 1.0, 115, 1),  # on the spot: 1000 * 0.23 * 1 / 2
        (0.0, -1.0, -115, 1),
        (0.0015, 1.0, 115, 1),  # radius 1.5 mm would be sent as 1: the same
        (-0.0015, 1.0, 115, 1),
        (0.002, 1.0, 117, 2),  # the first radius of its own: 2 + 115
        (0.2, 0.5, 257, 400),  # 400 mm; (400 + 115) * 0.5 = 257.5 towards zero
        (0.2, -0.5, 257, -400),  # (-400 - 115) * -0.5
        (0.3, 0.7, 380, 428),  # 428.57 mm, the speed from the radius unrounded: 380.5
        (0.5, 0.0153, 501, 32679),
        (0.5, 0.0152, 500, 0),  # 32894 mm does not fit: straight, not a slight turn
        (-40.0, 0.0, -32768, 0),
    ],
)
def test_the_formula(v: float, omega: float, speed: int, radius: int) -> None:
    assert base_control(v, omega) == BaseControl(speed, radius)


@pytest.mark.parametrize(("v", "omega"), [(math.nan, 0.0), (0.0, math.inf)])
def test_velocities_that_are_no_numbers_are_our_own_misuse(v: float, omega: float) -> None:
    with pytest.raises(WireMisuseError, match="both should be finite"):
        base_control(v, omega)


@given(st.floats(-0.7, 0.7), st.floats(-math.pi, math.pi))
def test_the_base_moves_as_wanted_within_the_wires_resolution(v: float, omega: float) -> None:
    back_v, back_omega = velocity(base_control(v, omega))
    # Rounding the speed costs 1 mm/s of the outer wheel, rounding the radius up to 2 mm of it.
    assert back_v == pytest.approx(v, abs=0.0012 + 0.0022 * abs(omega))
    if abs(omega) > 0.03:
        assert back_omega == pytest.approx(omega, abs=0.01 + 0.01 * abs(omega))


@pytest.mark.parametrize(("heading", "bits"), [(0.0, 2), (1.0, 1), (-1.0, 4), (3.0, 0), (0.785, 1 | 4)])
def test_the_bumper_has_three_sectors(heading: float, bits: int) -> None:
    corner = heading == 0.785
    body = Unicycle(Pose(3.8, 3.8 if corner else 2.0, heading), Room(4.0, 4.0))
    body.drive(0.3 if heading < 2 else -0.3, 0.0)
    body.advance(Instant(2_000_000))
    assert body.bumper() == bits
