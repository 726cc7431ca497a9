"""Safety stop of a Kobuki: limits each commanded velocity, and reports the causes.

It limits every command before it is sent; no adaptation, setting or message bypasses it. A Kobuki's firmware
does not stop for bumper, cliff or wheel drop since 1.1.2.

Rules while a cause lasts:
- bumper or cliff: no wheel turns forward; backing off is allowed, also in arcs;
- wheel drop: no motion until both wheels carry the base and it has stood still for `_STILLNESS`;
- no feedback: no motion until feedback has been received for `_FEEDBACK_RECOVERY`;
- over-current at a wheel: no motion until `_OVERCURRENT_REST` after it;
- empty battery and external causes (`hold`): no motion;
- commands that are not finite or older than 0.2 s are not executed;
- otherwise speeds and accelerations are limited.
A stop is immediate, without a ramp; afterwards the base accelerates from standstill.
"""

import math
from enum import Enum
from typing import Final, NamedTuple

from actors.instant import Instant, in_seconds, milliseconds
from firmware_bridge.kobuki.kobuki_motion import TRACK, ticks_between
from firmware_bridge.kobuki.kobuki_packets import BaseFeedback, BasicSensorData, InertialSensorData

FEEDBACK_SILENCE: Final = milliseconds(100)
"""Timeout of feedback; kobuki_driver: 100 ms."""
_FEEDBACK_RECOVERY: Final = milliseconds(100)
"""Required duration of feedback after a silence before motion; own choice, five feedbacks."""
_COMMAND_AGE: Final = milliseconds(200)
"""Maximum age of a command; two steps."""
_STILLNESS: Final = milliseconds(1000)
"""Required standstill after a wheel drop before motion; own choice."""
_STILL_TICKS: Final = 2
"""Maximum change of encoder ticks between two feedbacks at standstill; own choice, 0.17 mm."""
_STILL_RATE_CDEG: Final = 200
"""Maximum gyro rate at standstill, 0.01°/s; own choice, far above its noise."""
_OVERCURRENT_REST: Final = milliseconds(1000)
"""Stop after the end of over-current; own choice."""
_SPEED: Final = 0.7
"""Maximum speed, m/s; Kobuki user guide."""
_TURN_RATE: Final = math.pi
"""Maximum turn rate, rad/s; Kobuki user guide: 180°/s (the gyro is less accurate above 110°/s)."""
_SPEED_UP, _TURN_UP = 0.3, 3.5
"""Maximum accelerations, m/s² and rad/s²; kobuki_driver's defaults."""
_SLOW_DOWN, _TURN_DOWN = 0.6, 4.2
"""Maximum decelerations. Own choice of 0.6, above kobuki_driver's 0.36; navigation plans with 1.0
(actors.robot.navigation.steering), so that this base stops later than planned."""
_MAX_RAMP_TIME: Final = milliseconds(60)
"""Limit of the time between two commands in ramps; own choice, three feedbacks: no jump after a suspended
host."""
_MIN_BACKWARD_RADIUS: Final = TRACK / 2 + 0.002
"""Minimum radius of backing off, m: half the track plus rounding to whole mm."""


class VelocityRamp:
    """Acceleration-limited velocity."""

    def __init__(self) -> None:
        self._at: Instant | None = None
        self.v = 0.0
        self.omega = 0.0

    def set(self, now: Instant, v: float, omega: float) -> None:
        """Set the velocity without limits."""
        self._at, self.v, self.omega = now, v, omega

    def towards(self, now: Instant, v: float, omega: float) -> tuple[float, float]:
        """Return the velocity at `now`, m/s and rad/s, ramped towards the target."""
        passed = 0 if self._at is None else max(0, min(now - self._at, _MAX_RAMP_TIME))
        time = in_seconds(passed)
        self.set(
            now,
            _ramp_step(self.v, v, _SPEED_UP * time, _SLOW_DOWN * time),
            _ramp_step(self.omega, omega, _TURN_UP * time, _TURN_DOWN * time),
        )
        return self.v, self.omega


