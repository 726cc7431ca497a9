"""The safety stop: which velocity a Kobuki may really be given, and why not the one that was wanted.

It stands between every command and the wire and knows nothing of who commands: no adaptation, no setting
and no message goes round it. The firmware of a Kobuki
does not stop by itself on bumper, cliff or wheel drop since 1.1.2, so this does.

Rules, each for as long as its cause lasts and a moment longer where said:
- bumper or cliff: no wheel turns forward until the sensor is released; backing off is allowed, also in arcs;
- wheel drop: nothing moves until both wheels carry the base again and it has then stood still for a while;
- no feedback: nothing moves until feedback has come for a while without such a silence;
- over-current at a wheel: nothing moves until it is over and a second has passed;
- an empty battery, and whatever else the driver is told (`hold`): nothing moves meanwhile;
- a command older than 0.2 s is never driven, whether it came late or none came after it, nor is one that
  is no finite number;
- otherwise speeds and accelerations are limited.
A stop acts at once, without a ramp; after it the base speeds up from standing.
"""

import math
from enum import Enum
from typing import Final, NamedTuple

from actors.instant import Duration, Instant, in_seconds, milliseconds
from firmware_bridge.kobuki.motion import TRACK, ticks_between
from firmware_bridge.kobuki.wire import BaseFeedback, Basic, Inertial

FEEDBACK_SILENCE: Final[Duration] = milliseconds(100)
"""After so long without feedback the link counts as dead; kobuki_driver: 100 ms."""
_FEEDBACK_RECOVERY: Final[Duration] = milliseconds(100)
"""How long feedback must have come again before the base moves; own choice, five feedbacks."""
_COMMAND_AGE: Final[Duration] = milliseconds(200)
"""The oldest command that is driven; two steps."""
_STILLNESS: Final[Duration] = milliseconds(1000)
"""How long a base that was put down must stand still before it moves; own choice."""
_STILL_TICKS: Final = 2
"""Ticks that an encoder may change between two feedbacks while standing still; own choice, 0.17 mm."""
_STILL_RATE_CDEG: Final = 200
"""The same for the gyro's rate, 0.01°/s; own choice, far above its noise."""
_OVERCURRENT_REST: Final[Duration] = milliseconds(1000)
"""How long a base stands after a wheel's over-current is over; own choice."""
_SPEED: Final = 0.7
"""The highest, m/s; Kobuki user guide."""
_TURN_RATE: Final = math.pi
"""The highest, rad/s; Kobuki user guide: 180°/s (above 110°/s the gyro is less exact)."""
_SPEED_UP, _TURN_UP = 0.3, 3.5
"""m/s² and rad/s²; kobuki_driver's defaults."""
_SLOW_DOWN, _TURN_DOWN = 0.6, 4.2
"""The same towards standing. Own choice of 0.6, above kobuki_driver's 0.36: navigation plans with 1.0
(actors.robot.navigation.steering), and on this base comes to stand later than it means to."""
_LONGEST_PAUSE: Final[Duration] = milliseconds(60)
"""More time than this between two commands counts as this; own choice, three feedbacks: a host that slept
makes no jump."""
_EDGE: Final = TRACK / 2 + 0.002
"""The smallest radius of backing off, m: half the track, and what rounding to whole mm may take away."""


class Ramp:
    """The velocity that was last sent, and how far it may go from there."""

    def __init__(self) -> None:
        self._at: Instant | None = None
        self.v = 0.0
        self.omega = 0.0

    def halt(self, now: Instant) -> None:
        """Stand at once."""
        self.set(now, 0.0, 0.0)

    def set(self, now: Instant, v: float, omega: float) -> None:
        """Go on from another velocity."""
        self._at, self.v, self.omega = now, v, omega

    def towards(self, now: Instant, v: float, omega: float) -> tuple[float, float]:
        """The velocity for now on the way to the wanted one, m/s and rad/s."""
        passed = 0 if self._at is None else max(0, min(now - self._at, _LONGEST_PAUSE))
        time = in_seconds(passed)
        self.set(
            now,
            _next(self.v, v, _SPEED_UP * time, _SLOW_DOWN * time),
            _next(self.omega, omega, _TURN_UP * time, _TURN_DOWN * time),
        )
        return self.v, self.omega


