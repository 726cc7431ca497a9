"""Contradictions between sweeps of the range sensor, wheels, gyro and command.

Of two sweeps between which the robot has moved, the later must show the room of the earlier one, if both
are put where wheels and gyro say. Where it does not, someone lies, and who it is shows in who has to be
taken for a liar so that it does. Nobody is accused unless a hypothesis makes the sweeps fit: people who walk
by, and a robot that is pushed or carried, make none fit. A hypothesis has to win in several directions, and
twice on end.
"""

from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import Duration, Instant, milliseconds
from actors.portable import arrays, cos_sin
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.onboard.motion_track import Liar, MotionTrack, PoseTrack
from firmware_bridge.onboard.scan_fit import (
    ScanReading,
    headings,
    load_kernels,
    misfit,
    of_the_room,
    placed,
    sectors,
    thinned,
)
from firmware_bridge.range_sensors.sensor import SensorSweep

_WAYS: Final = (0.08, 0.18, 0.3)
"""Two sweeps are compared between which the robot has gone so far by any account, m, ..."""
_TURNS: Final = (0.2, 0.4, 0.6)
"""... or turned so much, rad: soon, and once more over a way that shows what is only half wrong."""
_OLDEST: Final[Duration] = milliseconds(1500)
"""Between two sweeps that are compared; own choice."""
_PERIOD: Final[Duration] = milliseconds(80)
"""No sweep is judged sooner after another; a camera gives 30 a second."""
_UNHEARD: Final[Duration] = milliseconds(60)
"""A base that was not heard for so long before the end of a sweep may have moved otherwise since."""
_FEWEST: Final = 24
"""Points with which anything is judged."""
_OFF: Final = 2.0
"""A point that far off, in what is near, does not belong to the room."""
_ODD_SHARE: Final = 0.08
"""Share of points off, from which on it is asked who lies."""
_VOTES: Final = 0.08
"""Share of the points that a hypothesis has to bring back into the room, ..."""
_STILL_VOTES: Final = 0.3
"""... and of that by which the sensor stands still: who walks beside a robot in a long corridor seems to."""
_EXPLAINED: Final = 0.5
"""Share of the points out of the room that it has to bring back: the rest may be new to the sensor."""
_DISSENT: Final = 0.2
"""Share of these that it may take out of the room."""
_SECTORS: Final = 3
"""Of twelve, in which it has to do so."""
_IN_A_ROW: Final = 2
_TOUCHES: Final = 0.3
"""What is so near to the body's middle, m, may be touched: its radius, and a decimetre. Own choice."""
_TURNED: Final = headings(15)
_LATE_US: Final = (250_000, 500_000, 750_000, 1_000_000)


class Hypothesis(NamedTuple):
    """Who lies, and how."""

    cause: HoldCause
    liar: Liar = Liar.NOBODY
    reading: ScanReading = ScanReading()


TRUTH: Final = ScanReading()
_MOTION: Final = (
    Hypothesis(HoldCause.LEFT_WHEEL, Liar.LEFT),
    Hypothesis(HoldCause.RIGHT_WHEEL, Liar.RIGHT),
    Hypothesis(HoldCause.WHEELS, Liar.WHEELS),
    Hypothesis(HoldCause.GYRO, Liar.GYRO),
)
_SENSOR: Final = (
    *(Hypothesis(HoldCause.SCAN_TURNED, reading=ScanReading(turned)) for turned in _TURNED),
    *(
        Hypothesis(HoldCause.SCAN_MIRRORED, reading=ScanReading(turned, True))
        for turned in (0.0, *headings(90))
    ),
    *(Hypothesis(HoldCause.SCAN_LATE, reading=ScanReading(late_us=late)) for late in _LATE_US),
)


class Votes(NamedTuple):
    """What a hypothesis makes of the points."""

    cause: HoldCause
    gained: int
    lost: int
    off: int
    """How many were out of the room."""
    points: int
    sectors: int

    @property
    def convincing(self) -> bool:
        """True if it explains what the truth of all sensors does not."""
        share = _STILL_VOTES if self.cause is HoldCause.SCAN_STILL else _VOTES
        return (
            self.gained >= max(share * self.points, _EXPLAINED * self.off)
            and self.lost <= _DISSENT * self.gained
            and self.sectors >= _SECTORS
        )


