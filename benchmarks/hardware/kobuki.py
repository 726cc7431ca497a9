"""A Kobuki's wire under noise: what is heard of intact frames, what is wrongly believed, and how fast."""

import time
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from actors.instant import START, Instant
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.wire import (
    HEADER,
    LONGEST,
    Basic,
    Feedback,
    FrameReader,
    Inertial,
    Unknown,
    WireCounts,
    decode_feedback,
    encode_feedback,
    encode_frame,
)

_FEW: int = 3
"""So many say nothing, however short the stream."""
_PIECES: int = 200
"""Pieces of the stream that are made at once."""

MARK = 19
"""Kind of the packet that carries a frame's number."""


@dataclass(frozen=True)
class BaseSoak:
    """What came of one stream."""

    bytes: int
    seed: int
    intact: int
    """Frames in it that nothing was done to."""
    missed: int
    """Of these, not heard."""
    believed: int
    """Damaged frames whose checksum was right all the same; each may hide the intact one after it."""
    damaged: int
    cut_differently: int
    """Frames heard in another way when the stream was cut into other pieces."""
    longest_pending: int
    """Bytes that the reader held at most."""
    reception: WireCounts
    bytes_per_s: float
    """Read by the frame reader, of CPU time; a Kobuki's line brings 11 520."""

    @property
    def borne(self) -> bool:
        """Every intact frame is heard, but for those that a damaged one hides, and next to nothing else.

        One exclusive or cannot see all damage, and what it lets pass may hold the header of the next frame.
        """
        few = self.believed <= max(_FEW, self.damaged / 50)
        few &= self.missed <= min(self.believed, max(_FEW, self.intact / 1000))
        return few and self.cut_differently == 0 and self.longest_pending <= LONGEST + 3


def soak(bytes_: int, seed: int) -> BaseSoak:
    """Read a stream of at least so many bytes: intact and damaged frames and noise, at random.

    A driver reads it too; any exception is its failure.
    """
    stream = _Stream(np.random.default_rng(seed))
    cuts = np.random.default_rng(seed + 1)
    whole, cut = FrameReader(decode_feedback), FrameReader(decode_feedback)
    driver = KobukiDriver(START)
    intact = missed = believed = damaged = differently = size = longest = 0
    cpu = 0.0
    now = START
    while size < bytes_:
        data, wanted, broken = stream.pieces(_PIECES)
        size += len(data)
        damaged += broken
        begun = time.process_time()
        heard = whole.take(data)
        cpu += time.process_time() - begun
        again = []
        at = 0
        while at < len(data):
            end = at + int(cuts.integers(1, 200))
            again += cut.take(data[at:end])
            longest = max(longest, cut.pending)
            now = Instant(now + 1000)
            driver.take(now, data[at:end])
            driver.command(now, 0.1, 0.1)
            driver.due(now)
            at = end
        numbers = {_number(packets) for packets in heard}
        differently += heard != again
        intact += len(wanted)
        missed += len(wanted - numbers)
        believed += len(heard) - len(wanted & numbers)
    return BaseSoak(
        bytes=size,
        seed=seed,
        intact=intact,
        missed=missed,
        believed=believed,
        damaged=damaged,
        cut_differently=differently,
        longest_pending=longest,
        reception=whole.reception,
        bytes_per_s=size / cpu,
    )


class _Stream:
    """Frames that are numbered in a packet of their own, and what can happen to a line."""

    def __init__(self, rng: Generator) -> None:
        self._rng = rng
        self._next = 0

    def pieces(self, count: int) -> tuple[bytes, set[int], int]:
        """Bytes, the numbers of the intact frames among them, and how many frames were damaged.

        They end with enough zeros for whatever looks like the beginning of a frame to be over.
        """
        data = bytearray()
        intact: set[int] = set()
        damaged = 0
        for kind in self._rng.integers(0, 10, count).tolist():
            if kind < 5:
                intact.add(self._next)
                data += self._frame()
            elif kind < 8:
                damaged += 1
                data += self._damaged(bytearray(self._frame()))
            else:
                data += self._noise()
        return bytes(data) + bytes(LONGEST + 4), intact, damaged

    def _frame(self) -> bytes:
        numbers = self._rng.integers(0, 256, 8).tolist()
        basic = Basic(
            self._next & 0xFFFF, 0, 0, 0, *numbers[:2], *(n - 128 for n in numbers[2:4]), *numbers[4:]
        )
        inertial = Inertial(*self._rng.integers(-0x8000, 0x8000, 2).tolist())
        packets: list[Feedback] = [basic, inertial, Unknown(MARK, self._next.to_bytes(12, "little"))]
        self._next += 1
        return encode_frame(b"".join(map(encode_feedback, packets)))

    def _damaged(self, data: bytearray) -> bytearray:
        """Bytes replaced, lost or doubled; surely not the same as before."""
        before = bytes(data)
        while bytes(data) == before:
            for _ in range(int(self._rng.integers(1, 4))):
                at = int(self._rng.integers(0, len(data)))
                how = int(self._rng.integers(0, 3))
                data[at : at + 1] = (self._rng.bytes(1), b"", data[at : at + 1] * 2)[how]
        return data

    def _noise(self) -> bytes:
        """Random bytes, with headers of frames that never were."""
        noise = self._rng.bytes(int(self._rng.integers(1, 120)))
        return noise + HEADER[: int(self._rng.integers(0, 3))] + self._rng.bytes(1)


def _number(packets: list[Feedback]) -> int:
    """Of a frame; -1 for one that was never made."""
    kinds = [type(packet) for packet in packets]
    last = packets[-1]
    if kinds == [Basic, Inertial, Unknown] and isinstance(last, Unknown) and last.kind == MARK:
        return int.from_bytes(last.data, "little")
    return -1
