"""RPLIDAR A1: protocol, and a driver without I/O that converts its turns to scans.

The caller passes the bytes read (or none) to `take` every few milliseconds and writes what `due` returns. On
the adapter of an A1 the motor runs while the line DTR is off. Source: Slamtec, "RPLIDAR Low Cost 360
Degree Laser Range Scanner: Interface Protocol and Application Notes".
"""

import math
import struct
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats
from actors.instant import Instant, milliseconds
from actors.robot_model import RangeSensor as SensorModel
from firmware_bridge.range_sensors.sensor import MIN_ECHOES, SECTORS, RangeReader, SensorSweep

REQUEST: Final = 0xA5


class LidarRequest(IntEnum):
    """A request without data: `A5` and this byte."""

    SCAN = 0x20
    STOP = 0x25
    RESET = 0x40
    HEALTH = 0x52

    @property
    def bytes(self) -> bytes:
        """Encoded request."""
        return bytes((REQUEST, self))


SAMPLE_SIZE: Final = 5
_HEALTH_SIZE: Final = 3
SCANNING: Final = b"\xa5\x5a\x05\x00\x00\x40\x81"
"""Descriptor of samples: `A5 5A`, their size in 30 bits, 1 (continuous) in 2, and their kind."""
HEALTH: Final = b"\xa5\x5a\x03\x00\x00\x00\x06"
"""Descriptor of a health answer."""
DESCRIPTOR_SIZE: Final = len(HEALTH)
FULL_TURN_Q6: Final = 360 * 64


class Health(NamedTuple):
    """Health of the lidar."""

    status: int
    """0 good, 1 warning, 2 error: no scans until a reset."""
    code: int = 0

    def encode(self) -> bytes:
        """Encode in 3 bytes."""
        return struct.pack("<BH", *self)

    @classmethod
    def decode(cls, data: bytes) -> "Health":
        """Decode 3 bytes."""
        return cls(*struct.unpack("<BH", data))


class Sample(NamedTuple):
    """One measurement."""

    start: bool
    """True for the first of a turn."""
    quality: int
    """Quality, 0 to 63."""
    angle_q6: int
    """Direction, 1/64°, clockwise seen from above, from 0 to slightly above a full turn."""
    distance_q2: int
    """Distance, 1/4 mm; 0 = no echo."""

    def encode(self) -> bytes:
        """Encode in 5 bytes: a bit and its inverse mark the start of a turn, a check bit is 1."""
        flags = 1 if self.start else 2
        return struct.pack("<BHH", self.quality << 2 | flags, self.angle_q6 << 1 | 1, self.distance_q2)

    @classmethod
    def decode(cls, data: bytearray, at: int) -> "Sample":
        """Decode the 5 bytes at index `at`."""
        flags, angle, distance = struct.unpack_from("<BHH", data, at)
        return cls(flags & 1 == 1, flags >> 2, angle >> 1, distance)


