"""Safety stop of a differential base, and the common part of the bases' drivers.

The stop limits each commanded velocity, and reports the causes. It limits every command before it is sent; no
adaptation, setting or message bypasses it. A Kobuki's firmware does not stop for bumper, cliff or wheel drop
since 1.1.2.

Rules while a cause lasts:
- bumper or cliff: no wheel turns forward; backing off is allowed, also in arcs;
- wheel drop: no motion until both wheels carry the base and it has stood still for `_STILLNESS`;
- backup limit: no backward motion;
- no feedback: no motion until feedback has been received for as long as its timeout;
- over-current at a wheel: no motion until `_OVERCURRENT_REST` after it;
- empty battery and external causes (`hold`): no motion;
- commands that are not finite or older than 0.2 s are not executed;
- otherwise speeds and accelerations are limited.
A stop is immediate, without a ramp; afterwards the base accelerates from standstill.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from enum import Enum
from typing import Final, NamedTuple

from actors.instant import Instant, in_seconds, milliseconds
from firmware_bridge.base_feedback import DriveFeedback, DriveLimits, HazardState
from firmware_bridge.wheel_odometry import WheelOdometry

_COMMAND_AGE: Final = milliseconds(200)
"""Maximum age of a command; two steps."""
_STILLNESS: Final = milliseconds(1000)
"""Required standstill after a wheel drop before motion; own choice."""
_STILL_RATE: Final = math.radians(2)
"""Maximum gyro rate at standstill, rad/s; own choice, far above its noise."""
_OVERCURRENT_REST: Final = milliseconds(1000)
"""Stop after the end of over-current; own choice."""
_MAX_RAMP_TIME: Final = milliseconds(60)
"""Limit of the time between two commands in ramps; own choice, three feedbacks: no jump after a suspended
host."""
_RADIUS_MARGIN: Final = 0.002
"""Margin of the minimum radius of backing off, m: a Kobuki's is rounded to whole mm."""


