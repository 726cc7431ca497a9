"""The safety stop: each of its rules as a story, and that nothing gets round them."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.geometry import Pose
from actors.instant import START, Instant
from firmware_bridge.kobuki.motion import TRACK, velocity
from firmware_bridge.kobuki.safety import (
    Allowed,
    HoldCause,
    Ramp,
    SafetyStop,
)
from firmware_bridge.kobuki.wire import BaseControl, Basic, Inertial
from tests.kobuki.drives import Rig
from tests.kobuki.room import Room


def fastest_wheel(v: float, omega: float) -> float:
    """Of both wheels the one that runs forward faster, m/s."""
    return v + abs(omega) * TRACK / 2


class Story:
    """A safety stop that hears the base every 20 ms and is asked just after."""

    def __init__(self) -> None:
        self.now = START
        self.safety = SafetyStop(START)
        self.ticks = 0
        self.rate = 0
        self.bumper = self.cliff = self.drop = self.overcurrent = 0
        self.silent = False
        self.allowed = Allowed(0.0, 0.0, ())

    def go(self, ms: int, v: float | None, omega: float = 0.0, late_ms: int = 0) -> Allowed:
        """`v` None: no command."""
        for _ in range(ms // 20):
            self.now = Instant(self.now + 20_000)
            if not self.silent:
                basic = Basic(
                    0,
                    self.bumper,
                    self.drop,
                    self.cliff,
                    self.ticks & 0xFFFF,
                    *5 * (0,),
                    160,
                    self.overcurrent,
                )
                self.safety.sense(self.now, basic, Inertial(0, self.rate))
            if v is not None:
                self.safety.wish(self.now, Instant(self.now - 1000 * late_ms), v, omega)
            self.allowed = self.safety.allowed(self.now)
        return self.allowed

    @property
    def causes(self) -> list[HoldCause]:
        return [stop.cause for stop in self.allowed.stops]


def rolling() -> Story:
    story = Story()
    story.go(3000, 0.4)
    assert story.allowed == Allowed(0.4, 0.0, ())
    return story


@pytest.mark.parametrize(("sensor", "cause"), [("bumper", HoldCause.BUMPER), ("cliff", HoldCause.CLIFF)])
def test_at_bumper_or_cliff_it_only_backs_off_until_released(sensor: str, cause: HoldCause) -> None:
    story = rolling()
    setattr(story, sensor, 2)
    allowed = story.go(20, 0.4)
    assert (allowed.v, allowed.omega) == (0.0, 0.0)  # at once, without a ramp
    assert [(stop.cause, stop.since, stop.bits) for stop in allowed.stops] == [(cause, story.now, 2)]
    story.go(2000, 0.4, 1.0)
    assert (story.allowed.v, story.allowed.omega) == (0.0, 0.0)
    story.go(2000, 0.0, 1.0)  # not even on the spot: a wheel would turn forward
    assert (story.allowed.v, story.allowed.omega) == (0.0, 0.0)
    story.go(2000, -0.2, 3.0)
    assert story.allowed.v == pytest.approx(-0.2)
    assert fastest_wheel(story.allowed.v, story.allowed.omega) <= 0
    assert story.allowed.omega > 1.5
    setattr(story, sensor, 0)
    story.go(3000, 0.4)
    assert story.allowed == Allowed(0.4, 0.0, ())


def test_over_current_stops_it_until_it_is_over_and_a_second_has_passed() -> None:
    story = rolling()
    story.overcurrent = 2
    story.go(20, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.OVERCURRENT])
    assert story.allowed.stops[0].bits == 2
    story.overcurrent = 0
    story.go(1000, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.OVERCURRENT])
    story.go(3000, 0.4)
    assert story.allowed == Allowed(0.4, 0.0, ())


def test_what_others_know_stops_it_at_once_for_as_long() -> None:
    story = rolling()
    story.safety.hold(HoldCause.BLIND, True)
    story.safety.hold(HoldCause.UNWATCHED, True)
    story.go(20, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.BLIND, HoldCause.UNWATCHED])
    story.safety.hold(HoldCause.BLIND, False)
    story.go(20, -0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.UNWATCHED])
    story.safety.hold(HoldCause.UNWATCHED, False)
    story.go(3000, 0.4)
    assert story.allowed == Allowed(0.4, 0.0, ())


def test_a_lifted_base_stands_until_it_was_put_down_and_stands_still() -> None:
    story = rolling()
    story.drop = 2
    story.go(20, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.WHEEL_DROP])
    story.go(5000, -0.4)  # not backward either
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.WHEEL_DROP])
    story.drop = 0
    for _ in range(100):  # pushed about on the floor
        story.ticks += 10
        story.go(20, 0.4)
        assert (story.allowed.v, story.causes) == (0.0, [HoldCause.PUT_DOWN])
    story.rate = 1000  # turned by hand
    story.go(2000, 0.4)
    assert story.causes == [HoldCause.PUT_DOWN]
    story.rate = 0
    story.go(980, 0.4)
    assert story.causes == [HoldCause.PUT_DOWN]
    story.go(40, 0.4)
    assert story.causes == []
    assert 0 < story.allowed.v < 0.02  # from standing


def test_without_feedback_for_100_ms_it_stands_until_feedback_has_come_for_a_while() -> None:
    story = rolling()
    story.silent = True
    story.go(100, 0.4)
    assert story.allowed.v == 0.4
    story.go(20, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.NO_FEEDBACK])
    story.silent = False
    story.go(100, 0.4)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.LINK_RECOVERING])
    story.go(20, 0.4)
    assert story.causes == []
    assert 0 < story.allowed.v < 0.02


def test_before_the_first_feedback_and_command_it_stands() -> None:
    story = Story()
    story.silent = True
    story.go(20, None)
    assert story.causes == [HoldCause.NO_FEEDBACK, HoldCause.NO_COMMAND]


def test_when_commands_fall_silent_it_stands() -> None:
    story = rolling()
    story.go(200, None)
    assert story.allowed.v == 0.4
    story.go(20, None)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.NO_COMMAND])


def test_a_command_older_than_200_ms_is_never_driven_however_often_it_comes() -> None:
    story = Story()
    story.go(200, None)
    story.go(3000, 0.4, late_ms=201)
    assert (story.allowed.v, story.causes) == (0.0, [HoldCause.STALE_COMMAND])
    story.go(3000, 0.4, late_ms=180)
    assert story.allowed == Allowed(0.4, 0.0, ())


def test_a_command_from_the_future_does_not_last_longer() -> None:
    story = Story()
    story.go(200, None)
    story.go(200, 0.4, late_ms=-10_000)
    assert story.causes == []
    story.go(220, None)
    assert story.causes == [HoldCause.NO_COMMAND]
    story.go(100, -0.4)  # nor keeps out those that follow
    assert story.causes == []
    assert story.allowed.v < 0


def test_a_command_that_was_overtaken_is_left_out() -> None:
    story = Story()
    story.go(1000, 0.0)
    story.go(1000, 0.4, late_ms=30)
    assert story.safety.late_commands == 1  # the first of them; the others are newer than the last
    story.safety.wish(story.now, Instant(story.now - 40_000), -0.4, 0.0)
    assert story.safety.late_commands == 2
    assert story.go(20, None).v > 0


@pytest.mark.parametrize(("v", "omega"), [(math.nan, 0.0), (0.1, math.inf), (-math.inf, 0.0)])
def test_what_is_no_number_stands_and_does_not_crash(v: float, omega: float) -> None:
    story = rolling()
    story.go(20, v, omega)
    assert (story.allowed.v, story.allowed.omega, story.causes) == (0.0, 0.0, [HoldCause.BAD_COMMAND])


def test_speeds_are_limited_on_the_same_arc() -> None:
    story = Story()
    story.go(10_000, 1.4, 2.0)
    assert (story.allowed.v, story.allowed.omega) == pytest.approx((0.7, 1.0))
    story.go(10_000, 0.5, 2 * math.pi)
    assert (story.allowed.v, story.allowed.omega) == pytest.approx((0.25, math.pi))


def test_it_speeds_up_as_the_reference_driver_and_slows_down_in_time() -> None:
    story = Story()
    story.go(200, 0.0)
    story.go(1000, 0.6, 5.0)
    assert (story.allowed.v, story.allowed.omega) == pytest.approx((0.3, math.pi))
    assert story.go(300, 0.0).v == pytest.approx(0.3 - 0.6 * 0.3)
    assert story.go(1000, -0.6).v < 0  # paused at nothing in between
    story = rolling()
    story.go(20, 0.0, 3.0)
    assert (story.allowed.v, story.allowed.omega) == pytest.approx((0.4 - 0.012, 0.07))


def test_a_ramp_makes_no_jump_after_a_pause() -> None:
    ramp = Ramp()
    assert ramp.towards(START, 1.0, 1.0) == (0.0, 0.0)
    assert ramp.towards(Instant(5_000_000), 1.0, 1.0) == pytest.approx((0.3 * 0.06, 3.5 * 0.06))


STEP = st.tuples(
    st.integers(1, 150),  # ms
    st.one_of(st.none(), st.tuples(*[st.sampled_from([0, 0, 0, 0, 1, 4])] * 3)),  # feedback
    st.one_of(st.none(), st.tuples(st.floats(-3, 3), st.floats(-9, 9), st.integers(-300, 300))),
)


@settings(max_examples=150, deadline=None)
@given(st.lists(STEP, max_size=40))
def test_whatever_happens_the_rules_hold(
    steps: list[tuple[int, tuple[int, int, int] | None, tuple[float, float, int] | None]],
) -> None:
    now, safety = START, SafetyStop(START)
    heard: Instant | None = None
    newest = -(10**12)
    bits = (0, 0, 0)
    before = 0.0
    for ms, feedback, command in steps:
        now = Instant(now + 1000 * ms)
        if feedback is not None:
            heard, bits = now, feedback
            safety.sense(now, Basic(0, bits[0], bits[1], bits[2], 0, 0, 0, 0, 0, 0, 160, 0), None)
        if command is not None:
            issued = Instant(now - 1000 * command[2])
            newest = max(newest, min(issued, now))
            safety.wish(now, issued, command[0], command[1])
        allowed = safety.allowed(now)
        moving = (allowed.v, allowed.omega) != (0.0, 0.0)
        if heard is None or now - heard > 100_000 or now - newest > 200_000 or bits[1]:
            assert not moving
        if bits[0] or bits[2]:
            assert fastest_wheel(allowed.v, allowed.omega) <= 0
        assert abs(allowed.v) <= 0.7
        assert abs(allowed.omega) <= math.pi
        assert abs(allowed.v) - abs(before) <= 0.3 * 0.06 + 1e-9
        before = allowed.v


# --- the same on the wire ---


def last_controls(rig: Rig, count: int) -> list[BaseControl]:
    return [c for _, c in rig.base.heard if isinstance(c, BaseControl)][-count:]


def test_a_base_that_drives_into_a_wall_stops_and_can_back_off() -> None:
    rig = Rig(room=Room(4.0, 4.0), pose=Pose(3.0, 2.0, 0.1))
    rig.run(5.0, (0.4, 0.0))
    touched = rig.body.truth().pose
    assert touched.x == pytest.approx(4.0 - 0.177, abs=1e-6)
    assert rig.driver.pressed() & 2
    assert last_controls(rig, 5) == [BaseControl(0, 0)] * 5
    rig.run(3.0, (-0.2, 0.0))
    assert rig.body.truth().pose.x < touched.x - 0.3
    assert rig.driver.allowed.stops == ()


def test_when_the_base_falls_silent_it_is_told_to_stand_all_the_same() -> None:
    rig = Rig()
    rig.run(3.0, (0.4, 0.0))
    rig.base.faults.silent = True
    cut = rig.now
    rig.run(0.5, (0.4, 0.0))
    assert last_controls(rig, 5) == [BaseControl(0, 0)] * 5
    moving = [at for at, c in rig.base.heard if isinstance(c, BaseControl) and c.speed]
    assert moving[-1] - cut <= 140_000
    assert rig.body.truth().v == 0.0


def test_no_control_with_motion_is_sent_once_a_command_is_too_old() -> None:
    rig = Rig()
    rig.run(3.0, (0.4, 0.0))
    last = rig.now
    rig.run(1.0)
    moving = [at for at, c in rig.base.heard if isinstance(c, BaseControl) and c.speed]
    assert moving[-1] - last <= 200_000
    assert rig.body.truth().v == 0.0


@pytest.mark.parametrize("fault", ["bumper", "cliff", "wheel_drop"])
def test_a_fault_stops_the_base_within_two_feedbacks(fault: str) -> None:
    rig = Rig()
    rig.run(3.0, (0.4, 0.3))
    setattr(rig.base.faults, fault, 1)
    rig.run(0.05, (0.4, 0.3))
    assert velocity(last_controls(rig, 1)[0]) == (0.0, 0.0)
    assert rig.body.truth().v == 0.0