class ScanChecks:
    """Feed it every sweep; it answers with whom the sweeps contradict."""

    def __init__(self, mount: Pose) -> None:
        """`mount`: of the range sensor on the body."""
        load_kernels()
        self._mount = mount
        self._sweeps: deque[SensorSweep] = deque()
        self._suspect: HoldCause | None = None
        self._in_a_row = 0

    def forget(self) -> None:
        """Begin anew."""
        self._sweeps.clear()
        self._suspect, self._in_a_row = None, 0

    def take(self, sweep: SensorSweep, motion: MotionTrack) -> HoldCause | None:
        """The cause that this sweep shows, if it shows any."""
        if self._sweeps and sweep.stamps[-1] - self._sweeps[-1].stamps[-1] < _PERIOD:
            return None
        begin, end = motion.begin, motion.end
        if end is None or sweep.stamps[-1] > end + _UNHEARD:
            return None
        self._sweeps.append(sweep)
        while self._sweeps and (begin is None or not self._known(self._sweeps[0], sweep, begin)):
            self._sweeps.popleft()
        if len(self._sweeps) < 2:
            return None
        suspect = self._judge(motion)
        if suspect is None or suspect is not self._suspect:
            self._in_a_row = 0
        self._suspect = suspect
        self._in_a_row += suspect is not None
        return suspect if self._in_a_row >= _IN_A_ROW else None

    @staticmethod
    def _known(old: SensorSweep, new: SensorSweep, begin: Instant) -> bool:
        """True if the old sweep is young enough, and the track goes back to it."""
        return bool(old.stamps[0] >= begin and new.stamps[-1] - old.stamps[0] <= _OLDEST)

    def _judge(self, motion: MotionTrack) -> HoldCause | None:
        """Who has to be taken for a liar so that the last sweeps fit; None: nobody, or it cannot be told."""
        tracks = motion.tracks((Liar.NOBODY, Liar.WHEELS, Liar.GYRO))
        for way, turn in zip(_WAYS, _TURNS, strict=True):
            pair = self._pair(tuple(tracks.values()), way, turn)
            if pair is None:
                return None
            told = self._misfit(pair, tracks[Liar.NOBODY], TRUTH)
            if told.size >= _FEWEST and np.count_nonzero(told > _OFF) >= _ODD_SHARE * told.size:
                liars = (Liar.LEFT, Liar.RIGHT)
                cause = self._best(pair, tracks | motion.tracks(liars), told)
                if cause is not None:
                    return cause
        return None

    def _best(
        self, pair: tuple[SensorSweep, SensorSweep], tracks: dict[Liar, PoseTrack], told: NDArray[np.float64]
    ) -> HoldCause | None:
        """The hypothesis that explains most, if any does."""
        known = pair[0].stamps[0] - tracks[Liar.NOBODY].instants[0]
        found = [
            votes(one.cause, told, self._misfit(pair, tracks[one.liar], one.reading))
            for one in (*_MOTION, *_SENSOR)
            if one.reading.late_us <= known
        ]
        told_track = tracks[Liar.NOBODY]
        if not stands_before_something(pair, self._mount, told_track):
            still = self._misfit(pair, _nowhere(told_track), TRUTH)
            found.append(votes(HoldCause.SCAN_STILL, told, still))
        convincing = [one for one in found if one.convincing]
        return max(convincing, key=lambda one: one.gained - one.lost).cause if convincing else None

    def _pair(
        self, tracks: tuple[PoseTrack, ...], way: float, turned: float
    ) -> tuple[SensorSweep, SensorSweep] | None:
        """The last sweep, and the last one before it from which the robot has moved enough."""
        last = self._sweeps[-1]
        for earlier in list(self._sweeps)[-2::-1]:
            ends = np.array([_middle(earlier), _middle(last)])
            for track in tracks:
                there = track.at(ends)
                (dx,), (dy,), (turn,) = np.diff(there.x), np.diff(there.y), np.diff(there.heading)
                if dx * dx + dy * dy >= way * way or abs(turn) >= turned:
                    return earlier, last
        return None

    def _misfit(
        self, pair: tuple[SensorSweep, SensorSweep], track: PoseTrack, reading: ScanReading
    ) -> NDArray[np.float64]:
        earlier = placed(pair[0], self._mount, track, reading)
        later = placed(of_the_room(pair[1]), self._mount, track, reading)
        if len(earlier.xy) < _FEWEST:
            return np.empty(0)
        return misfit(thinned(later), earlier)


def votes(cause: HoldCause, told: NDArray[np.float64], instead: NDArray[np.float64]) -> Votes:
    """What becomes of the points if that cause holds: (n,) misfits of what the sensors told, and instead."""
    gained = (told > _OFF) & (instead <= 1.0)
    lost = (told <= 1.0) & (instead > _OFF)
    won, missed, off = (int(np.count_nonzero(chosen)) for chosen in (gained, lost, told > _OFF))
    return Votes(cause, won, missed, off, told.size, sectors(gained))


def stands_before_something(pair: tuple[SensorSweep, SensorSweep], mount: Pose, track: PoseTrack) -> bool:
    """True if a robot that does not turn has something right before it, so that its wheels may slip."""
    ends = track.at(np.array([_middle(sweep) for sweep in pair]))
    (dx,), (dy,), (turn,) = np.diff(ends.x), np.diff(ends.y), np.diff(ends.heading)
    if abs(turn) >= _TURNS[0]:
        return False
    c, s = cos_sin(float(ends.heading[0]))
    backward = dx * c + dy * s < 0
    angles = mount.heading + pair[1].angles
    with np.errstate(invalid="ignore"):
        x = mount.x + pair[1].ranges * arrays.cos(angles)
        y = mount.y + pair[1].ranges * arrays.sin(angles)
        ahead = np.where(backward, -x, x)
        return bool(((ahead > np.abs(y)) & (arrays.hypot(x, y) <= _TOUCHES)).any())


def _middle(sweep: SensorSweep) -> Instant:
    """The median of its stamps."""
    stamps = np.sort(sweep.stamps)
    return Instant(int(stamps[(stamps.size - 1) // 2] + stamps[stamps.size // 2]) // 2)


def _nowhere(track: PoseTrack) -> PoseTrack:
    """Of a robot that stands."""
    still = np.zeros(track.x.size)
    return PoseTrack(track.instants, still, still, still)
