"""Emulated RPLIDAR A1 at the byte level, with ranges from a function of directions."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from actors.array_types import Floats
from actors.instant import Instant, in_seconds
from actors.portable.draws import normals
from firmware_bridge.range_sensors.rplidar import (
    FULL_TURN_Q6,
    HEALTH,
    REQUEST,
    SCANNING,
    Health,
    LidarRequest,
    Sample,
)

RangeFunction = Callable[[Floats], Floats]
"""Function from (n,) directions, rad counter-clockwise from the lidar's zero, to (n,) ranges, m; inf =
none."""


@dataclass(frozen=True)
class EmulatedRplidarParameters:
    """Parameters of the lidar; Slamtec, A1 data sheet."""

    turns: float = 5.5
    """Rotation frequency, Hz."""
    samples: int = 2000
    """Samples per second, in the standard mode."""
    range_min: float = 0.15
    """Minimum range, m."""
    range_max: float = 12.0
    """Maximum range, m."""
    noise: float = 0.0
    """Standard deviation of a range, relative to it; needs a generator if not 0."""


class EmulatedRplidar:
    """One lidar, which scans on request."""

    def __init__(
        self,
        sight: RangeFunction,
        parameters: EmulatedRplidarParameters = EmulatedRplidarParameters(),
        generator: Generator | None = None,
    ) -> None:
        """Create it, switched on at START; `generator`: of the noise."""
        assert generator is not None or not parameters.noise
        self._sight = sight
        self._p = parameters
        self._generator = generator
        self._pending = bytearray()
        self._out = bytearray()
        self._scanning = False
        self._sampled = 0
        """Number of samples since START, sent or not."""
        self._last_turn = -1
        self.health = Health(0)
        """Reported health; set it to inject a fault."""
        self.silent = False
        """Set it to send no bytes."""
        self.dark = False
        """Set it to return no echoes."""
        self.stuck = False
        """Set it to block the head, which then measures in one direction."""

    def take(self, now: Instant, data: bytes) -> None:
        """Accept bytes from the driver whose last one arrives `now`."""
        self._skip_to(now)
        self._pending += data
        while (at := self._pending.find(REQUEST)) >= 0 and len(self._pending) > at + 1:
            request = self._pending[at + 1]
            del self._pending[: at + 2]
            self._obey(request)
        if at < 0:
            self._pending.clear()

    def run(self, now: Instant) -> bytes:
        """Advance to `now`; return the bytes for the driver."""
        if self._scanning:
            self._sample(now)
        else:
            self._skip_to(now)
        out, self._out = bytes(self._out), bytearray()
        return b"" if self.silent else out

    def _obey(self, request: int) -> None:
        if request == LidarRequest.STOP:
            self._scanning = False
        elif request == LidarRequest.RESET:
            self._scanning = False
            self._out += b"RP LIDAR System.\r\n"
        elif request == LidarRequest.HEALTH:
            self._out += HEALTH + self.health.encode()
        elif request == LidarRequest.SCAN and self.health.status != 2:
            self._scanning = True
            self._last_turn = int(self._sampled / self._p.samples * self._p.turns)
            self._out += SCANNING

    def _until(self, now: Instant) -> int:
        return int(in_seconds(now) * self._p.samples)

    def _skip_to(self, now: Instant) -> None:
        if not self._scanning:
            self._sampled = self._until(now)

    def _sample(self, now: Instant) -> None:
        """Send the samples up to `now`."""
        numbers = np.arange(self._sampled, self._until(now))
        if not numbers.size:
            return
        self._sampled = int(numbers[-1]) + 1
        turns = numbers / self._p.samples * self._p.turns
        if self.stuck:
            turns = np.full_like(turns, self._last_turn + 0.25)
        angles = turns % 1
        ranges = self._sight(-2 * np.pi * angles)
        if self._p.noise and self._generator is not None:
            ranges = ranges * (1 + self._p.noise * normals(self._generator, numbers.size))
        seen = (ranges >= self._p.range_min) & (ranges <= self._p.range_max)
        seen &= not self.dark
        distances = np.where(seen, np.rint(np.where(seen, ranges, 0) * 4000), 0)
        rows = np.column_stack((numbers, turns // 1, angles * FULL_TURN_Q6 // 1, distances))
        for number, turn, angle, distance in rows.astype(int).tolist():
            start = turn != self._last_turn
            self._last_turn = turn
            self.send(number, Sample(start, 15 if distance else 0, angle, distance))

    def send(self, number: int, sample: Sample) -> None:
        """Send the sample with this number."""
        self._out += sample.encode()