class VelocityRamp:
    """Acceleration-limited velocity."""

    def __init__(self, limits: DriveLimits) -> None:
        self._limits = limits
        self._at: Instant | None = None
        self.v = 0.0
        self.omega = 0.0

    def set(self, now: Instant, v: float, omega: float) -> None:
        """Set the velocity without limits."""
        self._at, self.v, self.omega = now, v, omega

    def towards(self, now: Instant, v: float, omega: float) -> tuple[float, float]:
        """Return the velocity at `now`, m/s and rad/s, ramped towards the target."""
        passed = 0 if self._at is None else max(0, min(now - self._at, _MAX_RAMP_TIME))
        time, limits = in_seconds(passed), self._limits
        self.set(
            now,
            _ramp_step(self.v, v, limits.speed_up * time, limits.slow_down * time),
            _ramp_step(self.omega, omega, limits.turn_up * time, limits.turn_down * time),
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
    BACKUP_LIMIT = "backup limit of the base: forward only"
    OVERCURRENT = "over-current at a wheel: it may be blocked"
    WHEELS_DISABLED = "wheels disabled by the base: emergency stop"
    DOCKED = "docked: undock the robot"
    NO_SUBSCRIBER = "robot does not subscribe to velocity commands"
    COMMAND_TYPE = "type of velocity commands is unclear or unknown"
    OTHER_PUBLISHER = "another node commands velocities"
    LATE_DATA = "messages of the robot are late, or its clock was set back"
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

    def __init__(self, started: Instant, limits: DriveLimits) -> None:
        self._limits = limits
        self._feedback: DriveFeedback | None = None
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
        self._ramp = VelocityRamp(limits)
        self.late_commands = 0
        """Number of ignored commands that were older than their predecessor."""

    def sense(self, feedback: DriveFeedback) -> None:
        """Process one feedback of the base."""
        now = feedback.instant
        if self._silent_until is None or now - self._feedback_at > self._limits.silence:
            self._silent_until = now
        if feedback.basic.wheel_drop:
            self._was_lifted = True
        if feedback.basic.wheel_drop or not self._is_still(feedback):
            self._moved_at = now
        if feedback.basic.overcurrent:
            self._overcurrent_at = now
        self._feedback, self._feedback_at = feedback, now

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """Set or clear an external cause, which prevents all motion but that of its rule above."""
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
        if causes.keys() - _BACKWARD_ONLY - {HoldCause.BACKUP_LIMIT} or self._command is None:
            self._ramp.set(now, 0.0, 0.0)
            return AllowedMotion(0.0, 0.0, stops)
        _, _, v, omega = self._command
        excess = max(1.0, abs(v) / self._limits.speed, abs(omega) / self._limits.turn_rate)
        v, omega = v / excess, omega / excess  # on the same arc
        if not stops:
            return AllowedMotion(*self._ramp.towards(now, v, omega), stops)
        ramped = self._ramp.towards(now, *self._restrict(causes, v, omega))
        v, omega = self._restrict(causes, *ramped)  # stop other motion immediately, without a ramp
        self._ramp.set(now, v, omega)
        return AllowedMotion(v, omega, stops)

    def _causes(self, now: Instant) -> dict[HoldCause, int]:
        """Return active causes with their sensor's bits."""
        causes: dict[HoldCause, int] = {}
        if self._feedback is None or now - self._feedback_at > self._limits.silence:
            causes[HoldCause.NO_FEEDBACK] = 0
        elif self._silent_until is not None and now - self._silent_until < self._limits.silence:
            causes[HoldCause.LINK_RECOVERING] = 0
        if self._feedback is not None:
            causes |= self._sensor_causes(now, self._feedback.basic)
        causes |= dict.fromkeys(self._external_causes, 0)
        command = self._command
        if command is None or now - command.arrived > _COMMAND_AGE:
            causes[HoldCause.NO_COMMAND] = 0
        elif now - command.issued > _COMMAND_AGE:
            causes[HoldCause.STALE_COMMAND] = 0
        elif not (math.isfinite(command.v) and math.isfinite(command.omega)):
            causes[HoldCause.BAD_COMMAND] = 0
        return causes

    def _sensor_causes(self, now: Instant, basic: HazardState) -> dict[HoldCause, int]:
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

    def _is_still(self, feedback: DriveFeedback) -> bool:
        """Return whether the base has not moved since the last feedback."""
        if self._feedback is None:
            return False
        rate, moved = feedback.turn_rate, feedback.since(self._feedback)
        turning = rate is not None and abs(rate) > _STILL_RATE
        return max(abs(moved.left), abs(moved.right)) <= self._limits.still and not turning

    def _restrict(self, causes: Mapping[HoldCause, int], v: float, omega: float) -> tuple[float, float]:
        """Return the nearest velocity in the directions that all causes permit."""
        if HoldCause.BACKUP_LIMIT in causes:
            v = max(v, 0.0)
        if _BACKWARD_ONLY & causes.keys():  # no wheel turns forward
            v = min(v, 0.0)
            bound = -v / (self._limits.track / 2 + _RADIUS_MARGIN)
            omega = max(-bound, min(bound, omega))
        return v, omega


class BatteryLevel(Enum):
    """Charge level of the battery."""

    FULL = "full"
    FAIR = "fair"
    LOW = "low"
    DANGER = "danger"


class BatteryLimits(NamedTuple):
    """Limits of a battery's levels, as voltages or charges."""

    low: float
    danger: float
    margin: float
    """Hysteresis of all limits."""
    full: float = math.inf


def battery_level(value: float, before: BatteryLevel | None, limits: BatteryLimits) -> BatteryLevel:
    """Return the level of a battery's voltage or charge, with hysteresis; `before`: the previous level."""
    if value <= limits.danger + limits.margin * (before is BatteryLevel.DANGER):
        return BatteryLevel.DANGER
    if value <= limits.low + limits.margin * (before in {BatteryLevel.LOW, BatteryLevel.DANGER}):
        return BatteryLevel.LOW
    if value >= limits.full - limits.margin * (before is BatteryLevel.FULL):
        return BatteryLevel.FULL
    return BatteryLevel.FAIR


class StateChange(NamedTuple):
    """Change of a base's state: feedback present, a feedback field, battery level, or active stop causes."""

    instant: Instant
    what: str
    before: object
    """Previous value; 0 before the first feedback."""
    now: object

    def __str__(self) -> str:
        return f"{self.what}: {self.before} -> {self.now}"


MAX_COMMAND_INTERVAL: Final = milliseconds(40)
"""Maximum interval of commands to a base without feedback; own choice, two feedbacks of a Kobuki."""


class BaseDriver(ABC):
    """Common part of the drivers of differential bases, without I/O."""

    _FEEDBACK = "feedback"
    """Name of the feedback in reported changes."""

    def __init__(self, started: Instant, limits: DriveLimits) -> None:
        self.limits = limits
        self.odometry = WheelOdometry(limits)
        self.found = False
        """True while feedback is received."""
        self.battery: BatteryLevel | None = None
        """Battery level; None: unknown."""
        self.allowed = AllowedMotion(0.0, 0.0, ())
        """Last result of the safety stop."""
        self._safety = SafetyStop(started, limits)
        self._feedback_at = started
        self._has_new_feedback = False
        """True if feedback has been received since the last command to the base."""
        self._sent_at = Instant(started - MAX_COMMAND_INTERVAL)
        self._pressed_bits = 0
        self._changes: list[StateChange] = []

    @abstractmethod
    def pressed(self) -> int:
        """Return the bumper bits set at any time since the last call, as in SensorData.bumper."""

    def changes(self) -> list[StateChange]:
        """Return changes since the last call."""
        changes, self._changes = self._changes, []
        return changes

    def command(self, now: Instant, v: float, omega: float, issued: Instant | None = None) -> None:
        """Command `v` m/s forward and `omega` rad/s counter-clockwise, subject to the safety stop.

        `issued`: time of the decision; None: now.
        """
        self._safety.command(now, now if issued is None else issued, v, omega)

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """Set or clear an external cause that prevents all motion."""
        self._safety.hold(cause, holds)

    def _note_change(self, now: Instant, what: str, before: object, value: object) -> None:
        if value != before:
            self._changes.append(StateChange(now, what, before, value))

    def _update_allowed(self, now: Instant) -> None:
        before, self.allowed = self.allowed, self._safety.allowed(now)
        self._note_change(now, "stops", before.stops, self.allowed.stops)

    def _set_found(self, now: Instant, found: bool) -> None:
        self._note_change(now, self._FEEDBACK, self.found, found)
        self.found = found

    def _check_silence(self, now: Instant) -> None:
        if self.found and now - self._feedback_at > self.limits.silence:
            self._set_found(now, False)
            self.odometry.set_standing()

    def _set_battery(self, now: Instant, level: BatteryLevel | None) -> bool:
        """Store a level, and stop with a nearly empty battery; return whether the level has changed."""
        before, self.battery = self.battery, level
        if level is before:
            return False
        self._note_change(now, "battery", before, level)
        self.hold(HoldCause.BATTERY, level is BatteryLevel.DANGER)
        return True
