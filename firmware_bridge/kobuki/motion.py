"""A Kobuki's base control: wheel speed and radius for a wanted velocity, and the velocity they make.

Source: kobuki-base/kobuki_core, src/driver/diff_drive.cpp; the formula in protocol.rst lacks brackets.
"""

import math
from typing import Final

from firmware_bridge.kobuki.packets import BaseControl
from firmware_bridge.kobuki.wire import WireMisuseError

TRACK: Final = 0.230
"""Between the wheels, m."""
WHEEL_RADIUS: Final = 0.035
"""m."""
TICKS_PER_TURN: Final = 52 * 6545 / 132
"""Encoder ticks per turn of a wheel: 52 per turn of the motor, geared 6545 : 132."""
METRES_PER_TICK: Final = math.tau * WHEEL_RADIUS / TICKS_PER_TURN
"""85.292 µm."""
_NOTHING: Final = 1e-4
"""Below it a velocity counts as none, m/s and rad/s."""
_HALF_TRACK_MM: Final = 500 * TRACK
_LIMIT: Final = 0x7FFF


def base_control(v: float, omega: float) -> BaseControl:
    """What to send for `v` m/s forward and `omega` rad/s counter-clockwise; towards zero, in whole mm.

    The speed is that of the outer wheel and has the radius unrounded in it. Two cases differ from the
    reference driver, which lets the wire's rounding turn them into something else: a radius below 2 mm, which
    rounds to the code for turning on the spot, gets the speed for that; one that does not fit is sent as
    straight ahead instead of a slight turn. Raises WireMisuseError where a velocity is no finite number.
    """
    if not (math.isfinite(v) and math.isfinite(omega)):
        raise WireMisuseError(f"a velocity of {v} m/s and {omega} rad/s; both should be finite")
    if abs(omega) < _NOTHING:
        return BaseControl(_whole(1000 * v), 0)
    radius = 1000 * v / omega
    if abs(v) < _NOTHING or abs(radius) < 2:
        return BaseControl(_whole(_HALF_TRACK_MM * omega), 1)
    if abs(radius) > _LIMIT:
        return BaseControl(_whole(1000 * v), 0)
    return BaseControl(_whole((radius + math.copysign(_HALF_TRACK_MM, radius)) * omega), int(radius))


def velocity(control: BaseControl) -> tuple[float, float]:
    """How the base moves: m/s forward, rad/s counter-clockwise."""
    if control.radius == 0:
        return control.speed / 1000, 0.0
    if abs(control.radius) == 1:
        return 0.0, control.speed * control.radius / _HALF_TRACK_MM
    omega = control.speed / (control.radius + math.copysign(_HALF_TRACK_MM, control.radius))
    return control.radius * omega / 1000, omega


def signed(difference: int) -> int:
    """A difference of two uint16 counters that wrap, as int16."""
    return ((difference + 0x8000) & 0xFFFF) - 0x8000


def _whole(value: float) -> int:
    """Towards zero, as far as an int16 goes."""
    return int(max(-_LIMIT - 1, min(_LIMIT, value)))
