"""Differential drive of a Kobuki: base control for a velocity, and odometry from encoders and gyro.

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
from firmware_bridge.kobuki.wire import BaseControl, BaseFeedback, Basic, WireMisuseError

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


def ticks_between(before: Basic, after: Basic) -> tuple[int, int]:
    """Return how far the encoders of left and right wheel went on; they are uint16 and wrap."""
    left, right = after.left_ticks - before.left_ticks, after.right_ticks - before.right_ticks
    return ((left + 0x8000) & 0xFFFF) - 0x8000, ((right + 0x8000) & 0xFFFF) - 0x8000


def ways_between(before: Basic, after: Basic) -> tuple[float, float]:
    """Return the ways of left and right wheel, m."""
    left, right = ticks_between(before, after)
    return left * METRES_PER_TICK, right * METRES_PER_TICK


def _whole(value: float) -> int:
    """Towards zero, as far as an int16 goes."""
    return int(max(-_LIMIT - 1, min(_LIMIT, value)))


_CENTIDEGREE: Final = math.radians(0.01)
_STANDING: Final = 0.02
"""Slower counts as standing, m/s and rad/s; own choice: a tick in 20 ms is 4 mm/s."""


_FASTEST: Final = 2.0
"""A wheel that seems to have turned faster has not: the numbers are damaged, m/s. Own choice, twice what a
wheel can do at 0.7 m/s while turning."""
_FASTEST_TURN: Final = 12.0
"""The same for the gyro, rad/s. Own choice, twice what its rate's field can say."""
_SLACK: Final = 0.02
"""Added to the time between two stamps when judging speeds, s: the stamp is not taken with the ticks."""
LONGEST_GAP: Final = 3.0
"""Between two feedbacks; after a longer one ticks are ambiguous, s: at 0.7 m/s half their circle of 65536 is
4 s."""
_STILL_TURN: Final = 0.2
"""The gyro seems to stand still once its numbers stay the same while the wheels turn the base by so much,
rad. Own choice. A gyro free of noise does so, too, where a wheel slips: others judge."""
_STILL_FEEDBACKS: Final = 25
"""And for so many feedbacks."""


@dataclass
class OdometryCounts:
    """What was wrong with the feedback."""

    repeated: int = 0
    """Same stamp as before: nothing to learn."""
    implausible: int = 0
    """Moved faster than a base can: left out, the next is compared with the last that was right."""
    restarts: int = 0
    """The base's counters began anew; what it moved meanwhile is not known."""
    gaps: int = 0
    """Too long without feedback; the same."""
    on_wheels: int = 0
    """Feedbacks whose turn was taken from the wheels, for want of a gyro."""


class _Motion(NamedTuple):
    """Between two feedbacks: s, m, m and rad."""

    time: float
    left: float
    right: float
    turn: float | None


class KobukiOdometry:
    """Adds up feedback to a pose in the frame of the first one."""

    def __init__(self) -> None:
        self.longest_gap = LONGEST_GAP
        self._last: BaseFeedback | None = None
        self._odd: BaseFeedback | None = None
        """The feedback that was left out last: if the next agrees with it, the base has restarted."""
        self._x = self._y = 0.0
        self._v = self._omega = 0.0
        self._unmoved = 0
        self._owed = 0.0
        """Turn of the wheels since the gyro's numbers last changed, rad."""
        self._frozen = False
        self.heading = 0.0
        """Turned since the first feedback, unwrapped, rad."""
        self.counts = OdometryCounts()

    @property
    def unknown(self) -> int:
        """How often the base has moved unheard, perhaps, so that the pose is no longer what it says."""
        return self.counts.gaps + self.counts.restarts

    @property
    def gyro_is_still(self) -> bool:
        """True if its numbers stay the same while the wheels turn: either of them lies."""
        return self._unmoved >= _STILL_FEEDBACKS and abs(self._owed) >= _STILL_TURN

    @property
    def on_wheels(self) -> bool:
        """True while the heading is that of the wheels, for want of a gyro that works."""
        return self._frozen

    def trust_wheels(self) -> None:
        """A gyro that is still is frozen, as scans or a person say: the wheels are right until it moves."""
        self._frozen = True

    @property
    def moves(self) -> bool:
        """True if it moved between the last two feedbacks."""
        return abs(self._v) > _STANDING or abs(self._omega) > _STANDING

    def read(self) -> Odometry:
        """Pose since the first feedback, and velocity between the last two."""
        return Odometry(self._x, self._y, wrap(self.heading), self._v, 0.0, self._omega)

    def stand(self) -> None:
        """Nothing is heard of the base: say no velocity that may long be over."""
        self._v = self._omega = 0.0

    def take(self, feedback: BaseFeedback) -> None:
        """Take in one feedback."""
        if self._last is None:
            self._last = feedback
            return
        if in_seconds(feedback.instant - self._last.instant) > self.longest_gap:
            self.counts.gaps += 1
            self._begin_again(feedback)
            return
        motion = _between(self._last, feedback)
        if motion.time == 0:
            self.counts.repeated += 1
        elif self._plausible(motion):
            self._odd = None
            self._add(motion, frozen=feedback.inertial == self._last.inertial)
            self._last = feedback
        elif self._odd is not None and self._plausible(_between(self._odd, feedback)):
            self.counts.restarts += 1
            self._begin_again(feedback)
        else:
            self.counts.implausible += 1
            self._odd = feedback

    def _begin_again(self, feedback: BaseFeedback) -> None:
        """Go on from here, as if nothing had moved."""
        self._last, self._odd = feedback, None
        self._v = self._omega = 0.0
        self._trust_gyro()

    def _trust_gyro(self) -> None:
        self._unmoved, self._owed, self._frozen = 0, 0.0, False

    def _plausible(self, motion: _Motion) -> bool:
        time = motion.time + _SLACK
        return (
            0 < motion.time <= self.longest_gap
            and max(abs(motion.left), abs(motion.right)) <= _FASTEST * time
            and (self._frozen or abs(motion.turn or 0.0) <= _FASTEST_TURN * time)
        )

    def _add(self, motion: _Motion, frozen: bool) -> None:
        """`frozen`: the gyro's numbers are those of the feedback before."""
        turn = self._turn(motion, frozen)
        forward = (motion.left + motion.right) / 2
        self._x += forward * cos(self.heading + turn / 2)
        self._y += forward * sin(self.heading + turn / 2)
        self.heading += turn
        self._v, self._omega = forward / motion.time, turn / motion.time

    def _turn(self, motion: _Motion, frozen: bool) -> float:
        """Return the gyro's turn, unless it is absent or known to be frozen; then that of the wheels."""
        by_wheels = (motion.right - motion.left) / TRACK
        if motion.turn is None or not frozen:
            # A gyro that works again may jump to where it should have been, which the wheels have said.
            on_wheels = motion.turn is None or self._frozen
            self._trust_gyro()
            self.counts.on_wheels += on_wheels
            return by_wheels if motion.turn is None or on_wheels else motion.turn
        self._unmoved += 1
        self._owed += by_wheels
        if not self._frozen:
            return motion.turn
        self.counts.on_wheels += 1
        owed, self._owed = self._owed, 0.0
        return owed


def _between(before: BaseFeedback, after: BaseFeedback) -> _Motion:
    turn = None
    if before.inertial is not None and after.inertial is not None:
        turn = wrap((after.inertial.angle_cdeg - before.inertial.angle_cdeg) * _CENTIDEGREE)
    time = ((after.basic.stamp_ms - before.basic.stamp_ms) & 0xFFFF) / 1000
    return _Motion(time, *ways_between(before.basic, after.basic), turn)
