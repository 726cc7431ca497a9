"""Consistency checks without scans: wheels, gyro, command, the base's clock and its bumper.

They apply only while the base is commanded to move, as a standing robot may be pushed, turned and carried. A
pose track integrates the last feedbacks under the hypothesis of faulty wheels (using the command for
distance) or a faulty gyro (using the wheels for heading).
"""

from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats, Int64s
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.portable import arrays
from firmware_bridge.base_feedback import DriveFeedback
from firmware_bridge.safety import HoldCause


class SuspectSensor(Enum):
    """Sensor assumed to be faulty."""

    NONE = auto()
    WHEELS = auto()
    GYRO = auto()


class Movement(NamedTuple):
    """Motion between two feedbacks."""

    instant: Instant
    """Time of the later one."""
    time: Duration
    left: float
    """Distance of the wheel by its encoder, m."""
    right: float
    turn: float
    """Turn by the gyro, rad."""
    v: float
    """Commanded velocity, m/s."""
    omega: float
    """Commanded turn rate, rad/s."""


class PoseTrack(NamedTuple):
    """Poses at several times, in a local frame."""

    instants: Int64s
    position: NDArray[np.complex128]
    """x + iy, m."""
    heading: Floats
    """Unwrapped, rad."""

    def at(self, instants: Int64s) -> "PoseTrack":
        """Return interpolated poses, constant before the first and after the last one."""
        before = np.maximum(np.searchsorted(self.instants, instants, side="right") - 1, 0)
        after = np.minimum(before + 1, self.instants.size - 1)
        gaps = np.maximum(self.instants[after] - self.instants[before], 1)
        shares = np.clip((instants - self.instants[before]) / gaps, 0.0, 1.0)
        position = self.position[before] + shares * (self.position[after] - self.position[before])
        heading = self.heading[before] + shares * (self.heading[after] - self.heading[before])
        return PoseTrack(instants, position, heading)


def direction(angles: Floats) -> NDArray[np.complex128]:
    """Return unit vectors as complex numbers."""
    return arrays.cos(angles) + 1j * arrays.sin(angles)


def pose_track(moves: Sequence[Movement], suspect: SuspectSensor, track: float) -> PoseTrack:
    """Integrate the movements without the suspected sensor; `track`: distance between the wheels, m."""
    instants, time, left, right, turn, v, _ = np.array(moves, np.float64).T
    forward = v * time * 1e-6 if suspect is SuspectSensor.WHEELS else (left + right) / 2
    if suspect is SuspectSensor.GYRO:
        turn = (right - left) / track
    heading = np.cumsum(turn)
    position = np.cumsum(forward * direction(heading - turn / 2))
    return PoseTrack(instants.astype(np.int64), position, heading)


_MAX_TURN_DIFFERENCE: Final = 0.2
"""Maximum difference of wheels and gyro within a second, rad: a wheel slips by 4.6 cm. Own choice, ..."""
_MAX_TURN_SHARE: Final = 0.2
"""... plus this share of the turn: above 110°/s a Kobuki's gyro is less accurate (user guide)."""
_WINDOW: Final = seconds(1)
_MIN_COMMANDED: Final = 0.08
"""Commanded distance of a wheel from which it is checked, m."""
_MIN_TRAVELLED_SHARE: Final = 0.1
"""Minimum travelled share of that distance."""
_MIN_DURATION: Final = milliseconds(240)
"""Minimum duration of the check: a real base follows within 0.2 s. Own choice."""
_UNAMBIGUOUS: Final = 0.5
"""Ratio of deviations from the command below which a sensor counts as correct; own choice."""
_MAX_WRONG_STAMPS: Final = 3
"""Consecutive feedbacks with wrong stamps that are a fault; own choice: one may be damaged."""
_MAX_LEAD_MS: Final = 500
"""Maximum lead of the base's clock, ms."""
_STUCK_AFTER: Final = 0.3
"""Distance of backing off after which a pressed bumper is stuck, m; own choice: twice that of the robot."""