def _ramp_step(value: float, target: float, up: float, down: float) -> float:
    """Return the value closest to `target` within one step; a change of sign stops at 0."""
    if value < 0:
        return -_ramp_step(-value, -target, up, down)
    if target > value:
        return min(target, value + up)
    return max(target, value - down, 0.0) if value > 0 else max(target, -up)


class HoldCause(Enum):
    """Cause that prevents or limits a commanded motion."""

    NO_FEEDBACK = "no feedback from the base"
    LINK_RECOVERING = "feedback from the base just restored"
    WHEEL_DROP = "wheel drop"
    PUT_DOWN = "just put down: waiting for standstill"
    BUMPER = "bumper pressed: backward only"
    CLIFF = "cliff ahead: backward only"
    OVERCURRENT = "over-current at a wheel: it may be blocked"
    BATTERY = "battery nearly empty"
    NOISE = "serial line of the base is noisy: feedback damaged"
    BASE_CLOCK = "clock of the base stopped or jumping"
    BUMPER_STUCK = "bumper still pressed after backing off"
    BLOCKED = "wheels do not follow commands: blocked, or encoders stopped"
    TURN_MISMATCH = "turns of wheels and gyro differ"
    LEFT_WHEEL = "left wheel contradicts gyro and command"
    RIGHT_WHEEL = "right wheel contradicts gyro and command"
    WHEELS = "both wheels contradict scans and command"
    GYRO = "gyro contradicts wheels and scans"
    REPEATED_DATA = "range sensor repeats identical data"
    SCAN_PART = "part of the scan is constant"
    SCAN_STILL = "scan is constant although wheels and gyro report motion"
    SCAN_ROTATED = "scan moves in another direction than wheels and gyro: sensor rotated on its mount"
    SCAN_MIRRORED = "scan moves as mirror image of wheels and gyro: sensor mounted upside down"
    SCAN_LATE = "scan lags behind wheels and gyro"
    NO_RANGE_DATA = "no range data"
    NO_GUARDIAN = "no guardian"
    NO_COMMAND = "no recent command"
    STALE_COMMAND = "command too old"
    BAD_COMMAND = "command is not finite"


_BACKWARD_ONLY: Final = frozenset({HoldCause.BUMPER, HoldCause.CLIFF})


class StopCause(NamedTuple):
    """An active cause."""

    cause: HoldCause
    since: Instant
    bits: int = 0
    """Bits of the sensor, as in the feedback; 0 for other causes."""


class AllowedMotion(NamedTuple):
    """Permitted velocity (m/s forward, rad/s counter-clockwise) and all active causes."""

    v: float
    omega: float
    stops: tuple[StopCause, ...]


class _Command(NamedTuple):
    arrived: Instant
    issued: Instant
    v: float
    omega: float


