"""Consistency checks between range sensor, wheels, gyro and command; the robot stops on a contradiction.

Two scans, placed by wheels and gyro, must show the same room. If they do not, the faulty sensor is the one
whose assumed fault makes the scans consistent. Without such a hypothesis (passers-by, a pushed or carried
robot) no sensor is reported. A hypothesis must win in several directions and twice in a row.

Without I/O, clock and randomness: equal inputs give equal causes.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats
from actors.geometry import Pose
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.portable import arrays
from firmware_bridge.base_feedback import DriveFeedback
from firmware_bridge.onboard.motion_checks import (
    MotionChecks,
    Movement,
    PoseTrack,
    SuspectSensor,
    direction,
    pose_track,
)
from firmware_bridge.range_sensors.sensor import SensorSweep, chosen_samples
from firmware_bridge.safety import HoldCause

_POINTS: Final = 90
"""Number of compared points of the later sweep; enough to resolve a door frame."""
_GAP: Final = 0.5
"""Maximum distance of neighbouring points that form a wall, m."""
_BREAK: Final = 0.15
"""Distance of neighbouring points that separates two objects, m, ..."""
_BREAK_SHARE: Final = 0.07
"""... at least this share of their range; a wall seen at 15° stays connected."""
_EXTENT: Final = 0.8
"""Minimum extent of compared objects, m, which excludes people and robots. Own choice."""
_NEAR: Final = 0.02
"""Tolerance of a point's distance to the room, m; own choice, ..."""
_NEAR_SHARE: Final = 0.008
"""... plus this share of its range, for noise and angular resolution."""


class Hypothesis(NamedTuple):
    """An assumed fault and the corresponding placement of scans."""

    cause: HoldCause | None = None
    suspect: SuspectSensor = SuspectSensor.NONE
    turned: float = 0.0
    """Rotation of the sensor on its mount, rad, counter-clockwise."""
    mirrored: bool = False
    late_us: int = 0


def large_objects(sweep: SensorSweep) -> SensorSweep:
    """Return the samples of large objects, without people and robots; all samples must be echoes."""
    if not sweep.ranges.size:
        return sweep
    x, y = sweep.ranges * arrays.cos(sweep.angles), sweep.ranges * arrays.sin(sweep.angles)
    gaps = arrays.hypot(np.diff(x), np.diff(y))
    breaks = gaps > np.maximum(_BREAK, _BREAK_SHARE * sweep.ranges[1:])
    begins = np.flatnonzero(np.append(True, breaks))
    width, depth = (np.maximum.reduceat(axis, begins) - np.minimum.reduceat(axis, begins) for axis in (x, y))
    large = arrays.hypot(width, depth) >= _EXTENT
    return chosen_samples(sweep, np.repeat(large, np.diff(np.append(begins, x.size))))


def echo_positions(
    sweep: SensorSweep, mount: Pose, track: PoseTrack, hypothesis: Hypothesis
) -> NDArray[np.complex128]:
    """Return the positions of the echoes under a hypothesis; `mount`: pose of the sensor on the body."""
    angles = sweep.angles + hypothesis.turned
    angles = mount.heading + (-angles if hypothesis.mirrored else angles)
    poses = track.at(sweep.stamps - hypothesis.late_us)
    on_body = complex(mount.x, mount.y) + sweep.ranges * direction(angles)
    return poses.position + direction(poses.heading) * on_body


def distances(points: NDArray[np.complex128], room: NDArray[np.complex128]) -> Floats:
    """Return the distance of each point from the walls formed by neighbouring points of the room: (n,), m."""
    begins, along = room[:-1], np.diff(room)
    squares = along.real * along.real + along.imag * along.imag
    joined = (squares > 0) & (squares <= _GAP * _GAP)
    offsets = points[:, None] - begins
    shares = (offsets * along.conj()).real * np.where(joined, 1.0 / np.where(joined, squares, 1.0), 0.0)
    nearest: Floats = np.abs(offsets - np.clip(shares, 0.0, 1.0) * along).min(axis=1)
    return nearest


def mount_rotations(step_deg: int) -> tuple[float, ...]:
    """Return all rotations of the mount except 0, rad."""
    return tuple(math.radians(turned) for turned in range(step_deg, 360, step_deg))


