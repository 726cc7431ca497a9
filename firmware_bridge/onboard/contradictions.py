"""Consistency checks between range sensor, wheels, gyro and command; the robot stops on a contradiction.

Of two scans between which the robot has moved, the later must show the room of the earlier one if both are
placed by wheels and gyro. Where it does not, the faulty sensor is the one whose fault, if assumed, makes the
scans consistent. No sensor is reported unless such a hypothesis exists: people who walk by and a robot that
is pushed or carried give none. A hypothesis must win in several directions and twice in a row.

Without I/O, clock and randomness: the same feedbacks, commands and scans give the same causes.
"""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose, wrap
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.portable import arrays, cos_sin
from firmware_bridge.kobuki.motion import METRES_PER_TICK, TRACK, signed
from firmware_bridge.kobuki.safety import HoldCause
from firmware_bridge.kobuki.wire import Basic, Inertial
from firmware_bridge.onboard.motion_checks import Liar, MotionChecks, MotionTrack, Moved, PoseTrack
from firmware_bridge.range_sensors.sensor import SensorSweep

_POINTS: Final = 90
"""Points of the later sweep that are looked for in the earlier one; enough to see a door frame."""
_GAP: Final = 0.5
"""Neighbouring points of a sweep so near to each other are taken for one wall, m."""
_BREAK: Final = 0.15
"""Neighbouring points farther apart than this, m, ..."""
_BREAK_SHARE: Final = 0.07
"""... or than this share of their range belong to two things; a wall looked along at 15° does not break."""
_EXTENT: Final = 0.8
"""Smaller things, m, are no witnesses: people and robots, which may go along with the robot. Own choice."""
_NEAR: Final = 0.02
"""A point so near to that room belongs to it, m; own choice, and ..."""
_NEAR_SHARE: Final = 0.008
"""... so much of its range more: noise, and what a degree leaves open."""


class Points(NamedTuple):
    """A sweep in the frame of a track."""

    xy: NDArray[np.float64]
    """(n, 2), m; by angle."""
    near: NDArray[np.float64]
    """(n,): how near to the room each has to be, m."""


def load_kernels() -> None:
    """Load what this computes with, before a robot drives: without a cache it takes some seconds."""
    for function in (arrays.cos, arrays.sin):
        function(np.zeros(1))
    arrays.hypot(np.zeros(1), np.zeros(1))


class Hypothesis(NamedTuple):
    """A fault, and how scans are to be placed if it is there."""

    cause: HoldCause | None = None
    liar: Liar = Liar.NOBODY
    turned: float = 0.0
    """How the sensor is turned on its mount, rad, counter-clockwise."""
    mirrored: bool = False
    late_us: int = 0


def of_the_room(sweep: SensorSweep) -> SensorSweep:
    """The echoes of a sweep that are of large things; of those people and robots are not."""
    seen = np.isfinite(sweep.ranges)
    sweep = SensorSweep(sweep.stamps[seen], sweep.angles[seen], sweep.ranges[seen])
    if not sweep.ranges.size:
        return sweep
    x, y = sweep.ranges * arrays.cos(sweep.angles), sweep.ranges * arrays.sin(sweep.angles)
    gaps = arrays.hypot(np.diff(x), np.diff(y))
    breaks = gaps > np.maximum(_BREAK, _BREAK_SHARE * sweep.ranges[1:])
    things = np.append(0, np.cumsum(breaks, dtype=np.int64))
    large = (arrays.hypot(_extents(x, things), _extents(y, things)) >= _EXTENT)[things]
    return SensorSweep(sweep.stamps[large], sweep.angles[large], sweep.ranges[large])


