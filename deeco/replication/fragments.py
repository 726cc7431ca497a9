"""Packets into frames (L1): a packet too long for a frame goes in fragments, short ones share a frame.

Of each fragment the header says of how many bytes the whole is, how many are here and from which position on,
and which packet of which node it is (JDEECo, L1Packet). The whole is the packet and its CRC-32, which JDEECo
has not: the checksum of a frame does not tell whether fragments belong together, and numbers come again.
"""

import struct
import zlib
from collections.abc import Sequence
from typing import Final, NamedTuple

from deeco.errors import ExecutionError
from deeco.parameters import DEFAULTS, LinkParameters

HEADER: Final = struct.Struct("<HHHHB")
"""totalSize, payloadSize, startPos, dataId, srcNode."""
CHECKSUM: Final = struct.Struct("<I")
"""Behind the packet: zlib.crc32 of it."""
SHORTEST: Final = HEADER.size + 1 + CHECKSUM.size
"""Bytes of a frame that the shortest packet takes; as many packets share one as fit."""
_IDS: Final = 1 << 16


class _Piece(NamedTuple):
    """Bytes of a whole, for one frame."""

    whole: int
    """Index of the whole."""
    start: int
    size: int


class Fragmenter:
    """The frames of one node."""

    def __init__(self, source: int, limits: LinkParameters = DEFAULTS, *, first: int = 0) -> None:
        """`source` is the node's number, of which the header has the lowest byte; `first` is the number of
        its first packet, of which the header has the lowest two.
        """
        self._source = source & 0xFF
        self._limits = limits
        self._next = first % _IDS

    def frames(self, packets: Sequence[bytes]) -> list[bytes]:
        """Frames filled in the packets' order; one that would fit a frame is split only to save a frame.

        Packets are numbered from `first` on, and from 0 after 65535. Raises ExecutionError for a packet that
        is empty or above `most_packet`; then no number is used up.
        """
        wholes = [self._checked(packet) for packet in packets]
        sizes = [len(whole) for whole in wholes]
        first, source, left = self._next, self._source, self._limits.frame_data
        for size in sizes:
            left -= HEADER.size + size
        if wholes and left >= 0:  # as mostly: all in one frame
            self._next = (first + len(wholes)) % _IDS
            heads = [
                HEADER.pack(size, size, 0, (first + whole) % _IDS, source) for whole, size in enumerate(sizes)
            ]
            return [b"".join([part for pair in zip(heads, wholes, strict=True) for part in pair])]
        frames = min((self._layout(sizes, thrifty) for thrifty in (False, True)), key=len)
        self._next = (first + len(wholes)) % _IDS
        return [
            b"".join(
                HEADER.pack(len(wholes[whole]), size, start, (first + whole) % _IDS, source)
                + wholes[whole][start : start + size]
                for whole, start, size in frame
            )
            for frame in frames
        ]

    def _checked(self, packet: bytes) -> bytes:
        if not 0 < len(packet) <= self._limits.most_packet:
            raise ExecutionError(
                f"a packet for the link has {len(packet)} bytes; "
                f"it should have 1 to {self._limits.most_packet} (LinkParameters.most_packet)"
            )
        return packet + CHECKSUM.pack(zlib.crc32(packet))

    def _layout(self, sizes: Sequence[int], thrifty: bool) -> list[list[_Piece]]:
        """Which piece goes into which frame. Thrifty: every frame is filled, even if that splits a packet."""
        frames: list[list[_Piece]] = []
        room = 0
        for whole, size in enumerate(sizes):
            start = 0
            if not self._goes_on(size, room, thrifty):
                room = 0
            while start < size:
                if room <= HEADER.size:
                    frames.append([])
                    room = self._limits.frame_data
                part = min(size - start, room - HEADER.size)
                frames[-1].append(_Piece(whole, start, part))
                start += part
                room -= HEADER.size + part
        return frames

    def _goes_on(self, size: int, room: int, thrifty: bool) -> bool:
        """Does a packet begin in the frame that the one before has left so much room in?"""
        here, full = room - HEADER.size, self._limits.frame_data - HEADER.size
        if size <= here:
            return True
        if here < self._limits.least_fragment:
            return False
        return thrifty or 1 + -((here - size) // full) <= -(-size // full)
