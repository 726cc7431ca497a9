"""The Kobuki driver on a noisy line: every intact frame is received, and almost nothing else."""

from collections.abc import Callable

import numpy as np
import pytest
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
    decode_feedback,
    encode_feedback,
    encode_frame,
)

MARK = 19
"""Kind of the packet that carries a frame's number."""
PIECES = 200
"""Frames and pieces of noise that are generated at once."""


class Stream:
    """Random intact frames, damaged frames and noise; every frame carries its number."""

    def __init__(self, rng: Generator) -> None:
        self._rng = rng
        self._next = 0

    def pieces(self) -> tuple[bytes, set[int], int]:
        """Bytes, numbers of the intact frames in them, and how many frames were damaged.

        Zeros at the end complete whatever looks like the beginning of a frame.
        """
        data, intact, damaged = bytearray(), set(), 0
        for kind in self._rng.integers(0, 10, PIECES).tolist():
            if kind < 5:
                intact.add(self._next)
                data += self._frame()
            elif kind < 8:
                damaged += 1
                data += self._damaged(bytearray(self._frame()))
            else:
                data += self._rng.bytes(int(self._rng.integers(1, 120)))
                data += HEADER[: int(self._rng.integers(0, 3))] + self._rng.bytes(1)
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
        """Replace, drop or double bytes until the frame differs."""
        before = bytes(data)
        while bytes(data) == before:
            for _ in range(int(self._rng.integers(1, 4))):
                at, how = int(self._rng.integers(0, len(data))), int(self._rng.integers(0, 3))
                data[at : at + 1] = (self._rng.bytes(1), b"", data[at : at + 1] * 2)[how]
        return data


def number(packets: list[Feedback]) -> int:
    """Number of a received frame; -1 if it was never generated."""
    kinds, last = [type(packet) for packet in packets], packets[-1]
    if kinds == [Basic, Inertial, Unknown] and isinstance(last, Unknown) and last.kind == MARK:
        return int.from_bytes(last.data, "little")
    return -1


@pytest.mark.claim("boards")
def test_intact_frames_are_received_through_noise(
    full: bool, record_property: Callable[[str, object], None]
) -> None:
    """A checksum of one exclusive or misses some damage, and what it accepts may hide the next frame."""
    stream, cuts = Stream(np.random.default_rng(5)), np.random.default_rng(6)
    whole, cut, driver = FrameReader(decode_feedback), FrameReader(decode_feedback), KobukiDriver(START)
    size = intact = missed = false = damaged = 0
    now = START
    while size < (10_000_000 if full else 200_000):
        data, wanted, broken = stream.pieces()
        received, again, at = whole.take(data), [], 0
        while at < len(data):
            piece = data[at : at + int(cuts.integers(1, 200))]
            again += cut.take(piece)
            assert cut.pending <= LONGEST + 3
            now = Instant(now + 1000)
            driver.take(now, piece)
            driver.command(now, 0.1, 0.1)
            driver.due(now)
            at += len(piece)
        assert received == again, "it does not matter how the stream is cut"
        numbers = {number(packets) for packets in received}
        size, damaged, intact = size + len(data), damaged + broken, intact + len(wanted)
        missed += len(wanted - numbers)
        false += len(received) - len(wanted & numbers)
    record_property("frames", {"intact": intact, "damaged": damaged, "missed": missed, "false": false})
    assert intact > 1500
    assert false <= max(3, damaged / 50)
    assert missed <= min(false, max(3, intact / 1000))
    reception = whole.reception
    assert min(reception.noise, reception.bad_length, reception.bad_checksum, reception.malformed) > 0