class SafetyStop:
    """State of the safety stop; it needs all feedback and all commands."""

    def __init__(self, started: Instant) -> None:
        self._started = started
        self._basic: BasicSensorData | None = None
        self._feedback_at = started
        self._silent_until: Instant | None = None
        """Time of the first feedback after a silence; None before the first one."""
        self._moved_at = started
        """Time of the last motion."""
        self._was_lifted = False
        self._overcurrent_at: Instant | None = None
        """Time of the last over-current."""
        self._external_causes: set[HoldCause] = set()
        self._command: _Command | None = None
        self._since: dict[HoldCause, Instant] = {}
        self._ramp = VelocityRamp()
        self.late_commands = 0
        """Number of ignored commands that were older than their predecessor."""

    def sense(self, feedback: BaseFeedback) -> None:
        """Process one feedback of the base."""
        now, basic, inertial = feedback
        if self._silent_until is None or now - self._feedback_at > FEEDBACK_SILENCE:
            self._silent_until = now
        if basic.wheel_drop:
            self._was_lifted = True
        if basic.wheel_drop or not self._is_still(basic, inertial):
            self._moved_at = now
        if basic.overcurrent:
            self._overcurrent_at = now
        self._basic, self._feedback_at = basic, now

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """Set or clear an external cause that prevents all motion."""
        (self._external_causes.add if holds else self._external_causes.discard)(cause)

    def command(self, now: Instant, issued: Instant, v: float, omega: float) -> None:
        """Accept a command decided at `issued`; ignore it if it is older than the last one.

        An `issued` in the future counts as `now`.
        """
        issued = min(issued, now)
        if self._command is not None and issued < self._command.issued:
            self.late_commands += 1
            return
        self._command = _Command(now, issued, v, omega)

    def allowed(self, now: Instant) -> AllowedMotion:
        """Return the permitted velocity from `now` on.

        Each call advances the ramp, so call it once per base control.
        """
        causes = self._causes(now)
        self._since = {cause: self._since.get(cause, now) for cause in causes}
        stops = tuple(
            StopCause(cause, self._since[cause], causes[cause]) for cause in HoldCause if cause in causes
        )
        standing = any(stop.cause not in _BACKWARD_ONLY for stop in stops)
        if standing or self._command is None:
            self._ramp.set(now, 0.0, 0.0)
            return AllowedMotion(0.0, 0.0, stops)
        _, _, v, omega = self._command
        excess = max(1.0, abs(v) / _SPEED, abs(omega) / _TURN_RATE)
        v, omega = v / excess, omega / excess  # on the same arc
        if not stops:
            return AllowedMotion(*self._ramp.towards(now, v, omega), stops)
        ramped = self._ramp.towards(now, *_backward_only(v, omega))
        v, omega = _backward_only(*ramped)  # stop forward motion immediately, without a ramp
        self._ramp.set(now, v, omega)
        return AllowedMotion(v, omega, stops)

    def _causes(self, now: Instant) -> dict[HoldCause, int]:
        """Return active causes with their sensor's bits."""
        causes: dict[HoldCause, int] = {}
        if self._basic is None or now - self._feedback_at > FEEDBACK_SILENCE:
            causes[HoldCause.NO_FEEDBACK] = 0
        elif self._silent_until is not None and now - self._silent_until < _FEEDBACK_RECOVERY:
            causes[HoldCause.LINK_RECOVERING] = 0
        if self._basic is not None:
            causes |= self._sensor_causes(now, self._basic)
        causes |= dict.fromkeys(self._external_causes, 0)
        command = self._command
        if command is None or now - command.arrived > _COMMAND_AGE:
            causes[HoldCause.NO_COMMAND] = 0
        elif now - command.issued > _COMMAND_AGE:
            causes[HoldCause.STALE_COMMAND] = 0
        elif not (math.isfinite(command.v) and math.isfinite(command.omega)):
            causes[HoldCause.BAD_COMMAND] = 0
        return causes

    def _sensor_causes(self, now: Instant, basic: BasicSensorData) -> dict[HoldCause, int]:
        causes = {}
        if basic.wheel_drop:
            causes[HoldCause.WHEEL_DROP] = basic.wheel_drop
        elif self._was_lifted:
            if self._feedback_at - self._moved_at < _STILLNESS:
                causes[HoldCause.PUT_DOWN] = 0
            else:
                self._was_lifted = False
        if self._overcurrent_at is not None and now - self._overcurrent_at <= _OVERCURRENT_REST:
            causes[HoldCause.OVERCURRENT] = basic.overcurrent
        if basic.bumper:
            causes[HoldCause.BUMPER] = basic.bumper
        if basic.cliff:
            causes[HoldCause.CLIFF] = basic.cliff
        return causes

    def _is_still(self, basic: BasicSensorData, inertial: InertialSensorData | None) -> bool:
        """Return whether the base has not moved since the last feedback."""
        if self._basic is None:
            return False
        turning = inertial is not None and abs(inertial.rate_cdeg) > _STILL_RATE_CDEG
        return max(map(abs, ticks_between(self._basic, basic))) <= _STILL_TICKS and not turning


def _backward_only(v: float, omega: float) -> tuple[float, float]:
    """Return the nearest velocity at which no wheel turns forward; zero for forward motion."""
    v = min(v, 0.0)
    bound = -v / _MIN_BACKWARD_RADIUS
    return v, max(-bound, min(bound, omega))
