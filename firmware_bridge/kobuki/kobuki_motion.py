"""Differential drive of a Kobuki: conversion of velocities, feedback, and limits.

Source: kobuki-base/kobuki_core, src/driver/diff_drive.cpp; the formula of base control in
protocol.rst lacks brackets.
"""

import math
from typing import Final, NamedTuple

from actors.geometry import wrap
from actors.instant import Duration, Instant, milliseconds
from firmware_bridge.base_feedback import DriveLimits, WheelMotion
from firmware_bridge.kobuki.kobuki_packets import (
    BaseControl,
    BasicSensorData,
    InertialSensorData,
    WireMisuseError,
)

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
        return BaseControl(to_int16(1000 * v), 0)
    radius = 1000 * v / omega
    if abs(v) < _NEGLIGIBLE or abs(radius) < 2:
        return BaseControl(to_int16(_HALF_TRACK_MM * omega), 1)
    if abs(radius) > _LIMIT:
        return BaseControl(to_int16(1000 * v), 0)
    return BaseControl(to_int16((radius + math.copysign(_HALF_TRACK_MM, radius)) * omega), int(radius))


def velocity(control: BaseControl) -> tuple[float, float]:
    """Return the velocity of a base control: m/s forward, rad/s counter-clockwise."""
    if control.radius == 0:
        return control.speed / 1000, 0.0
    if abs(control.radius) == 1:
        return 0.0, control.speed * control.radius / _HALF_TRACK_MM
    omega = control.speed / (control.radius + math.copysign(_HALF_TRACK_MM, control.radius))
    return control.radius * omega / 1000, omega


def _distance(ticks: int) -> float:
    """Return the distance of a wheel for a difference of encoder ticks, m; uint16, which wrap."""
    return (((ticks + 0x8000) & 0xFFFF) - 0x8000) * METRES_PER_TICK


def to_int16(value: float) -> int:
    """Return the value rounded towards zero and clipped to int16."""
    return int(max(-_LIMIT - 1, min(_LIMIT, value)))


_CENTIDEGREE: Final = math.radians(0.01)


class BaseFeedback(NamedTuple):
    """One feedback of a Kobuki, with its time of arrival: a DriveFeedback."""

    instant: Instant
    basic: BasicSensorData
    gyro: InertialSensorData | None
    """None without a gyro or with a faulty one."""

    @property
    def turn_rate(self) -> float | None:
        """Turn rate by the gyro, rad/s."""
        return None if self.gyro is None else math.radians(self.gyro.rate_cdeg / 100)

    def since(self, before: "BaseFeedback") -> WheelMotion:
        """Return the motion since an earlier feedback."""
        turn = None
        if before.gyro is not None and self.gyro is not None:
            turn = wrap((self.gyro.angle_cdeg - before.gyro.angle_cdeg) * _CENTIDEGREE)
        advance = Duration(((self.basic.stamp_ms - before.basic.stamp_ms) & 0xFFFF) * 1000)
        left = _distance(self.basic.left_ticks - before.basic.left_ticks)
        right = _distance(self.basic.right_ticks - before.basic.right_ticks)
        return WheelMotion(advance, left, right, turn)


KOBUKI_LIMITS: Final = DriveLimits(
    track=TRACK,
    speed=0.7,  # Kobuki user guide
    turn_rate=math.pi,  # Kobuki user guide: 180°/s (the gyro is less accurate above 110°/s)
    speed_up=0.3,  # kobuki_driver's defaults
    # Own choice, above kobuki_driver's 0.36; navigation plans with 1.0 (actors.robot.navigation.steering), so
    # that this base stops later than planned.
    slow_down=0.6,
    turn_up=3.5,  # kobuki_driver's defaults
    turn_down=4.2,
    silence=milliseconds(100),  # kobuki_driver
    still=2 * METRES_PER_TICK,  # own choice, 0.17 mm
    wheel_speed=2.0,  # own choice, twice the maximum at 0.7 m/s while turning
)