_MIN_DISTANCES: Final = (0.08, 0.18, 0.3)
"""Distance between compared sweeps by any track, m: short for fast detection, long for partial faults; ..."""
_MIN_TURNS: Final = (0.2, 0.4, 0.6)
"""... or turn, rad."""
_MAX_SWEEP_AGE: Final = milliseconds(1500)
"""Maximum time between compared sweeps; own choice."""
_PERIOD: Final = milliseconds(80)
"""Minimum time between checked sweeps; a camera returns 30 per second."""
_MAX_FEEDBACK_AGE: Final = milliseconds(60)
"""Maximum age of the last feedback at the end of a sweep; later motion is unknown."""
_MIN_POINTS: Final = 24
"""Minimum number of points for a decision."""
_AWAY: Final = 2.0
"""Misfit of a point outside of the room, in units of the tolerance."""
_SHARE: Final = 0.08
"""Share of points outside of the room from which hypotheses are tested."""
_MIN_GAIN: Final = 0.08
"""Minimum share of all points that a hypothesis must fit better, ..."""
_MIN_GAIN_STILL: Final = 0.3
"""... and for a frozen sensor, as a person beside the robot in a long corridor looks similar."""
_MIN_EXPLAINED: Final = 0.5
"""Minimum share of the points outside of the room that it must explain; the others may be newly visible."""
_MAX_WORSE_SHARE: Final = 0.2
"""Maximum number of points that it fits worse, relative to those."""
_SECTORS: Final = 12
_MIN_SECTORS: Final = 3
"""Minimum number of sectors with such points."""
_CONFIRMATIONS: Final = 2
_CONTACT_DISTANCE: Final = 0.3
"""Distance from the body's centre of obstacles that may be in contact, m: radius plus a decimetre. Own
choice."""
_STILL: Final = Hypothesis(HoldCause.SCAN_STILL)
_HYPOTHESES: Final = (
    Hypothesis(HoldCause.WHEELS, SuspectSensor.WHEELS),
    Hypothesis(HoldCause.GYRO, SuspectSensor.GYRO),
    *(Hypothesis(HoldCause.SCAN_ROTATED, turned=turned) for turned in mount_rotations(15)),
    *(
        Hypothesis(HoldCause.SCAN_MIRRORED, turned=turned, mirrored=True)
        for turned in (0.0, *mount_rotations(90))
    ),
    *(Hypothesis(HoldCause.SCAN_LATE, late_us=late) for late in (250_000, 500_000, 750_000, 1_000_000)),
)


def explained_points(cause: HoldCause, measured: Floats, assumed: Floats) -> int:
    """Return how many more points fit under the hypothesis; 0 if it does not explain the misfit.

    `measured`, `assumed`: (n,) misfits as measured, and under the hypothesis.
    """
    improved = (measured > _AWAY) & (assumed <= 1.0)
    worsened = (measured <= 1.0) & (assumed > _AWAY)
    better, worse, outside = (
        int(np.count_nonzero(chosen)) for chosen in (improved, worsened, measured > _AWAY)
    )
    share = _MIN_GAIN_STILL if cause is HoldCause.SCAN_STILL else _MIN_GAIN
    if better < max(share * measured.size, _MIN_EXPLAINED * outside) or worse > _MAX_WORSE_SHARE * better:
        return 0
    sectors = sum(np.count_nonzero(part) >= 2 for part in np.array_split(improved, _SECTORS))
    return better - worse if sectors >= _MIN_SECTORS else 0


