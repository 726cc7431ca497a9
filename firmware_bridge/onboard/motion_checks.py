"""Contradictions that show without a scan: wheels against gyro against command, the base's clock, its bumper.

Judged only while the base is told to move: who stands may be pushed, turned and carried.
"""

import itertools
import math
from collections import deque
from typing import Final

from actors.instant import Duration, Instant, milliseconds, seconds
from firmware_bridge.kobuki.motion import TRACK
from firmware_bridge.kobuki.packets import Basic
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.onboard.motion_track import Moved

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