class MotionChecks:
    """Detector of faults in feedback."""

    def __init__(self, track: float) -> None:
        """Create it; `track`: distance between the wheels, m."""
        self._track = track
        self._moves: deque[Movement] = deque()
        self._backed = 0.0
        self._last: DriveFeedback | None = None
        self._wrong_stamps = 0

    def take(self, move: Movement, feedback: DriveFeedback) -> HoldCause | None:
        """Add one feedback and return a detected fault."""
        cause = self._clock_fault(feedback) or self._bumper_fault(move, feedback)
        if cause is not None:
            return cause
        if feedback.basic.wheel_drop or feedback.basic.bumper or (move.v == 0 and move.omega == 0):
            self.forget()
            return None
        self._moves.append(move)
        while move.instant - self._moves[0].instant > _WINDOW:
            self._moves.popleft()
        rows = np.array(self._moves, np.float64)[::-1]  # newest first
        _, time, left, right, turn, v, omega = rows.T
        turning_speed = omega * self._track / 2
        travelled = np.cumsum((left, right), axis=1)
        commanded = np.cumsum(((v - turning_speed) * time, (v + turning_speed) * time), axis=1) * 1e-6
        return _turn_fault(
            travelled[:, -1], commanded[:, -1], np.cumsum(turn)[-1], self._track
        ) or _blocking_fault(np.cumsum(time), travelled, commanded)

    def forget(self) -> None:
        """Discard all movements."""
        self._moves.clear()

    def _clock_fault(self, feedback: DriveFeedback) -> HoldCause | None:
        before, self._last = self._last, feedback
        if before is None:
            return None
        advance_ms = feedback.since(before).advance // 1000
        passed_ms = (feedback.instant - before.instant) // 1000
        is_wrong = advance_ms <= 0 or advance_ms > passed_ms + _MAX_LEAD_MS
        self._wrong_stamps = self._wrong_stamps + 1 if is_wrong else 0
        return HoldCause.BASE_CLOCK if self._wrong_stamps >= _MAX_WRONG_STAMPS else None

    def _bumper_fault(self, move: Movement, feedback: DriveFeedback) -> HoldCause | None:
        self._backed = self._backed - min(0.0, (move.left + move.right) / 2) if feedback.basic.bumper else 0.0
        return HoldCause.BUMPER_STUCK if self._backed > _STUCK_AFTER else None


def _turn_fault(travelled: Floats, commanded: Floats, gyro: float, track: float) -> HoldCause | None:
    """Compare wheels and gyro; the command decides which of them is faulty, if unambiguous.

    `travelled`, `commanded`: measured and commanded distances of left and right wheel, (2,), m.
    """
    wheels, omega = (travelled[1] - travelled[0]) / track, (commanded[1] - commanded[0]) / track
    if abs(wheels - gyro) <= _MAX_TURN_DIFFERENCE + _MAX_TURN_SHARE * max(abs(wheels), abs(gyro)):
        return None
    if abs(wheels - omega) < _UNAMBIGUOUS * abs(gyro - omega):
        return HoldCause.GYRO
    if abs(gyro - omega) < _UNAMBIGUOUS * abs(wheels - omega):
        off_left, off_right = np.abs(travelled - commanded)
        if off_right < _UNAMBIGUOUS * off_left:
            return HoldCause.LEFT_WHEEL
        if off_left < _UNAMBIGUOUS * off_right:
            return HoldCause.RIGHT_WHEEL
    return HoldCause.TURN_MISMATCH


def _blocking_fault(times: Floats, travelled: Floats, commanded: Floats) -> HoldCause | None:
    """Compare wheels and command over the shortest sufficient time.

    `times`: (n,), µs; `travelled`, `commanded`: measured and commanded distances, (2, n), m, back from now.
    """
    farthest = np.abs(commanded).max(axis=0)
    is_sufficient = (times >= _MIN_DURATION) & (farthest >= _MIN_COMMANDED)
    if not is_sufficient.any():
        return None
    at = int(is_sufficient.argmax())
    return HoldCause.BLOCKED if np.abs(travelled[:, at]).max() < _MIN_TRAVELLED_SHARE * farthest[at] else None