class ScanChecks:
    """Detector of sensor faults from consecutive sweeps."""

    def __init__(self, mount: Pose, track: float) -> None:
        """Create it; `mount`: pose of the range sensor on the body, `track`: of the wheels, m."""
        # Compile or load the kernels before the robot drives; some seconds without a cache.
        arrays.fingerprint()
        self._mount, self._track = mount, track
        self._sweeps: deque[SensorSweep] = deque()
        """Echoes only."""
        self._suspect: HoldCause | None = None
        self._confirmations = 0

    def forget(self) -> None:
        """Discard all sweeps."""
        self._sweeps.clear()
        self._suspect, self._confirmations = None, 0

    def take(self, sweep: SensorSweep, moves: Sequence[Movement]) -> HoldCause | None:
        """Add a sweep and return a detected fault; `moves`: recent movements of the base."""
        sweep = chosen_samples(sweep, np.isfinite(sweep.ranges))
        if not sweep.stamps.size or not moves or sweep.stamps[-1] > moves[-1].instant + _MAX_FEEDBACK_AGE:
            return None
        if self._sweeps and sweep.stamps[-1] - self._sweeps[-1].stamps[-1] < _PERIOD:
            return None
        self._sweeps.append(sweep)
        oldest = max(moves[0].instant, sweep.stamps[-1] - _MAX_SWEEP_AGE)
        while self._sweeps and self._sweeps[0].stamps[0] < oldest:
            self._sweeps.popleft()
        if len(self._sweeps) < 2:
            return None
        suspect = self._find_fault({one: pose_track(moves, one, self._track) for one in SuspectSensor})
        if suspect is None or suspect is not self._suspect:
            self._confirmations = 0
        self._suspect = suspect
        self._confirmations += suspect is not None
        return suspect if self._confirmations >= _CONFIRMATIONS else None

    def _find_fault(self, tracks: Mapping[SuspectSensor, PoseTrack]) -> HoldCause | None:
        """Return the fault that makes the last scans consistent; None if there is none or it is ambiguous."""
        for distance, turn in zip(_MIN_DISTANCES, _MIN_TURNS, strict=True):
            earlier = self._earlier(tracks, distance, turn)
            if earlier is None:
                return None
            measured = self._misfit(earlier, tracks[SuspectSensor.NONE], Hypothesis())
            if measured.size >= _MIN_POINTS and np.count_nonzero(measured > _AWAY) >= _SHARE * measured.size:
                cause = self._best_hypothesis(earlier, tracks, measured)
                if cause is not None:
                    return cause
        return None

    def _best_hypothesis(
        self, earlier: SensorSweep, tracks: Mapping[SuspectSensor, PoseTrack], measured: Floats
    ) -> HoldCause | None:
        """Return the cause of the hypothesis that explains most points, if any."""
        track = tracks[SuspectSensor.NONE]
        known = earlier.stamps[0] - track.instants[0]
        found = [(one, tracks[one.suspect]) for one in _HYPOTHESES if one.late_us <= known]
        if not has_contact_ahead(earlier, self._sweeps[-1], self._mount, track):
            still = PoseTrack(track.instants, 0 * track.position, 0 * track.heading)
            found.append((_STILL, still))
        points = [
            (explained_points(one.cause, measured, self._misfit(earlier, placed, one)), one.cause)
            for one, placed in found
            if one.cause
        ]
        score, cause = max(points, key=lambda one: one[0])
        return cause if score > 0 else None

    def _earlier(
        self, tracks: Mapping[SuspectSensor, PoseTrack], distance: float, turned: float
    ) -> SensorSweep | None:
        """Return the latest sweep since which the robot has moved enough, by any track."""
        last = self._sweeps[-1]
        for earlier in list(self._sweeps)[-2::-1]:
            for track in tracks.values():
                moved, turn = _motion_between(earlier, last, track)
                if abs(moved) >= distance or abs(turn) >= turned:
                    return earlier
        return None

    def _misfit(self, earlier: SensorSweep, track: PoseTrack, hypothesis: Hypothesis) -> Floats:
        """Return distances of the last sweep's points from the earlier room, in units of the tolerance:
        (n,)."""
        if earlier.ranges.size < _MIN_POINTS:
            return np.empty(0)
        later = large_objects(self._sweeps[-1])
        later = chosen_samples(later, slice(None, None, max(1, later.ranges.size // _POINTS)))
        room, points = (echo_positions(sweep, self._mount, track, hypothesis) for sweep in (earlier, later))
        return distances(points, room) / (_NEAR + _NEAR_SHARE * later.ranges)


def has_contact_ahead(earlier: SensorSweep, later: SensorSweep, mount: Pose, track: PoseTrack) -> bool:
    """Return whether an obstacle is in contact in the direction of straight motion, so that wheels may
    slip."""
    moved, turn = _motion_between(earlier, later, track)
    if abs(turn) >= _MIN_TURNS[0]:
        return False
    echoes = complex(mount.x, mount.y) + later.ranges * direction(mount.heading + later.angles)
    ahead = -echoes.real if moved.real < 0 else echoes.real
    return bool(((ahead > np.abs(echoes.imag)) & (np.abs(echoes) <= _CONTACT_DISTANCE)).any())


def _motion_between(earlier: SensorSweep, later: SensorSweep, track: PoseTrack) -> tuple[complex, float]:
    """Return translation, m, forward + i left, and turn, rad, between the middles of two sweeps."""
    poses = track.at(np.array([sweep.stamps[sweep.stamps.size // 2] for sweep in (earlier, later)]))
    (distance,), (turn,) = np.diff(poses.position), np.diff(poses.heading)
    return complex(distance * direction(poses.heading)[0].conj()), float(turn)


REST: Final = seconds(2)
"""Stop after a contradiction, which shows in motion only; then the robot retries. Own choice."""
_MAX_OCCURRENCES: Final = 3
"""Number of occurrences after which it stands until the base is restarted; own choice, ..."""
_FORGET_AFTER: Final = seconds(60)
"""... unless this time passes in between."""
_PERMANENT: Final = seconds(1e9)
_LONGEST_GAP: Final = milliseconds(200)
"""Maximum time between two feedbacks; motion in a longer gap is unknown."""


_MAX_MOVEMENTS: Final = 160
"""Number of stored movements, 3.2 s."""


class ContradictionMonitor:
    """Active contradictions between the sensors."""

    def __init__(self, mount: Pose | None, track: float) -> None:
        """Create it.

        `mount`: pose of the range sensor on the body, None = no sensor; `track`: distance between the wheels,
        m.
        """
        self._track = track
        self._moves: deque[Movement] = deque(maxlen=_MAX_MOVEMENTS)
        self._checks = MotionChecks(track)
        self._scans = None if mount is None else ScanChecks(mount, track)
        self._last: DriveFeedback | None = None
        self._commanded = (0.0, 0.0)
        self._until: dict[HoldCause, Instant] = {}
        self._occurrences: dict[HoldCause, int] = {}
        self.is_gyro_contradicted = False
        """True if wheels and scans (without scans, wheels and command) agree on a turn that contradicts the
        gyro."""

    def feedback(self, feedback: DriveFeedback) -> None:
        """Process a feedback of the base; set the velocity by `set_command` first."""
        last, self._last = self._last, feedback
        now = feedback.instant
        if last is None or now - last.instant > _LONGEST_GAP or feedback.basic.wheel_drop:
            self._forget()
            return
        _, left, right, turn = feedback.since(last)
        turn = (right - left) / self._track if turn is None else turn
        move = Movement(now, Duration(now - last.instant), left, right, turn, *self._commanded)
        self._moves.append(move)
        cause = self._checks.take(move, feedback)
        if cause is not None:
            self.is_gyro_contradicted |= cause is HoldCause.GYRO and self._scans is None
            self._report(now, cause)

    def set_command(self, v: float, omega: float) -> None:
        """Set the velocity commanded from now on, m/s and rad/s."""
        self._commanded = (v, omega)

    def sweep(self, now: Instant, sweep: SensorSweep) -> None:
        """Process a sweep of the range sensor."""
        cause = None if self._scans is None else self._scans.take(sweep, self._moves)
        self.is_gyro_contradicted |= cause is HoldCause.GYRO
        if cause is not None and self._commanded != (0.0, 0.0):
            self._report(now, cause)

    def report_range_fault(self, now: Instant, cause: HoldCause) -> None:
        """Report a fault in the range sensor's data; it ends REST after the last call."""
        self._until[cause] = Instant(now + REST)

    def ignore_gyro(self) -> None:
        """Stop checking the gyro, as the heading is computed from the wheels."""
        self.is_gyro_contradicted = False
        self._until.pop(HoldCause.GYRO, None)
        self._occurrences.pop(HoldCause.GYRO, None)
        self._forget()

    def causes(self, now: Instant) -> frozenset[HoldCause]:
        """Return the active causes."""
        return frozenset(cause for cause, until in self._until.items() if now < until)

    def _report(self, now: Instant, cause: HoldCause) -> None:
        until = self._until.get(cause)
        if until is not None and now < until:
            return
        fresh = until is None or now - until > _FORGET_AFTER
        self._occurrences[cause] = occurrences = 1 if fresh else self._occurrences[cause] + 1
        if cause is HoldCause.BLOCKED:  # usually a real obstacle: retry at growing intervals
            rest = min(REST << (occurrences - 1), _FORGET_AFTER)
        else:
            rest = REST if occurrences < _MAX_OCCURRENCES else _PERMANENT
        self._until[cause] = Instant(now + rest)
        self._checks.forget()
        if cause is not HoldCause.GYRO:  # scans during braking give more evidence
            self._forget()

    def _forget(self) -> None:
        self._moves.clear()
        self._checks.forget()
        if self._scans is not None:
            self._scans.forget()
