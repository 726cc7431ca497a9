"""Samples of range sensors: conversion to scans along the rays of the robot model, and frozen data."""

import math
from abc import ABC, abstractmethod
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Scan
from actors.robot_model import RangeSensor
from firmware_bridge.kobuki.safety import HoldCause

REACH: Final = math.radians(1.0)
"""How far from a ray a sample may lie and still speak for it where no sample hits the ray's own share of the
circle; own choice: a lidar of 360 samples fills 640 rays, and a sector without samples stays without."""


class SensorSweep(NamedTuple):
    """Samples of one turn or image, each with its own instant."""

    stamps: NDArray[np.int64]
    """(n,), µs, ascending."""
    angles: NDArray[np.float64]
    """(n,), in the sensor's own frame, counter-clockwise, rad."""
    ranges: NDArray[np.float64]
    """(n,), m; inf = no echo."""


class ScanRays:
    """The rays of a sensor's model, and how samples at any other angles become their ranges."""

    def __init__(self, model: RangeSensor, reach: float = REACH) -> None:
        self._model = model
        self._reach = reach
        turned = model.increment * np.arange(model.rays, dtype=np.float64)
        self.angles: NDArray[np.float64] = model.first_angle + turned
        """(rays,), in the sensor's own frame, counter-clockwise, rad."""

    def scan(self, stamp: Instant, angles: NDArray[np.float64], ranges: NDArray[np.float64]) -> Scan:
        """The scan that samples make; `angles`, `ranges`: (n,), rad in the sensor's own frame, m.

        A range that is not finite or not above 0 is no echo. A ray gets the smallest range of the samples
        nearest to it, else that of the nearest sample within reach, else no echo. As in the simulated world,
        what is nearer than the model's range gives no echo, but hides what is behind it.
        """
        ranges = np.where(np.isfinite(ranges) & (ranges > 0), ranges, np.inf)
        found = self._nearest(angles, ranges)
        echo = (found >= self._model.range_min) & (found <= self._model.range_max)
        report = np.full(found.size, NO_ECHO_MM, "<u2")
        report[echo] = np.floor(found[echo] * 1000 + 0.5)
        return Scan(stamp, report.tobytes())

    def _nearest(self, angles: NDArray[np.float64], ranges: NDArray[np.float64]) -> NDArray[np.float64]:
        """For each ray, m; inf = nothing."""
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
            found[~hit] = self._beside(self.angles[~hit], angles, ranges)
        return found

    def _beside(
        self, rays: NDArray[np.float64], angles: NDArray[np.float64], ranges: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """The range of the nearest sample within reach of each direction in `rays`, m; inf = none."""
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
        found: NDArray[np.float64] = np.where(np.minimum(ahead, behind) <= self._reach, nearest, np.inf)
        return found


class RangeReader(ABC):
    """The newest scan and sweep of a range sensor; base of the drivers of lidar and depth camera."""

    def __init__(self, model: RangeSensor) -> None:
        self.rays = ScanRays(model)
        self._scan: Scan | None = None
        self._sweep: SensorSweep | None = None

    @abstractmethod
    def sees(self, now: Instant) -> bool:
        """Return whether it measures, and anything is seen."""

    @property
    @abstractmethod
    def fault(self) -> HoldCause | None:
        """What its data show alone: that it repeats itself, as a whole or in part."""

    def scan(self) -> Scan | None:
        """Return the last scan, once."""
        scan, self._scan = self._scan, None
        return scan

    def sweep(self) -> SensorSweep | None:
        """Return the samples of the last turn or image, once."""
        sweep, self._sweep = self._sweep, None
        return sweep

    def measured(self, stamp: Instant, sweep: SensorSweep) -> None:
        """Take in a turn or image; `stamp`: of the scan that it makes."""
        self._scan, self._sweep = self.rays.scan(stamp, sweep.angles, sweep.ranges), sweep


_BEAMS: Final = 360
"""Directions that are told apart."""
_TURNS: Final = 4
"""A beam that said the same so often on end after the first time stands still; own choice, a coarse sensor
repeats one in three: one beam in eighty by chance."""
_STILL: Final = 0.3
"""Share of the beams with an echo; own choice, far above what chance does."""
_FEWEST: Final = 30
"""Beams with an echo, below which nothing is said."""


class Repeats:
    """Remembers the last parts of a sensor's data, and says when they come again."""

    def __init__(self, kept: int, window: int, most: int) -> None:
        """`kept`: parts that are remembered; `most` of the last `window` parts repeated are too many."""
        self._order: deque[bytes] = deque(maxlen=kept)
        self._known: set[bytes] = set()
        self._repeated: deque[bool] = deque(maxlen=window)
        self._most = most

    @property
    def found(self) -> bool:
        """True while the sensor repeats itself."""
        return self._repeated.count(True) >= self._most

    def take(self, part: bytes) -> None:
        """Take in a part that is large enough never to be the same by chance."""
        again = part in self._known
        self._repeated.append(again)
        if again:
            return  # it is remembered already
        if len(self._order) == self._order.maxlen:
            self._known.discard(self._order[0])
        self._order.append(part)
        self._known.add(part)

    def forget(self) -> None:
        """Begin anew."""
        self._order.clear()
        self._known.clear()
        self._repeated.clear()


class StillBeams:
    """Remembers what each direction said last, and for how many turns it has said the same."""

    def __init__(self) -> None:
        self._last: NDArray[np.int64] = np.zeros(_BEAMS, np.int64)
        self._same: NDArray[np.int64] = np.zeros(_BEAMS, np.int64)
        self.found = False
        """True while a part of the turn stands still."""

    def take(self, angles: NDArray[np.float64], distances: NDArray[np.int64]) -> None:
        """A turn: (n,) rad, (n,) in the sensor's own unit, 0 = no echo."""
        beams = np.floor(angles % (2 * np.pi) * (_BEAMS / (2 * np.pi)) + 0.5).astype(np.int64) % _BEAMS
        now = np.zeros(_BEAMS, np.int64)
        now[beams] = distances
        echo = now > 0
        self._same = np.where(echo & (now == self._last), self._same + 1, 0)
        self._last = now
        seen = int(np.count_nonzero(echo))
        self.found = seen >= _FEWEST and np.count_nonzero(self._same >= _TURNS) >= _STILL * seen
