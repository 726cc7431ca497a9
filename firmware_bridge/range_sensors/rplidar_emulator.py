"""An emulated RPLIDAR A1 on the wire; what it sees is a function from directions to ranges."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.instant import START, Instant, in_seconds
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

Sight = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""(n,) directions, rad counter-clockwise from the lidar's zero, to (n,) ranges, m; inf = nothing."""


@dataclass(frozen=True)
class EmulatedRplidarParameters:
    """What kind of lidar is emulated; Slamtec, A1 data sheet."""

    turns: float = 5.5
    """Hz."""
    samples: int = 2000
    """Per second, as an A1 gives in its standard mode."""
    range_min: float = 0.15
    """m."""
    range_max: float = 12.0
    """m."""
    noise: float = 0.0
    """Standard deviation of a distance as a share of it; needs a generator if that is not 0."""


class EmulatedRplidar:
    """One lidar; it scans when asked."""

    def __init__(
        self,
        sight: Sight,
        parameters: EmulatedRplidarParameters = EmulatedRplidarParameters(),
        started: Instant = START,
        generator: Generator | None = None,
    ) -> None:
        """`generator`: for the noise."""
        assert generator is not None or not parameters.noise
        self._sight = sight
        self._p = parameters
        self._generator = generator
        self._started = started
        self._pending = bytearray()
        self._out = bytearray()
        self._scanning = False
        self._sampled = 0
        """Samples since it was switched on, sent or not."""
        self._last_turn = -1
        self.health = Health(0)
        """Set it to make the lidar ill."""
        self.silent = False
        """Set it to make the lidar say nothing."""
        self.dark = False
        """Set it to let nothing give an echo."""
        self.stuck = False
        """Set it to hold the head: it measures on, in one direction."""

    def take(self, now: Instant, data: bytes) -> None:
        """Bytes from the driver, that end `now`."""
        self._skip_to(now)
        self._pending += data
        while (at := self._pending.find(REQUEST)) >= 0 and len(self._pending) > at + 1:
            request = self._pending[at + 1]
            del self._pending[: at + 2]
            self._obey(request)
        if at < 0:
            self._pending.clear()

    def run(self, now: Instant) -> bytes:
        """Let time pass until `now`; the bytes for the driver."""
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
            self._out += HEALTH.encode() + self.health.encode()
        elif request == LidarRequest.SCAN and self.health.status != 2:
            self._scanning = True
            self._last_turn = int(self._sampled / self._p.samples * self._p.turns)
            self._out += SCANNING.encode()

    def _until(self, now: Instant) -> int:
        return int(in_seconds(now - self._started) * self._p.samples)

    def _skip_to(self, now: Instant) -> None:
        if not self._scanning:
            self._sampled = self._until(now)

    def _sample(self, now: Instant) -> None:
        """Put the samples up to `now` on the wire."""
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
        """Put the sample of this number on the wire."""
        self._out += sample.encode()
