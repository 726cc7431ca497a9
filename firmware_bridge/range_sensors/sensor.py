"""Samples of range sensors: conversion to scans along the robot model's rays, and detection of frozen
data."""

import math
from abc import ABC, abstractmethod
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Flags, Floats, Int64s
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Scan
from actors.robot_model import RangeSensor
from firmware_bridge.safety import HoldCause

REACH: Final = math.radians(1.0)
"""Maximum angle between a ray and the sample used for it if no sample is in the ray's own sector; own choice:
a lidar of 360 samples fills 640 rays, and sectors without samples stay empty."""


class SensorSweep(NamedTuple):
    """Samples of one turn or image, each with its time."""

    stamps: Int64s
    """Times, (n,), µs, ascending."""
    angles: Floats
    """Directions, (n,), in the sensor's frame, counter-clockwise, rad."""
    ranges: Floats
    """Ranges, (n,), m; inf = no echo."""


def chosen_samples(sweep: SensorSweep, chosen: Flags | slice) -> SensorSweep:
    """Return some samples of a sweep."""
    return SensorSweep(sweep.stamps[chosen], sweep.angles[chosen], sweep.ranges[chosen])


class ScanRays:
    """Rays of a sensor's model, and conversion of samples at other angles."""

    def __init__(self, model: RangeSensor, reach: float = REACH) -> None:
        self._model = model
        self._reach = reach
        turned = model.increment * np.arange(model.rays, dtype=np.float64)
        self.angles: Floats = model.first_angle + turned
        """Directions, (rays,), in the sensor's frame, counter-clockwise, rad."""

    def scan(self, stamp: Instant, angles: Floats, ranges: Floats) -> Scan:
        """Convert samples to a scan; `angles`, `ranges`: (n,), rad in the sensor's frame, m.

        Ranges that are not finite or not positive count as no echo. A ray gets the smallest range in its
        sector, else that of the nearest sample within reach, else no echo. As in the simulated world,
        obstacles nearer than the model's minimum range give no echo, but occlude others.
        """
        ranges = np.where(np.isfinite(ranges) & (ranges > 0), ranges, np.inf)
        found = self._nearest(angles, ranges)
        echo = (found >= self._model.range_min) & (found <= self._model.range_max)
        report = np.full(found.size, NO_ECHO_MM, "<u2")
        report[echo] = np.floor(found[echo] * 1000 + 0.5)
        return Scan(stamp, report.tobytes())

    def _nearest(self, angles: Floats, ranges: Floats) -> Floats:
        """Return the range of each ray, m; inf = none."""
        model = self._model
        found = np.full(model.rays, np.inf)
        if not angles.size:
            return found
        middle = model.first_angle + model.increment * (model.rays - 1) / 2
        aside = np.remainder(angles - middle + math.pi, math.tau) - math.pi
        ray = np.floor(aside / model.increment + model.rays / 2).astype(np.int64)
        if model.full_circle:
            ray %= model.rays
        within = (ray >= 0) & (ray < model.rays)
        np.minimum.at(found, ray[within], ranges[within])
        hit = np.zeros(model.rays, np.bool_)
        hit[ray[within]] = True
        if not hit.all():
            found[~hit] = self._nearest_sample(self.angles[~hit], angles, ranges)
        return found

    def _nearest_sample(self, rays: Floats, angles: Floats, ranges: Floats) -> Floats:
        """Return the range of the nearest sample within reach of each direction in `rays`, m; inf = none."""
        around = np.remainder(angles, math.tau)
        order = np.argsort(around, kind="stable")
        around, ranges = around[order], ranges[order]
        wanted = np.remainder(rays, math.tau)
        after = np.searchsorted(around, wanted) % around.size
        before = after - 1
        ahead = np.remainder(around[after] - wanted, math.tau)
        behind = np.remainder(wanted - around[before], math.tau)
        ahead, behind = np.minimum(ahead, math.tau - ahead), np.minimum(behind, math.tau - behind)
        nearest = np.where(ahead < behind, ranges[after], ranges[before])
        return np.where(np.minimum(ahead, behind) <= self._reach, nearest, np.inf)


