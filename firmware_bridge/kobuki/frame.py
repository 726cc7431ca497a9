"""Frames of a Kobuki: `AA 55`, length, payload, and the exclusive or of length and payload.

Source: kobuki-base/kobuki_documentation, doc/protocol.rst.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from operator import xor
from typing import Final, Generic, TypeVar

from firmware_bridge.kobuki.wire import MalformedError, WireMisuseError

HEADER: Final = b"\xaa\x55"
SHORTEST: Final = 3
"""Bytes of the shortest payload: one packet with one byte of data."""
LONGEST: Final = 160
"""Bytes of the longest payload that is believed. All that a base can say at once makes 124; each byte more
lets noise that looks like a header hold up what follows, 87 µs per byte."""

P = TypeVar("P")


@dataclass
class WireCounts:
    """What came over a wire: frames that were right, and bytes that were skipped, by cause."""

    frames: int = 0
    noise: int = 0
    """Bytes before a header."""
    bad_length: int = 0
    """Headers with an impossible length after them; one byte skipped for each, as for the next two."""
    bad_checksum: int = 0
    malformed: int = 0
    """Right checksum, wrong packets."""

    @property
    def skipped(self) -> int:
        """Bytes that belonged to no frame."""
        return self.noise + self.bad_length + self.bad_checksum + self.malformed


def encode(payload: bytes) -> bytes:
    """The frame of a payload. Raises WireMisuseError where its length is impossible."""
    if not SHORTEST <= len(payload) <= LONGEST:
        raise WireMisuseError(f"a payload of {len(payload)} bytes; it should have {SHORTEST} to {LONGEST}")
    body = bytes((len(payload),)) + payload
    return HEADER + body + bytes((reduce(xor, body),))


class FrameReader(Generic[P]):
    """Finds the frames in a stream of bytes, whatever else is in it, and decodes their payloads.

    After anything wrong it goes on one byte after the header's first, so a frame within what looked like one
    is found; it holds at most one frame's bytes between calls.
    """

    def __init__(self, decode: Callable[[bytes], P]) -> None:
        """`decode`: gives the packets of a payload, or raises MalformedError."""
        self._decode = decode
        self._pending = bytearray()
        self.reception = WireCounts()

    @property
    def pending(self) -> int:
        """Bytes that may become a frame."""
        return len(self._pending)

    def take(self, data: bytes) -> list[P]:
        """What the frames that end in `data` decode to, in order."""
        self._pending += data
        found: list[P] = []
        at = 0
        while True:
            header = self._pending.find(HEADER, at)
            if header < 0:
                kept = int(self._pending.endswith(HEADER[:1], at))
                self.reception.noise += len(self._pending) - at - kept
                at = len(self._pending) - kept
                break
            self.reception.noise += header - at
            at = header
            step = self._frame_at(at, found)
            if step == 0:
                break
            at += step
        del self._pending[:at]
        return found

    def _frame_at(self, at: int, found: list[P]) -> int:
        """How many bytes to go on from a header: 0 = the frame's end is still to come."""
        bytes_ = self._pending
        if len(bytes_) < at + 3:
            return 0
        length = bytes_[at + 2]
        if not SHORTEST <= length <= LONGEST:
            self.reception.bad_length += 1
            return 1
        end = at + 3 + length
        if len(bytes_) <= end:
            return 0
        if reduce(xor, bytes_[at + 2 : end + 1]):
            self.reception.bad_checksum += 1
            return 1
        try:
            found.append(self._decode(bytes(bytes_[at + 3 : end])))
        except MalformedError:
            self.reception.malformed += 1
            return 1
        self.reception.frames += 1
        return length + 4