def _next(value: float, wanted: float, up: float, down: float) -> float:
    """As near to `wanted` as one step goes; a change of sign pauses at 0."""
    if value < 0:
        return -_next(-value, -wanted, up, down)
    if wanted > value:
        return min(wanted, value + up)
    return max(wanted, value - down, 0.0) if value > 0 else max(wanted, -up)


class HoldCause(Enum):
    """Why a base does not do what is wanted."""

    NO_FEEDBACK = "no feedback from the base"
    LINK_RECOVERING = "feedback from the base has only just come back"
    WHEEL_DROP = "a wheel hangs in the air"
    PUT_DOWN = "just put down: waiting until it stands still"
    BUMPER = "the bumper is pressed: backward only"
    CLIFF = "a cliff is ahead: backward only"
    OVERCURRENT = "a wheel's motor draws too much current: something may hold it"
    BATTERY = "the battery is nearly empty"
    NOISE = "the serial line of the base is noisy: most of what it says is damaged"
    BASE_CLOCK = "the base's clock stands still or jumps"
    BUMPER_STUCK = "the bumper stays pressed although the robot has backed away"
    BLOCKED = "the wheels do not turn as they are told: they are blocked, or their encoders stand still"
    TURNS = "wheels and gyro do not turn alike"
    LEFT_WHEEL = "the left wheel contradicts the gyro and what it is told"
    RIGHT_WHEEL = "the right wheel contradicts the gyro and what it is told"
    WHEELS = "both wheels contradict the scans and what they are told"
    GYRO = "the gyro contradicts wheels and scans"
    REPEATS = "the range sensor repeats what it has said before, to the last bit"
    SCAN_PART = "a part of the scan does not change, to the last bit"
    SCAN_STILL = "the scan does not change while wheels and gyro say that the robot moves"
    SCAN_TURNED = "the scan moves in another direction than wheels and gyro: the sensor is mounted turned"
    SCAN_MIRRORED = "the scan moves as a mirror image of wheels and gyro: the sensor is mounted upside down"
    SCAN_LATE = "the scan follows wheels and gyro late"
    BLIND = "the range sensor sees nothing"
    UNWATCHED = "no guardian has the last word"
    NO_COMMAND = "no command for too long"
    STALE_COMMAND = "the command is too old"
    BAD_COMMAND = "the command is no finite number"


_BACKWARD_ONLY: Final = frozenset({HoldCause.BUMPER, HoldCause.CLIFF})


class StopCause(NamedTuple):
    """One cause that holds now."""

    cause: HoldCause
    since: Instant
    bits: int = 0
    """Of the sensor, as in the feedback; 0 where there is none."""


class AllowedMotion(NamedTuple):
    """What may be driven now: m/s forward, rad/s counter-clockwise; and all causes that hold it back."""

    v: float
    omega: float
    stops: tuple[StopCause, ...]


class _Command(NamedTuple):
    arrived: Instant
    issued: Instant
    v: float
    omega: float


