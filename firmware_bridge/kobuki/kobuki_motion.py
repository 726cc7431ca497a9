"""Differential drive of a Kobuki: conversion of velocities, and odometry from encoders and gyro.

Source: kobuki-base/kobuki_core, src/driver/diff_drive.cpp, and kobuki_node, odometry; the formula of
base control in protocol.rst lacks brackets.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from actors.geometry import wrap
from actors.instant import in_seconds
from actors.messages import Odometry
from actors.portable import cos, sin
from firmware_bridge.kobuki.kobuki_packets import BaseControl, BaseFeedback, BasicSensorData, WireMisuseError

TRACK: Final = 0.230
"""Distance between the wheels, m."""
WHEEL_RADIUS: Final = 0.035
"""Radius of a wheel, m."""
TICKS_PER_TURN: Final = 52 * 6545 / 132
"""Encoder ticks per turn of a wheel: 52 per turn of the motor, geared 6545 : 132."""
METRES_PER_TICK: Final = math.tau * WHEEL_RADIUS / TICKS_PER_TURN
"""85.292 µm."""
_NEGLIGIBLE: Final = 1e-4
"""Velocities below this count as zero, m/s and rad/s."""
_HALF_TRACK_MM: Final = 500 * TRACK
_LIMIT: Final = 0x7FFF


def base_control(v: float, omega: float) -> BaseControl:
    """Return the base control for `v` m/s forward and `omega` rad/s counter-clockwise, rounded towards zero.

    The speed is that of the outer wheel, computed with the unrounded radius. Two cases differ from the
    reference driver, where rounding changes the motion: a radius below 2 mm, which rounds to the code for
    turning in place, gets the speed for that; one beyond the field's range is sent as straight ahead. Raises
    WireMisuseError if a velocity is not finite.
    """
    if not (math.isfinite(v) and math.isfinite(omega)):
        raise WireMisuseError(f"velocity {v} m/s, {omega} rad/s is not finite")
    if abs(omega) < _NEGLIGIBLE:
        return BaseControl(_to_int16(1000 * v), 0)
    radius = 1000 * v / omega
    if abs(v) < _NEGLIGIBLE or abs(radius) < 2:
        return BaseControl(_to_int16(_HALF_TRACK_MM * omega), 1)
    if abs(radius) > _LIMIT:
        return BaseControl(_to_int16(1000 * v), 0)
    return BaseControl(_to_int16((radius + math.copysign(_HALF_TRACK_MM, radius)) * omega), int(radius))


def velocity(control: BaseControl) -> tuple[float, float]:
    """Return the velocity of a base control: m/s forward, rad/s counter-clockwise."""
    if control.radius == 0:
        return control.speed / 1000, 0.0
    if abs(control.radius) == 1:
        return 0.0, control.speed * control.radius / _HALF_TRACK_MM
    omega = control.speed / (control.radius + math.copysign(_HALF_TRACK_MM, control.radius))
    return control.radius * omega / 1000, omega


def ticks_between(before: BasicSensorData, after: BasicSensorData) -> tuple[int, int]:
    """Return the encoder ticks of left and right wheel between two feedbacks; uint16, which wrap."""
    left, right = after.left_ticks - before.left_ticks, after.right_ticks - before.right_ticks
    return ((left + 0x8000) & 0xFFFF) - 0x8000, ((right + 0x8000) & 0xFFFF) - 0x8000


def distances_between(before: BasicSensorData, after: BasicSensorData) -> tuple[float, float]:
    """Return the distances travelled by left and right wheel, m."""
    left, right = ticks_between(before, after)
    return left * METRES_PER_TICK, right * METRES_PER_TICK


def _to_int16(value: float) -> int:
    """Return the value rounded towards zero and clipped to int16."""
    return int(max(-_LIMIT - 1, min(_LIMIT, value)))


_CENTIDEGREE: Final = math.radians(0.01)
_STANDING: Final = 0.02
"""Velocities below this count as standstill, m/s and rad/s; own choice: a tick in 20 ms is 4 mm/s."""


_MAX_WHEEL_SPEED: Final = 2.0
"""Maximum plausible wheel speed, m/s; own choice, twice the maximum at 0.7 m/s while turning."""
_MAX_GYRO_RATE: Final = 12.0
"""Maximum plausible turn rate of the gyro, rad/s; own choice, twice the range of its rate's field."""
_SLACK: Final = 0.02
"""Tolerance of the time between two stamps, s: stamps and ticks are sampled at different times."""
LONGEST_GAP: Final = 3.0
"""Maximum time between two feedbacks, s; encoder ticks are ambiguous after 4 s at 0.7 m/s (half of 65536)."""
_FROZEN_TURN: Final = 0.2
"""Turn of the wheels with constant gyro values after which the gyro may be frozen, rad; our choice. Slip of a
wheel looks the same with a noise-free gyro, so other checks decide."""
_FROZEN_FEEDBACKS: Final = 25
"""Minimum number of such feedbacks."""


@dataclass
class OdometryCounts:
    """Counts of irregular feedback."""

    repeated: int = 0
    """Feedbacks with the same stamp as before; ignored."""
    implausible: int = 0
    """Feedbacks with implausibly fast motion; ignored."""
    restarts: int = 0
    """Restarts of the base's counters; the motion in between is unknown."""
    gaps: int = 0
    """Gaps in the feedback that are too long; the motion in between is unknown."""
    wheel_headings: int = 0
    """Turns computed from the wheels, without a working gyro."""


