"""The bytes of an RPLIDAR A1: requests to it, descriptors, samples, info and health from it.

Source: Slamtec, "RPLIDAR Low Cost 360 Degree Laser Range Scanner: Interface Protocol and Application Notes".
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

REQUEST: Final = 0xA5


class LidarRequest(IntEnum):
    """A request without data: `A5` and this."""

    SCAN = 0x20
    STOP = 0x25
    RESET = 0x40
    INFO = 0x50
    HEALTH = 0x52

    @property
    def bytes(self) -> bytes:
        """As sent."""
        return bytes((REQUEST, self))


@dataclass(frozen=True)
class Descriptor:
    """What comes before an answer."""

    length: int
    """Bytes of the answer, or of each sample."""
    many: bool
    """True: one after the other until stopped."""
    kind: int

    def encode(self) -> bytes:
        """`A5 5A`, length in 30 bits, mode in 2, kind."""
        return b"\xa5\x5a" + struct.pack("<IB", self.length | self.many << 30, self.kind)


DESCRIPTOR_SIZE: Final = 7
SAMPLE_SIZE: Final = 5
SCANNING: Final = Descriptor(SAMPLE_SIZE, True, 0x81)
INFO: Final = Descriptor(20, False, 0x04)
HEALTH: Final = Descriptor(3, False, 0x06)
FULL_TURN_Q6: Final = 360 * 64


@dataclass(frozen=True)
class LidarInfo:
    """Which lidar it is."""

    model: int
    firmware: tuple[int, int]
    """Major, minor."""
    hardware: int
    serial: bytes
    """16 bytes."""

    def encode(self) -> bytes:
        """Its 20 bytes."""
        return bytes((self.model, self.firmware[1], self.firmware[0], self.hardware)) + self.serial

    @classmethod
    def decode(cls, data: bytes) -> "LidarInfo":
        """Of 20 bytes."""
        return cls(data[0], (data[2], data[1]), data[3], bytes(data[4:20]))


@dataclass(frozen=True)
class Health:
    """How the lidar is."""

    status: int
    """0 good, 1 warning, 2 error: it does not scan until it was reset."""
    code: int = 0

    def encode(self) -> bytes:
        """Its 3 bytes."""
        return struct.pack("<BH", self.status, self.code)

    @classmethod
    def decode(cls, data: bytes) -> "Health":
        """Of 3 bytes."""
        return cls(*struct.unpack("<BH", data))


@dataclass(frozen=True)
class Sample:
    """One measurement."""

    start: bool
    """The first of a new turn."""
    quality: int
    """0 to 63."""
    angle_q6: int
    """1/64°, clockwise seen from above, from 0 to a little above a full turn."""
    distance_q2: int
    """1/4 mm; 0 = no echo."""

    def encode(self) -> bytes:
        """Its 5 bytes, with a bit and its opposite at the start of a turn, and a check bit that is 1."""
        flags = 1 if self.start else 2
        return struct.pack("<BHH", self.quality << 2 | flags, self.angle_q6 << 1 | 1, self.distance_q2)


@dataclass
class SampleCounts:
    """What came."""

    samples: int = 0
    skipped: int = 0
    """Bytes that were no sample."""


class SampleReader:
    """Finds samples in a stream of bytes, whatever else is in it.

    A sample has three check bits and no sum, so it must also follow from the one before: the head turns on by
    a degree or so. After anything wrong the stream is believed again only once several samples on end do.
    """

    _IN_A_ROW: Final = 6
    _BACK_Q6: Final = 5 * 64
    _ON_Q6: Final = 20 * 64
    """How far from sample to sample the angle may go backward and forward."""

    def __init__(self) -> None:
        self._pending = bytearray()
        self._before: int | None = None
        """Angle of the sample that ends where the pending bytes begin; None while out of step."""
        self.counts = SampleCounts()

    def take(self, data: bytes) -> list[Sample]:
        """The samples that end in `data`."""
        self._pending += data
        samples: list[Sample] = []
        at = 0
        while len(self._pending) >= at + SAMPLE_SIZE * (1 if self._before is not None else self._IN_A_ROW):
            if self._before is None:
                if not self._in_step(at):
                    at += 1
                    self.counts.skipped += 1
                    continue
                self._before = self._angle(at)
            self._before = self._following(at, self._before)
            if self._before is not None:
                samples.append(_sample(self._pending, at))
                at += SAMPLE_SIZE
        del self._pending[:at]
        self.counts.samples += len(samples)
        return samples

    def _in_step(self, begin: int) -> bool:
        """True if several samples on end begin there."""
        angle = self._angle(begin)
        for at in range(begin, begin + self._IN_A_ROW * SAMPLE_SIZE, SAMPLE_SIZE):
            following = self._following(at, angle)
            if following is None:
                return False
            angle = following
        return True

    def _following(self, at: int, before: int) -> int | None:
        """The angle of the sample there, if it is one and follows that angle."""
        if self._pending[at] & 3 not in {1, 2} or not self._pending[at + 1] & 1:
            return None
        angle = self._angle(at)
        on = (angle - before + self._BACK_Q6) % FULL_TURN_Q6
        return angle if angle < FULL_TURN_Q6 + 64 and on <= self._BACK_Q6 + self._ON_Q6 else None

    def _angle(self, at: int) -> int:
        return (self._pending[at + 1] | self._pending[at + 2] << 8) >> 1


def _sample(data: bytearray, at: int) -> Sample:
    flags, angle, distance = struct.unpack_from("<BHH", data, at)
    return Sample(flags & 1 == 1, flags >> 2, angle >> 1, distance)