class SampleReader:
    """Incremental parser of samples in a noisy byte stream.

    A sample has three check bits and no checksum, so its angle must also follow the previous one by about a
    degree. After an error, several consecutive valid samples are needed to resynchronise.
    """

    _IN_A_ROW: Final = 6
    _BACK_Q6: Final = 5 * 64
    _ON_Q6: Final = 20 * 64
    """Maximum change of the angle between samples, backward and forward."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._before: int | None = None
        """Angle of the previous sample; None while out of step."""
        self.skipped = 0
        """Number of skipped bytes."""

    def take(self, data: bytes) -> list[Sample]:
        """Append bytes and return the completed samples."""
        self._pending += data
        samples: list[Sample] = []
        at = 0
        while len(self._pending) >= at + SAMPLE_SIZE * (1 if self._before is not None else self._IN_A_ROW):
            if self._before is None:
                if not self._in_step(at):
                    at += 1
                    self.skipped += 1
                    continue
                self._before = self._angle(at)
            self._before = self._following(at, self._before)
            if self._before is not None:
                samples.append(Sample.decode(self._pending, at))
                at += SAMPLE_SIZE
        del self._pending[:at]
        return samples

    def _in_step(self, begin: int) -> bool:
        """Return whether several consecutive samples begin there."""
        angle = self._angle(begin)
        for at in range(begin, begin + self._IN_A_ROW * SAMPLE_SIZE, SAMPLE_SIZE):
            following = self._following(at, angle)
            if following is None:
                return False
            angle = following
        return True

    def _following(self, at: int, before: int) -> int | None:
        """Return the angle of the sample there, if it is valid and follows the angle `before`."""
        if self._pending[at] & 3 not in {1, 2} or not self._pending[at + 1] & 1:
            return None
        angle = self._angle(at)
        on = (angle - before + self._BACK_Q6) % FULL_TURN_Q6
        return angle if angle < FULL_TURN_Q6 + 64 and on <= self._BACK_Q6 + self._ON_Q6 else None

    def _angle(self, at: int) -> int:
        return (self._pending[at + 1] | self._pending[at + 2] << 8) >> 1


_NOTICEABLE_Q6: Final = 10 * 64
"""Change of the angle that shows a rotating head, 1/64°."""
PATIENCE: Final = milliseconds(1000)
"""Timeout of answers and samples after which the lidar is restarted; own choice, five turns."""
_PAUSE: Final = milliseconds(20)
"""Wait after stopping; application notes: at least 1 ms."""
_RESET: Final = milliseconds(2000)
"""Wait after resetting; application notes: at least 2 ms, but an A1 first prints a greeting."""
_SIGHT: Final = milliseconds(250)
"""Timeout of echoes and rotation; own choice: a turn of an A1 takes at most 182 ms."""
FEWEST, MOST = 90, 8192
"""Limits of the samples of a valid turn; own choice: a quarter of an A1's, and less than two turns."""
_WIDEST_GAP: Final = 10 * 64
"""Maximum gap between samples of a turn, 1/64°; own choice, ten samples. Samples without echo are sent, too,
so a gap is lost data and must not look like free floor."""
_TURNING: Final = -math.radians(1 / 64)
"""Unit of angles, rad; they increase clockwise, seen from above."""


class LidarPhase(Enum):
    """State of the lidar's driver."""

    STOPPING = "being stopped"
    RESETTING = "being reset"
    HEALTH = "asked for its health"
    STARTING = "being started"
    SCANNING = "scanning"


@dataclass
class RplidarCounts:
    """Counts of turns by outcome, and of starts."""

    scans: int = 0
    thin: int = 0
    """Turns with too few or too many samples, or with a gap."""
    blind: int = 0
    """Turns without echo."""
    starts: int = 0


