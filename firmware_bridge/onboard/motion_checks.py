"""Consistency checks that need no scan: wheels, gyro, command, the base's clock and its bumper.

Judged only while the base is commanded to move: a standing robot may be pushed, turned and carried. A pose
track integrates the last feedbacks under the hypothesis that wheels or gyro are faulty: without wheels there
is the command for the distance, without the gyro there are the wheels for the heading.
"""

from collections import deque
from collections.abc import Sequence
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import Duration, Instant, milliseconds, seconds
from actors.portable import arrays
from firmware_bridge.kobuki.motion import TRACK
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import Basic


class SuspectSensor(Enum):
    """The sensor that is assumed to be faulty."""

    NONE = auto()
    WHEELS = auto()
    GYRO = auto()


class Movement(NamedTuple):
    """The motion from one feedback to the next."""

    instant: Instant
    """Of the later one."""
    time: Duration
    left: float
    """Way of a wheel by its encoder, m."""
    right: float
    turn: float
    """By the gyro, rad."""
    v: float
    """As commanded meanwhile, m/s."""
    omega: float
    """rad/s."""


class PoseTrack(NamedTuple):
    """Poses in a frame of their own."""

    instants: NDArray[np.int64]
    position: NDArray[np.complex128]
    """x + iy, m."""
    heading: NDArray[np.float64]
    """Unwrapped, rad."""

    def at(self, instants: NDArray[np.int64]) -> "PoseTrack":
        """Return the poses at any instants; before the first and after the last those."""
        before = np.maximum(np.searchsorted(self.instants, instants, side="right") - 1, 0)
        after = np.minimum(before + 1, self.instants.size - 1)
        gaps = np.maximum(self.instants[after] - self.instants[before], 1)
        shares = np.clip((instants - self.instants[before]) / gaps, 0.0, 1.0)
        position = self.position[before] + shares * (self.position[after] - self.position[before])
        heading = self.heading[before] + shares * (self.heading[after] - self.heading[before])
        return PoseTrack(instants, position, heading)


def direction(angles: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Return unit vectors, as complex numbers."""
    units: NDArray[np.complex128] = arrays.cos(angles) + 1j * arrays.sin(angles)
    return units


def pose_track(moves: Sequence[Movement], suspect: SuspectSensor) -> PoseTrack:
    """Return the track of these movements without the sensor that is suspected."""
    instants, time, left, right, turn, v, _ = np.array(moves, np.float64).T
    forward = v * time * 1e-6 if suspect is SuspectSensor.WHEELS else (left + right) / 2
    if suspect is SuspectSensor.GYRO:
        turn = (right - left) / TRACK
    heading = np.cumsum(turn)
    position = np.cumsum(forward * direction(heading - turn / 2))
    return PoseTrack(instants.astype(np.int64), position, heading)


_TURN: Final = 0.2
"""So much wheels and gyro may differ within a second, rad: a wheel slips by 4.6 cm. Own choice, and ..."""
_TURN_SHARE: Final = 0.2
"""... so much of the turn more: above 110°/s a Kobuki's gyro is less exact (user guide)."""
_WINDOW: Final[Duration] = seconds(1)
_TOLD: Final = 0.08
"""Once a wheel is told to go so far, m, ..."""
_TURNED: Final = 0.1
"""... it has to have gone this share of it, ..."""
_TOLD_FOR: Final[Duration] = milliseconds(240)
"""... and is given so much time at least: a real base takes up to 0.2 s to follow. Own choice."""
_CLEARLY: Final = 0.5
"""A witness that is so much nearer to the command than another is right; own choice."""
_STAMPS: Final = 3
"""Feedbacks on end whose stamps are wrong; own choice: one may be damaged."""
_AHEAD_MS: Final = 500
"""The base's clock may go on by so much more than ours, ms."""
_BACKED: Final = 0.3
"""A bumper that is still pressed after so much way back is stuck, m; own choice: twice what a robot backs."""
_STAMP_RANGE: Final = 1 << 16


class MotionChecks:
    """Takes every feedback and returns the fault that it shows."""

    def __init__(self) -> None:
        self._moves: deque[Movement] = deque()
        self._backed = 0.0
        self._stamp: tuple[Instant, int] | None = None
        self._odd_stamps = 0

    def take(self, move: Movement, basic: Basic) -> HoldCause | None:
        """Take in one feedback."""
        cause = self._clock(move.instant, basic.stamp_ms) or self._bumper(move, basic)
        if cause is not None:
            return cause
        if basic.wheel_drop or basic.bumper or (move.v == 0 and move.omega == 0):
            self.forget()
            return None
        self._moves.append(move)
        while move.instant - self._moves[0].instant > _WINDOW:
            self._moves.popleft()
        rows = np.array(self._moves, np.float64)[::-1]  # the newest first
        _, time, left, right, turn, v, omega = rows.T
        aside = omega * TRACK / 2
        ways = np.cumsum((left, right), axis=1)
        told = np.cumsum(((v - aside) * time, (v + aside) * time), axis=1) * 1e-6
        return _turns(ways[:, -1], told[:, -1], np.cumsum(turn)[-1]) or _blocked(np.cumsum(time), ways, told)

    def forget(self) -> None:
        """Begin anew."""
        self._moves.clear()

    def _clock(self, now: Instant, stamp_ms: int) -> HoldCause | None:
        before, self._stamp = self._stamp, (now, stamp_ms)
        if before is None:
            return None
        on = (stamp_ms - before[1]) % _STAMP_RANGE
        odd = on == 0 or on > (now - before[0]) // 1000 + _AHEAD_MS
        self._odd_stamps = self._odd_stamps + 1 if odd else 0
        return HoldCause.BASE_CLOCK if self._odd_stamps >= _STAMPS else None

    def _bumper(self, move: Movement, basic: Basic) -> HoldCause | None:
        self._backed = self._backed - min(0.0, (move.left + move.right) / 2) if basic.bumper else 0.0
        return HoldCause.BUMPER_STUCK if self._backed > _BACKED else None


def _turns(ways: NDArray[np.float64], told: NDArray[np.float64], gyro: float) -> HoldCause | None:
    """Compare wheels and gyro; what was commanded tells which of them is wrong, where that is clear.

    `ways`, `told`: (2,), m, of left and right wheel.
    """
    wheels, omega = (ways[1] - ways[0]) / TRACK, (told[1] - told[0]) / TRACK
    if abs(wheels - gyro) <= _TURN + _TURN_SHARE * max(abs(wheels), abs(gyro)):
        return None
    if abs(wheels - omega) < _CLEARLY * abs(gyro - omega):
        return HoldCause.GYRO
    if abs(gyro - omega) < _CLEARLY * abs(wheels - omega):
        off_left, off_right = np.abs(ways - told)
        if off_right < _CLEARLY * off_left:
            return HoldCause.LEFT_WHEEL
        if off_left < _CLEARLY * off_right:
            return HoldCause.RIGHT_WHEEL
    return HoldCause.TURNS


def _blocked(
    times: NDArray[np.float64], ways: NDArray[np.float64], told: NDArray[np.float64]
) -> HoldCause | None:
    """Compare the wheels with what they are told, over the last stretch that is long enough.

    `times`: (n,), µs; `ways`, `told`: (2, n), m, back from now.
    """
    farthest = np.abs(told).max(axis=0)
    enough = (times >= _TOLD_FOR) & (farthest >= _TOLD)
    if not enough.any():
        return None
    at = int(enough.argmax())
    return HoldCause.BLOCKED if np.abs(ways[:, at]).max() < _TURNED * farthest[at] else None
