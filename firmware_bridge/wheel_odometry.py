"""Odometry of a differential base, from its wheels and its gyro. Source: kobuki_node, odometry."""

from dataclasses import dataclass
from typing import Final

from actors.geometry import wrap
from actors.instant import in_seconds
from actors.messages import Odometry
from actors.portable import cos, sin
from firmware_bridge.base_feedback import DriveFeedback, DriveLimits, WheelMotion

_STANDING: Final = 0.02
"""Velocities below this count as standstill, m/s and rad/s; own choice: a tick in 20 ms is 4 mm/s."""


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


class WheelOdometry:
    """Odometry: integrates feedback to a pose in the frame of the first one."""

    def __init__(self, limits: DriveLimits) -> None:
        self._limits = limits
        self.longest_gap = LONGEST_GAP
        self._last: DriveFeedback | None = None
        self._ignored: DriveFeedback | None = None
        """Last ignored feedback; if the next one is consistent with it, the base has restarted."""
        self._x = self._y = 0.0
        self._v = self._omega = 0.0
        self._constant_feedbacks = 0
        self._uncounted_turn = 0.0
        """Turn of the wheels since the gyro's values last changed, rad."""
        self.uses_wheel_heading = False
        """True while the heading is computed from the wheels: until the gyro's values change."""
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
    def is_moving(self) -> bool:
        """True if the base moved between the last two feedbacks."""
        return abs(self._v) > _STANDING or abs(self._omega) > _STANDING

    def read(self) -> Odometry:
        """Return the pose since the first feedback, and the velocity between the last two."""
        return Odometry(self._x, self._y, wrap(self.heading), self._v, 0.0, self._omega)

    def set_standing(self) -> None:
        """Set the velocity to zero, after a loss of feedback."""
        self._v = self._omega = 0.0

    def take(self, feedback: DriveFeedback) -> None:
        """Add one feedback."""
        if self._last is None:
            self._last = feedback
            return
        if in_seconds(feedback.instant - self._last.instant) > self.longest_gap:
            self.counts.gaps += 1
            self._restart(feedback)
            return
        motion = feedback.since(self._last)
        if motion.advance == 0:
            self.counts.repeated += 1
        elif self._is_plausible(motion):
            self._ignored = None
            self._add(motion, frozen=feedback.gyro == self._last.gyro)
            self._last = feedback
        elif self._ignored is not None and self._is_plausible(feedback.since(self._ignored)):
            self.counts.restarts += 1
            self._restart(feedback)
        else:
            self.counts.implausible += 1
            self._ignored = feedback

    def _restart(self, feedback: DriveFeedback) -> None:
        """Restart from this feedback, ignoring motion before it."""
        self._last, self._ignored = feedback, None
        self.set_standing()
        self._reset_gyro_check()

    def _reset_gyro_check(self) -> None:
        self._constant_feedbacks, self._uncounted_turn, self.uses_wheel_heading = 0, 0.0, False

    def _is_plausible(self, motion: WheelMotion) -> bool:
        passed = in_seconds(motion.advance)
        time = passed + _SLACK
        return (
            0 < passed <= self.longest_gap
            and max(abs(motion.left), abs(motion.right)) <= self._limits.wheel_speed * time
            and (self.uses_wheel_heading or abs(motion.turn or 0.0) <= _MAX_GYRO_RATE * time)
        )

    def _add(self, motion: WheelMotion, frozen: bool) -> None:
        """Integrate a motion; `frozen`: the gyro's values are unchanged."""
        turn = self._turn(motion, frozen)
        forward = (motion.left + motion.right) / 2
        self._x += forward * cos(self.heading + turn / 2)
        self._y += forward * sin(self.heading + turn / 2)
        self.heading += turn
        time = in_seconds(motion.advance)
        self._v, self._omega = forward / time, turn / time

    def _turn(self, motion: WheelMotion, frozen: bool) -> float:
        """Return the gyro's turn, or the wheels' turn if the gyro is absent or known to be frozen."""
        by_wheels = (motion.right - motion.left) / self._limits.track
        if motion.turn is None or not frozen:
            # a recovering gyro may jump by a turn that is already counted from the wheels
            on_wheels = motion.turn is None or self.uses_wheel_heading
            self._reset_gyro_check()
            self.counts.wheel_headings += on_wheels
            return by_wheels if motion.turn is None or on_wheels else motion.turn
        self._constant_feedbacks += 1
        self._uncounted_turn += by_wheels
        if not self.uses_wheel_heading:
            return motion.turn
        self.counts.wheel_headings += 1
        turn_since, self._uncounted_turn = self._uncounted_turn, 0.0
        return turn_since