def _extents(axis: NDArray[np.float64], things: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of each thing along an axis, m; (n,) coordinates, (n,) numbers of things from 0 on."""
    count = int(things[-1]) + 1
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, things, axis)
    np.maximum.at(most, things, axis)
    extents: NDArray[np.float64] = most - least
    return extents


def placed(sweep: SensorSweep, mount: Pose, track: PoseTrack, hypothesis: Hypothesis) -> Points:
    """The points of a sweep's echoes where the hypothesis has them; `mount`: of the sensor on the body."""
    seen = np.isfinite(sweep.ranges)
    ranges, angles = sweep.ranges[seen], sweep.angles[seen] + hypothesis.turned
    angles = mount.heading + (-angles if hypothesis.mirrored else angles)
    body_x, body_y = mount.x + ranges * arrays.cos(angles), mount.y + ranges * arrays.sin(angles)
    poses = track.at(sweep.stamps[seen] - hypothesis.late_us)
    c, s = arrays.cos(poses.heading), arrays.sin(poses.heading)
    xy = np.column_stack((poses.x + c * body_x - s * body_y, poses.y + s * body_x + c * body_y))
    return Points(xy, _NEAR + _NEAR_SHARE * ranges)


def thinned(points: Points) -> Points:
    """Some of them, evenly."""
    step = max(1, len(points.xy) // _POINTS)
    return Points(points.xy[::step], points.near[::step])


def misfit(later: Points, earlier: Points) -> NDArray[np.float64]:
    """How far each later point is from the room that the earlier ones draw, as a multiple of near: (n,)."""
    begins = earlier.xy[:-1]
    along = earlier.xy[1:] - begins
    squares = along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1]
    joined = (squares > 0) & (squares <= _GAP * _GAP)
    per_square = np.where(joined, 1.0 / np.where(joined, squares, 1.0), 0.0)
    x = later.xy[:, 0, None] - begins[None, :, 0]
    y = later.xy[:, 1, None] - begins[None, :, 1]
    shares = x * along[:, 0] + y * along[:, 1]
    shares *= per_square
    np.clip(shares, 0.0, 1.0, out=shares)
    x -= shares * along[:, 0]
    y -= shares * along[:, 1]
    x *= x
    y *= y
    x += y
    nearest: NDArray[np.float64] = np.sqrt(x.min(axis=1)) / later.near
    return nearest


def sectors(chosen: NDArray[np.bool_], count: int = 12) -> int:
    """In how many equal parts of the sweep some are chosen, two at least."""
    parts = np.array_split(chosen, count)
    return sum(np.count_nonzero(part) >= 2 for part in parts)


def headings(step_deg: int) -> tuple[float, ...]:
    """All mountings but the right one, rad."""
    return tuple(math.radians(turned) for turned in range(step_deg, 360, step_deg))


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
_STILL: Final = Hypothesis(HoldCause.SCAN_STILL)
_HYPOTHESES: Final = (
    Hypothesis(HoldCause.WHEELS, Liar.WHEELS),
    Hypothesis(HoldCause.GYRO, Liar.GYRO),
    *(Hypothesis(HoldCause.SCAN_TURNED, turned=turned) for turned in headings(15)),
    *(Hypothesis(HoldCause.SCAN_MIRRORED, turned=turned, mirrored=True) for turned in (0.0, *headings(90))),
    *(Hypothesis(HoldCause.SCAN_LATE, late_us=late) for late in (250_000, 500_000, 750_000, 1_000_000)),
)


def explains(cause: HoldCause, told: NDArray[np.float64], instead: NDArray[np.float64]) -> int:
    """How many points more fit if that cause holds; 0 if it does not explain the misfit.

    `told`, `instead`: (n,) misfits of what the sensors told, and under the hypothesis.
    """
    gained = (told > _OFF) & (instead <= 1.0)
    lost = (told <= 1.0) & (instead > _OFF)
    won, missed, off = (int(np.count_nonzero(chosen)) for chosen in (gained, lost, told > _OFF))
    share = _STILL_VOTES if cause is HoldCause.SCAN_STILL else _VOTES
    if won < max(share * told.size, _EXPLAINED * off) or missed > _DISSENT * won:
        return 0
    return won - missed if sectors(gained) >= _SECTORS else 0


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
        """The fault that makes the last scans consistent; None: there is none, or it cannot be told."""
        tracks = motion.tracks()
        for way, turn in zip(_WAYS, _TURNS, strict=True):
            pair = self._pair(tuple(tracks.values()), way, turn)
            if pair is None:
                return None
            told = self._misfit(pair, tracks[Liar.NOBODY], Hypothesis())
            if told.size >= _FEWEST and np.count_nonzero(told > _OFF) >= _ODD_SHARE * told.size:
                cause = self._best(pair, tracks, told)
                if cause is not None:
                    return cause
        return None

    def _best(
        self, pair: tuple[SensorSweep, SensorSweep], tracks: dict[Liar, PoseTrack], told: NDArray[np.float64]
    ) -> HoldCause | None:
        """The hypothesis that explains most, if any does."""
        track = tracks[Liar.NOBODY]
        known = pair[0].stamps[0] - track.instants[0]
        found = {
            one: self._misfit(pair, tracks[one.liar], one) for one in _HYPOTHESES if one.late_us <= known
        }
        if not stands_before_something(pair, self._mount, track):
            found[_STILL] = self._misfit(pair, _nowhere(track), _STILL)
        points = [
            (explains(one.cause, told, misfit), one.cause) for one, misfit in found.items() if one.cause
        ]
        most, cause = max(points, key=lambda one: one[0])
        return cause if most > 0 else None

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
        self, pair: tuple[SensorSweep, SensorSweep], track: PoseTrack, hypothesis: Hypothesis
    ) -> NDArray[np.float64]:
        earlier = placed(pair[0], self._mount, track, hypothesis)
        later = placed(of_the_room(pair[1]), self._mount, track, hypothesis)
        if len(earlier.xy) < _FEWEST:
            return np.empty(0)
        return misfit(thinned(later), earlier)


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


