"""How a base has moved lately, by its wheels, its gyro and what it was told: one track for each hypothesis.

A hypothesis says which of these lie. The others then make the track: with one wheel left and the gyro there
is still a way and a heading, with no wheel there is what was commanded.
"""

from collections import deque
from enum import Enum, auto
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.portable import arrays
from firmware_bridge.kobuki.motion import TRACK

_KEPT: Final = 160
"""Feedbacks, 3.2 s."""


class Liar(Enum):
    """Who is held to say what is not so."""

    NOBODY = auto()
    LEFT = auto()
    RIGHT = auto()
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

    def tracks(self, liars: tuple[Liar, ...]) -> dict[Liar, PoseTrack]:
        """The track if that one lies, for each."""
        rows = np.array(self._moves, np.float64).reshape(-1, len(Moved._fields))
        return {liar: _track(rows, liar) for liar in liars}


def _track(rows: NDArray[np.float64], liar: Liar) -> PoseTrack:
    instants, left, right, turn, v, _ = rows.T
    times = np.diff(instants, prepend=instants[:1]) * 1e-6
    if liar is Liar.LEFT:
        forward = right - turn * TRACK / 2
    elif liar is Liar.RIGHT:
        forward = left + turn * TRACK / 2
    elif liar is Liar.WHEELS:
        forward = v * times
    else:
        forward = (left + right) / 2
    if liar is Liar.GYRO:
        turn = (right - left) / TRACK
    heading = np.cumsum(turn)
    course = heading - turn / 2
    x, y = np.cumsum(forward * arrays.cos(course)), np.cumsum(forward * arrays.sin(course))
    return PoseTrack(instants.astype(np.int64), x, y, heading)