class Rplidar(RangeReader):
    """Driver of one lidar; scans are stamped in the middle of their turn."""

    def __init__(self, model: SensorModel, started: Instant) -> None:
        super().__init__(model)
        self._pending = bytearray()
        self._asked = False
        self.samples = SampleReader()
        """Parser since the last start."""
        self._turn: list[tuple[int, int]] | None = None
        """Angle and distance of each sample of this turn; None before the first turn."""
        self._turn_began = started
        self._sector: list[Sample] = []
        self._alive = started
        """Time of the last valid data."""
        self._echo: Instant | None = None
        """Time of the last echo."""
        self._turning_at = started
        """Time of the last detected rotation."""
        self._mark_q6 = -_NOTICEABLE_Q6
        """Angle of the head at that time."""
        self.phase = LidarPhase.STOPPING
        self._entered = started
        self.counts = RplidarCounts()
        self.health: Health | None = None

    def is_measuring(self, now: Instant) -> bool:
        """Return whether the head rotates and there are echoes."""
        if self.phase is not LidarPhase.SCANNING or self._echo is None:
            return False
        return now - min(self._echo, self._turning_at) <= _SIGHT

    def take(self, now: Instant, data: bytes) -> None:
        """Process bytes read, possibly none."""
        if self.phase is LidarPhase.SCANNING:
            self._sampled(now, data)
            return
        self._pending += data
        if self.phase in {LidarPhase.STOPPING, LidarPhase.RESETTING}:
            self._pending.clear()  # the rest of a scan, or a greeting
        elif self.phase is LidarPhase.HEALTH:
            self._health_answered(now)
        elif self.phase is LidarPhase.STARTING and self._described(SCANNING):
            rest = bytes(self._pending[DESCRIPTOR_SIZE:])
            self._enter(LidarPhase.SCANNING, now)
            self._sampled(now, rest)

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now."""
        waited = now - self._entered
        rest = {LidarPhase.STOPPING: _PAUSE, LidarPhase.RESETTING: _RESET}.get(self.phase)
        if rest is not None:
            if self._asked and waited >= rest:
                self._enter(LidarPhase.HEALTH, now)
        elif max(self._entered, self._alive) + PATIENCE < now:
            self._enter(LidarPhase.STOPPING, now)
        if self._asked:
            return b""
        self._asked = True
        return _REQUESTS[self.phase].bytes

    def final_bytes(self) -> bytes:
        """Return the last bytes to write."""
        return LidarRequest.STOP.bytes

    def _enter(self, phase: LidarPhase, now: Instant) -> None:
        self.phase = phase
        self._entered = now
        self._asked = phase is LidarPhase.SCANNING
        self._pending.clear()
        if phase is LidarPhase.STARTING:
            self.counts.starts += 1
            self.samples = SampleReader()
            self._turn = None
            self._sector = []
            self._repeats.forget()

    def _described(self, wanted: bytes) -> bool:
        """Return whether the descriptor was received; discard bytes before it."""
        at = self._pending.find(wanted)
        del self._pending[: at if at >= 0 else max(0, len(self._pending) - DESCRIPTOR_SIZE + 1)]
        return at >= 0

    def _health_answered(self, now: Instant) -> None:
        """Process the health answer once it is complete."""
        end = DESCRIPTOR_SIZE + _HEALTH_SIZE
        if self._described(HEALTH) and len(self._pending) >= end:
            self._alive = now
            self.health = Health.decode(bytes(self._pending[DESCRIPTOR_SIZE:end]))
            self._enter(LidarPhase.RESETTING if self.health.status == 2 else LidarPhase.STARTING, now)

    def _sampled(self, now: Instant, data: bytes) -> None:
        samples = self.samples.take(data)
        if samples:
            self._alive = now
        for sample in samples:
            if sample.distance_q2:
                self._echo = now
            if abs(sample.angle_q6 - self._mark_q6) >= _NOTICEABLE_Q6:
                self._mark_q6, self._turning_at = sample.angle_q6, now
            self._compare(sample)
            if sample.start:
                self._turned(now)
                self._turn, self._turn_began = [], now
            if self._turn is not None and len(self._turn) <= MOST:
                self._turn.append((sample.angle_q6, sample.distance_q2))

    def _compare(self, sample: Sample) -> None:
        """Compare a completed part of the turn with earlier ones."""
        width = FULL_TURN_Q6 // SECTORS
        if self._sector and sample.angle_q6 // width != self._sector[-1].angle_q6 // width:
            if sum(one.distance_q2 > 0 for one in self._sector) >= MIN_ECHOES:
                self._repeats.take(b"".join(one.encode() for one in self._sector))
            self._sector = []
        if len(self._sector) < MOST:
            self._sector.append(sample)

    def _turned(self, now: Instant) -> None:
        """Process a completed turn."""
        if self._turn is None:
            return
        turn = np.array(self._turn, np.float64).reshape(-1, 2)
        if not self._whole(turn[:, 0]):
            self.counts.thin += 1
            return
        if not turn[:, 1].any():
            self.counts.blind += 1
            return
        angles, ranges = _TURNING * turn[:, 0], turn[:, 1] / 4000
        self.counts.scans += 1
        stamps = np.linspace(self._turn_began, now, angles.size, endpoint=False).astype(np.int64)
        sweep = SensorSweep(stamps, angles, np.where(ranges > 0, ranges, np.inf))
        self.store_sweep(Instant((self._turn_began + now) // 2), sweep)
        self._still.take(angles, turn[:, 1].astype(np.int64))

    def _whole(self, angles_q6: Floats) -> bool:
        """Return whether a turn has enough samples in all directions."""
        if not FEWEST <= angles_q6.size <= MOST:
            return False
        around = np.sort(angles_q6 % FULL_TURN_Q6)
        gaps = np.diff(around, append=around[0] + FULL_TURN_Q6)
        return bool(gaps.max() <= _WIDEST_GAP)


_REQUESTS = {
    LidarPhase.STOPPING: LidarRequest.STOP,
    LidarPhase.RESETTING: LidarRequest.RESET,
    LidarPhase.HEALTH: LidarRequest.HEALTH,
    LidarPhase.STARTING: LidarRequest.SCAN,
}