class _Motion(NamedTuple):
    """Motion between two feedbacks: s, m, m and rad."""

    time: float
    left: float
    right: float
    turn: float | None


class KobukiOdometry:
    """Odometry: integrates feedback to a pose in the frame of the first one."""

    def __init__(self) -> None:
        self.longest_gap = LONGEST_GAP
        self._last: BaseFeedback | None = None
        self._ignored: BaseFeedback | None = None
        """Last ignored feedback; if the next one is consistent with it, the base has restarted."""
        self._x = self._y = 0.0
        self._v = self._omega = 0.0
        self._constant_feedbacks = 0
        self._uncounted_turn = 0.0
        """Turn of the wheels since the gyro's values last changed, rad."""
        self._frozen = False
        self.heading = 0.0
        """Heading relative to the first feedback, unwrapped, rad."""
        self.counts = OdometryCounts()

    @property
    def unknown(self) -> int:
        """Number of periods of possible motion without feedback, which invalidate the pose."""
        return self.counts.gaps + self.counts.restarts

    @property
    def gyro_is_constant(self) -> bool:
        """True if the gyro's values stay constant while the wheels turn: one of them is faulty."""
        return self._constant_feedbacks >= _FROZEN_FEEDBACKS and abs(self._uncounted_turn) >= _FROZEN_TURN

    @property
    def uses_wheel_heading(self) -> bool:
        """True while the heading is computed from the wheels, without a working gyro."""
        return self._frozen

    def use_wheel_heading(self) -> None:
        """Use the heading of the wheels until the gyro's values change."""
        self._frozen = True

    @property
    def is_moving(self) -> bool:
        """True if the base moved between the last two feedbacks."""
        return abs(self._v) > _STANDING or abs(self._omega) > _STANDING

    def read(self) -> Odometry:
        """Return the pose since the first feedback, and the velocity between the last two."""
        return Odometry(self._x, self._y, wrap(self.heading), self._v, 0.0, self._omega)

    def set_standing(self) -> None:
        """Set the velocity to zero, after a loss of feedback."""
        self._v = self._omega = 0.0

    def take(self, feedback: BaseFeedback) -> None:
        """Add one feedback."""
        if self._last is None:
            self._last = feedback
            return
        if in_seconds(feedback.instant - self._last.instant) > self.longest_gap:
            self.counts.gaps += 1
            self._restart(feedback)
            return
        motion = _motion_between(self._last, feedback)
        if motion.time == 0:
            self.counts.repeated += 1
        elif self._is_plausible(motion):
            self._ignored = None
            self._add(motion, frozen=feedback.inertial == self._last.inertial)
            self._last = feedback
        elif self._ignored is not None and self._is_plausible(_motion_between(self._ignored, feedback)):
            self.counts.restarts += 1
            self._restart(feedback)
        else:
            self.counts.implausible += 1
            self._ignored = feedback

    def _restart(self, feedback: BaseFeedback) -> None:
        """Restart from this feedback, ignoring motion before it."""
        self._last, self._ignored = feedback, None
        self.set_standing()
        self._reset_gyro_check()

    def _reset_gyro_check(self) -> None:
        self._constant_feedbacks, self._uncounted_turn, self._frozen = 0, 0.0, False

    def _is_plausible(self, motion: _Motion) -> bool:
        time = motion.time + _SLACK
        return (
            0 < motion.time <= self.longest_gap
            and max(abs(motion.left), abs(motion.right)) <= _MAX_WHEEL_SPEED * time
            and (self._frozen or abs(motion.turn or 0.0) <= _MAX_GYRO_RATE * time)
        )

    def _add(self, motion: _Motion, frozen: bool) -> None:
        """Integrate a motion; `frozen`: the gyro's values are unchanged."""
        turn = self._turn(motion, frozen)
        forward = (motion.left + motion.right) / 2
        self._x += forward * cos(self.heading + turn / 2)
        self._y += forward * sin(self.heading + turn / 2)
        self.heading += turn
        self._v, self._omega = forward / motion.time, turn / motion.time

    def _turn(self, motion: _Motion, frozen: bool) -> float:
        """Return the gyro's turn, or the wheels' turn if the gyro is absent or known to be frozen."""
        by_wheels = (motion.right - motion.left) / TRACK
        if motion.turn is None or not frozen:
            # a recovering gyro may jump by a turn that is already counted from the wheels
            on_wheels = motion.turn is None or self._frozen
            self._reset_gyro_check()
            self.counts.wheel_headings += on_wheels
            return by_wheels if motion.turn is None or on_wheels else motion.turn
        self._constant_feedbacks += 1
        self._uncounted_turn += by_wheels
        if not self._frozen:
            return motion.turn
        self.counts.wheel_headings += 1
        turn_since, self._uncounted_turn = self._uncounted_turn, 0.0
        return turn_since


def _motion_between(before: BaseFeedback, after: BaseFeedback) -> _Motion:
    turn = None
    if before.inertial is not None and after.inertial is not None:
        turn = wrap((after.inertial.angle_cdeg - before.inertial.angle_cdeg) * _CENTIDEGREE)
    time = ((after.basic.stamp_ms - before.basic.stamp_ms) & 0xFFFF) / 1000
    return _Motion(time, *distances_between(before.basic, after.basic), turn)