SECTORS: Final = 12
"""Number of parts of a turn for detecting repetition: 30 samples of an A1 each, 15 ms."""
MIN_ECHOES: Final = 10
"""Minimum number of echoes in a compared part."""
_KEPT_TURNS: Final = 64
"""Number of earlier turns for comparison, 12 s of an A1; own choice."""
_REPEATED: Final = 4
"""Repeated parts in the last turn that are a fault; own choice: 60 ms."""


class RangeReader(ABC):
    """Latest scan and sweep of a range sensor, and faults of its data; base class of the drivers."""

    def __init__(
        self,
        model: RangeSensor,
        stored: int = SECTORS * _KEPT_TURNS,
        window: int = SECTORS,
        maximum: int = _REPEATED,
    ) -> None:
        """Create it; `stored`, `window`, `maximum`: as of RepetitionDetector, by default for turns."""
        self.rays = ScanRays(model)
        self._repeats = RepetitionDetector(stored, window, maximum)
        self._still = FrozenBeamDetector()
        self._scan: Scan | None = None
        self._sweep: SensorSweep | None = None

    @abstractmethod
    def is_measuring(self, now: Instant) -> bool:
        """Return whether it measures and has echoes."""

    @property
    def fault(self) -> HoldCause | None:
        """REPEATED_DATA for repeated data, SCAN_PART for a constant part of the turn; None: none."""
        if self._repeats.found:
            return HoldCause.REPEATED_DATA
        return HoldCause.SCAN_PART if self._still.found else None

    def scan(self) -> Scan | None:
        """Return the latest scan, once."""
        scan, self._scan = self._scan, None
        return scan

    def sweep(self) -> SensorSweep | None:
        """Return the samples of the last turn or image, once."""
        sweep, self._sweep = self._sweep, None
        return sweep

    def store_sweep(self, stamp: Instant, sweep: SensorSweep) -> None:
        """Store a turn or image; `stamp`: time of the resulting scan."""
        self._scan, self._sweep = self.rays.scan(stamp, sweep.angles, sweep.ranges), sweep


_BEAMS: Final = 360
"""Number of compared directions."""
_TURNS: Final = 4
"""Consecutive repetitions after which a beam counts as frozen; own choice: if a coarse sensor repeats one
value in three, one beam in eighty by chance."""
_FROZEN: Final = 0.3
"""Share of frozen beams that is a fault; own choice, far above chance."""
_MIN_ECHOES: Final = 30
"""Minimum number of beams with an echo for a decision."""


class RepetitionDetector:
    """Detector of repeated parts in a sensor's data."""

    def __init__(self, stored: int, window: int, maximum: int) -> None:
        """Store up to `stored` parts; `maximum` repetitions in the last `window` parts are a fault."""
        self._known: deque[bytes] = deque(maxlen=stored)
        self._repeated: deque[bool] = deque(maxlen=window)
        self._most = maximum

    @property
    def found(self) -> bool:
        """True while the sensor repeats data."""
        return self._repeated.count(True) >= self._most

    def take(self, part: bytes) -> None:
        """Add a part, large enough not to be repeated by chance."""
        is_repeated = part in self._known
        self._repeated.append(is_repeated)
        if not is_repeated:
            self._known.append(part)

    def forget(self) -> None:
        """Discard all parts."""
        self._known.clear()
        self._repeated.clear()


class FrozenBeamDetector:
    """Detector of directions with constant ranges."""

    def __init__(self) -> None:
        self._last: Int64s = np.zeros(_BEAMS, np.int64)
        self._same: Int64s = np.zeros(_BEAMS, np.int64)
        self.found = False
        """True while part of the turn is frozen."""

    def take(self, angles: Floats, distances: Int64s) -> None:
        """Add a turn: directions, (n,) rad; distances, (n,) in the sensor's unit, 0 = no echo."""
        beams = np.floor(angles % (2 * np.pi) * (_BEAMS / (2 * np.pi)) + 0.5).astype(np.int64) % _BEAMS
        now = np.zeros(_BEAMS, np.int64)
        now[beams] = distances
        echo = now > 0
        self._same = np.where(echo & (now == self._last), self._same + 1, 0)
        self._last = now
        echoes = int(np.count_nonzero(echo))
        self.found = echoes >= _MIN_ECHOES and np.count_nonzero(self._same >= _TURNS) >= _FROZEN * echoes