REST: Final[Duration] = seconds(2)
"""So long a robot stands for a contradiction that shows in motion only; then it may try again. Own choice."""
_STRIKES: Final = 3
"""Once the same shows so often, it stands until its base is started again; own choice, ..."""
_FORGIVEN: Final[Duration] = seconds(60)
"""... unless so much time is between."""
_FOR_GOOD: Final[Duration] = seconds(1e9)
_LONGEST_GAP: Final[Duration] = milliseconds(200)
"""Between two feedbacks; after a longer one nothing is known of the motion between."""


class Contradictions:
    """Feed it what the sensors say, and ask it before anything moves."""

    def __init__(self, mount: Pose | None) -> None:
        """`mount`: of the range sensor on the body; None = there is none."""
        self._motion = MotionTrack()
        self._checks = MotionChecks()
        self._scans = None if mount is None else ScanChecks(mount)
        self._last: tuple[Instant, Basic, Inertial | None] | None = None
        self._commanded = (0.0, 0.0)
        self._until: dict[HoldCause, Instant] = {}
        self._strikes: dict[HoldCause, int] = {}
        self.gyro_judged = False
        """Wheels and scans agree on a turn that the gyro has not seen; without scans, wheels and command."""

    def feedback(self, now: Instant, basic: Basic, inertial: Inertial | None) -> None:
        """Take in what a base says; see `commanded` for what it was told meanwhile."""
        last, self._last = self._last, (now, basic, inertial)
        if last is None or now - last[0] > _LONGEST_GAP or basic.wheel_drop:
            self._forget()
            return
        before = last[1]
        left, right = (
            signed(a - b) * METRES_PER_TICK
            for a, b in ((basic.left_ticks, before.left_ticks), (basic.right_ticks, before.right_ticks))
        )
        turn = (right - left) / TRACK
        if inertial is not None and last[2] is not None:
            turn = wrap(math.radians((inertial.angle_cdeg - last[2].angle_cdeg) / 100))
        moved = Moved(now, left, right, turn, *self._commanded)
        self._motion.take(moved)
        cause = self._checks.take(moved, basic)
        if cause is not None:
            self.gyro_judged |= cause is HoldCause.GYRO and self._scans is None
            self._tell(now, cause)

    def commanded(self, v: float, omega: float) -> None:
        """What the base is told from now on, m/s and rad/s."""
        self._commanded = (v, omega)

    def sweep(self, now: Instant, sweep: SensorSweep) -> None:
        """Take in a sweep of the range sensor."""
        cause = None if self._scans is None else self._scans.take(sweep, self._motion)
        self.gyro_judged |= cause is HoldCause.GYRO
        if cause is not None and self._commanded != (0.0, 0.0):
            self._tell(now, cause)

    def repeated(self, now: Instant, cause: HoldCause) -> None:
        """The range sensor itself shows that; it is over a rest after it was last said."""
        self._until[cause] = Instant(now + REST)

    def on_wheels(self) -> None:
        """The heading is that of the wheels from now on: the gyro contradicts nobody any more."""
        self.gyro_judged = False
        self._until.pop(HoldCause.GYRO, None)
        self._strikes.pop(HoldCause.GYRO, None)
        self._forget()

    def causes(self, now: Instant) -> frozenset[HoldCause]:
        """For which nothing may move now."""
        return frozenset(cause for cause, until in self._until.items() if now < until)

    def _tell(self, now: Instant, cause: HoldCause) -> None:
        until = self._until.get(cause)
        if until is not None and now < until:
            return
        fresh = until is None or now - until > _FORGIVEN
        self._strikes[cause] = strikes = 1 if fresh else self._strikes[cause] + 1
        if cause is HoldCause.BLOCKED:  # mostly true: it tries again, ever more seldom
            rest = min(REST << (strikes - 1), _FORGIVEN)
        else:
            rest = REST if strikes < _STRIKES else _FOR_GOOD
        self._until[cause] = Instant(now + rest)
        self._checks.forget()
        if cause is not HoldCause.GYRO:  # of which scans say more while the robot comes to stand
            self._forget()

    def _forget(self) -> None:
        self._motion.forget()
        self._checks.forget()
        if self._scans is not None:
            self._scans.forget()
