"""Consistency checks that need no scan: wheels, gyro, command, the base's clock and its bumper.

Judged only while the base is commanded to move: a standing robot may be pushed, turned and carried. A motion
track integrates the last feedbacks under the hypothesis that wheels or gyro are faulty: without wheels there
is the command for the distance, without the gyro there are the wheels for the heading.
"""

import itertools
import math
from collections import deque
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import Duration, Instant, milliseconds, seconds
from actors.portable import arrays
from firmware_bridge.kobuki.motion import TRACK
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import Basic

_KEPT: Final = 160
"""Feedbacks, 3.2 s."""


class Liar(Enum):
    """Who is held to say what is not so."""

    NOBODY = auto()
    WHEELS = auto()
    GYRO = auto()


class Moved(NamedTuple):
    """What moved from one feedback to the next."""

    instant: Instant
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
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    heading: NDArray[np.float64]
    """Unwrapped."""

    def at(self, instants: NDArray[np.int64]) -> "PoseTrack":
        """The poses at any instants; before the first and after the last those."""
        before = np.maximum(np.searchsorted(self.instants, instants, side="right") - 1, 0)
        after = np.minimum(before + 1, self.instants.size - 1)
        gaps = np.maximum(self.instants[after] - self.instants[before], 1)
        shares = np.clip((instants - self.instants[before]) / gaps, 0.0, 1.0)
        axes = (self.x, self.y, self.heading)
        return PoseTrack(instants, *(axis[before] + shares * (axis[after] - axis[before]) for axis in axes))


class MotionTrack:
    """The last feedbacks, as differences."""

    def __init__(self) -> None:
        self._moves: deque[Moved] = deque(maxlen=_KEPT)

    def take(self, moved: Moved) -> None:
        """Take in one more."""
        self._moves.append(moved)

    def forget(self) -> None:
        """Begin anew."""
        self._moves.clear()

    @property
    def begin(self) -> Instant | None:
        """Since when there is a track."""
        return self._moves[0].instant if self._moves else None

    @property
    def end(self) -> Instant | None:
        """Until when there is one."""
        return self._moves[-1].instant if self._moves else None

    def tracks(self) -> dict[Liar, PoseTrack]:
        """The track under each hypothesis."""
        rows = np.array(self._moves, np.float64).reshape(-1, len(Moved._fields))
        return {liar: _track(rows, liar) for liar in Liar}


def _track(rows: NDArray[np.float64], liar: Liar) -> PoseTrack:
    instants, left, right, turn, v, _ = rows.T
    times = np.diff(instants, prepend=instants[:1]) * 1e-6
    forward = v * times if liar is Liar.WHEELS else (left + right) / 2
    if liar is Liar.GYRO:
        turn = (right - left) / TRACK
    heading = np.cumsum(turn)
    course = heading - turn / 2
    x, y = np.cumsum(forward * arrays.cos(course)), np.cumsum(forward * arrays.sin(course))
    return PoseTrack(instants.astype(np.int64), x, y, heading)


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
    """Feed it every feedback; it answers with whom it contradicts."""

    def __init__(self) -> None:
        self._moves: deque[Moved] = deque()
        self._backed = 0.0
        self._stamp: tuple[Instant, int] | None = None
        self._odd_stamps = 0

    def take(self, moved: Moved, basic: Basic) -> HoldCause | None:
        """The cause that this feedback shows, if it shows any."""
        clock = self._clock(moved.instant, basic.stamp_ms)
        if clock is not None:
            return clock
        if (bumper := self._bumper(moved, basic)) is not None:
            return bumper
        if basic.wheel_drop or basic.bumper or (moved.v == 0 and moved.omega == 0):
            self._moves.clear()
            return None
        self._moves.append(moved)
        while moved.instant - self._moves[0].instant > _WINDOW:
            self._moves.popleft()
        return self._turns() or self._blocked()

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

    def _bumper(self, moved: Moved, basic: Basic) -> HoldCause | None:
        self._backed = self._backed - min(0.0, (moved.left + moved.right) / 2) if basic.bumper else 0.0
        return HoldCause.BUMPER_STUCK if self._backed > _BACKED else None

    def _turns(self) -> HoldCause | None:
        """Wheels against gyro; who of them lies is said by what was commanded, where that is clear."""
        wheels = math.fsum(move.right - move.left for move in self._moves) / TRACK
        gyro = math.fsum(move.turn for move in self._moves)
        if abs(wheels - gyro) <= _TURN + _TURN_SHARE * max(abs(wheels), abs(gyro)):
            return None
        times = self._times()
        told = math.fsum(move.omega * time for move, time in zip(self._moves, times, strict=True))
        if abs(wheels - told) < _CLEARLY * abs(gyro - told):
            return HoldCause.GYRO
        if abs(gyro - told) < _CLEARLY * abs(wheels - told):
            left, right = self._told_ways(times)
            off_left = abs(math.fsum(move.left for move in self._moves) - left)
            off_right = abs(math.fsum(move.right for move in self._moves) - right)
            if off_right < _CLEARLY * off_left:
                return HoldCause.LEFT_WHEEL
            if off_left < _CLEARLY * off_right:
                return HoldCause.RIGHT_WHEEL
        return HoldCause.TURNS

    def _blocked(self) -> HoldCause | None:
        """Wheels against what they are told, over the last stretch that is long enough."""
        told_left = told_right = left = right = 0.0
        moves = list(self._moves)
        for before, move in zip(reversed(moves[:-1]), reversed(moves), strict=False):
            time = (move.instant - before.instant) * 1e-6
            told_left += (move.v - move.omega * TRACK / 2) * time
            told_right += (move.v + move.omega * TRACK / 2) * time
            left, right = left + move.left, right + move.right
            lasted = moves[-1].instant - before.instant >= _TOLD_FOR
            if lasted and max(abs(told_left), abs(told_right)) >= _TOLD:
                least = _TURNED * max(abs(told_left), abs(told_right))
                return HoldCause.BLOCKED if max(abs(left), abs(right)) < least else None
        return None

    def _times(self) -> list[float]:
        pairs = itertools.pairwise(move.instant for move in self._moves)
        return [0.0, *((after - before) * 1e-6 for before, after in pairs)]

    def _told_ways(self, times: list[float]) -> tuple[float, float]:
        turned = [move.omega * TRACK / 2 for move in self._moves]
        rows = list(zip(self._moves, turned, times, strict=True))
        left = math.fsum((move.v - turn) * time for move, turn, time in rows)
        return left, math.fsum((move.v + turn) * time for move, turn, time in rows)