class SafetyStop:
    """Feed it every feedback and every command; ask it before every byte that moves the base."""

    def __init__(self, started: Instant) -> None:
        self._started = started
        self._basic: Basic | None = None
        self._heard = started
        self._silent_until: Instant | None = None
        """The first feedback after a silence; None before the very first."""
        self._moved = started
        """When the base last did not stand still; kept while it has been dropped."""
        self._dropped = False
        self._strained: Instant | None = None
        """When there last was over-current."""
        self._held: set[HoldCause] = set()
        self._command: _Command | None = None
        self._since: dict[HoldCause, Instant] = {}
        self._ramp = Ramp()
        self.late_commands = 0
        """Commands that were older than one before them, and left out."""

    def sense(self, feedback: BaseFeedback) -> None:
        """Take in one feedback of the base."""
        now, basic, inertial = feedback
        if self._silent_until is None or now - self._heard > FEEDBACK_SILENCE:
            self._silent_until = now
        if basic.wheel_drop:
            self._dropped = True
        if basic.wheel_drop or not self._still(basic, inertial):
            self._moved = now
        if basic.overcurrent:
            self._strained = now
        self._basic, self._heard = basic, now

    def hold(self, cause: HoldCause, holds: bool) -> None:
        """From now on let nothing move for that cause, or no longer for that one."""
        (self._held.add if holds else self._held.discard)(cause)

    def command(self, now: Instant, issued: Instant, v: float, omega: float) -> None:
        """Take in a command made at `issued` that arrived `now`; one made before the last is left out.

        What claims to come from the future counts as made now.
        """
        issued = min(issued, now)
        if self._command is not None and issued < self._command.issued:
            self.late_commands += 1
            return
        self._command = _Command(now, issued, v, omega)

    def allowed(self, now: Instant) -> AllowedMotion:
        """What may be driven from now on. Call it with every base control: the ramp goes on with it."""
        stops = self._stops(now)
        standing = any(stop.cause not in _BACKWARD_ONLY for stop in stops)
        if standing or self._command is None:
            self._ramp.halt(now)
            return AllowedMotion(0.0, 0.0, stops)
        v, omega = self._limited(self._command.v, self._command.omega)
        if not stops:
            return AllowedMotion(*self._ramp.towards(now, v, omega), stops)
        ramped = self._ramp.towards(now, *_backward(v, omega))
        v, omega = _backward(*ramped)  # no ramp down from going forward
        self._ramp.set(now, v, omega)
        return AllowedMotion(v, omega, stops)

    def _stops(self, now: Instant) -> tuple[StopCause, ...]:
        """All causes that hold, in the order of Cause."""
        causes = self._causes(now)
        self._since = {cause: self._since.get(cause, now) for cause in causes}
        return tuple(
            StopCause(cause, self._since[cause], causes[cause]) for cause in HoldCause if cause in causes
        )

    def _causes(self, now: Instant) -> dict[HoldCause, int]:
        """Each cause with its sensor's bits."""
        causes: dict[HoldCause, int] = {}
        if self._basic is None or now - self._heard > FEEDBACK_SILENCE:
            causes[HoldCause.NO_FEEDBACK] = 0
        elif self._silent_until is not None and now - self._silent_until < _FEEDBACK_RECOVERY:
            causes[HoldCause.LINK_RECOVERING] = 0
        if self._basic is not None:
            causes |= self._sensed(now, self._basic)
        causes |= dict.fromkeys(self._held, 0)
        command = self._command
        if command is None or now - command.arrived > _COMMAND_AGE:
            causes[HoldCause.NO_COMMAND] = 0
        elif now - command.issued > _COMMAND_AGE:
            causes[HoldCause.STALE_COMMAND] = 0
        elif not (math.isfinite(command.v) and math.isfinite(command.omega)):
            causes[HoldCause.BAD_COMMAND] = 0
        return causes

    def _sensed(self, now: Instant, basic: Basic) -> dict[HoldCause, int]:
        causes = {}
        if basic.wheel_drop:
            causes[HoldCause.WHEEL_DROP] = basic.wheel_drop
        elif self._dropped:
            if self._heard - self._moved < _STILLNESS:
                causes[HoldCause.PUT_DOWN] = 0
            else:
                self._dropped = False
        if self._strained is not None and now - self._strained <= _OVERCURRENT_REST:
            causes[HoldCause.OVERCURRENT] = basic.overcurrent
        if basic.bumper:
            causes[HoldCause.BUMPER] = basic.bumper
        if basic.cliff:
            causes[HoldCause.CLIFF] = basic.cliff
        return causes

    def _still(self, basic: Basic, inertial: Inertial | None) -> bool:
        """Return whether the base has not moved since the last feedback."""
        if self._basic is None:
            return False
        turning = inertial is not None and abs(inertial.rate_cdeg) > _STILL_RATE_CDEG
        return max(map(abs, ticks_between(self._basic, basic))) <= _STILL_TICKS and not turning

    def _limited(self, v: float, omega: float) -> tuple[float, float]:
        """Return the same arc, but no faster than the base can."""
        share = max(1.0, abs(v) / _SPEED, abs(omega) / _TURN_RATE)
        return v / share, omega / share


def _backward(v: float, omega: float) -> tuple[float, float]:
    """The nearest velocity at which no wheel turns forward; none at all for one that goes forward."""
    v = min(v, 0.0)
    bound = -v / _EDGE
    return v, max(-bound, min(bound, omega))
