"""Packets into frames (L1): a packet too long for a frame goes in fragments, short ones share a frame.

Of each fragment the header says of how many bytes the whole is, how many are here and from which position on,
and which packet of which node it is (JDEECo, L1Packet). The whole is the packet and its CRC-32, which JDEECo
has not: the checksum of a frame does not tell whether fragments belong together, and numbers come again.

Reassembly gathers fragments of any node, in any order.
Nothing about a frame is taken for granted, and what is kept of frames has a bound: at most `most_open`
packets, each of at most `most_packet` bytes and its checksum.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Final, NamedTuple

from deeco.errors import ExecutionError
from deeco.instant import Instant
from deeco.link import DEFAULTS, LinkParameters

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
        self._next = (first + len(wholes)) % _IDS
        if wholes and left >= 0:  # as mostly: all in one frame
            heads = [
                HEADER.pack(size, size, 0, (first + whole) % _IDS, source) for whole, size in enumerate(sizes)
            ]
            return [b"".join([part for pair in zip(heads, wholes, strict=True) for part in pair])]
        frames = min((self._layout(sizes, thrifty) for thrifty in (False, True)), key=len)
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


_Key = tuple[int, int, int]
"""Link address of the sender, srcNode, dataId."""


@dataclass
class ReassemblyCounters:
    """What became of everything that was heard."""

    complete: int = 0
    """Packets handed out."""
    bad_checksum: int = 0
    """Packets whose fragments were all there, and whose checksum did not hold."""
    timed_out: int = 0
    """Packets given up because fragments were missing for too long."""
    evicted: int = 0
    """Packets given up because too many were open."""
    contradicted: int = 0
    """Packets given up because a fragment gave them another size."""
    oversized: int = 0
    """Fragments of packets above the limit."""
    junk_frames: int = 0
    """Frames that are not fragments, or not to their end; what came before was taken."""


@dataclass
class _Open:
    """A packet of which fragments are missing."""

    since: Instant
    data: bytearray
    missing: int
    """One bit for each byte."""

    def put(self, start: int, payload: bytes) -> bool:
        """Fill in a fragment, over what another one may have brought; true if nothing is missing now."""
        size = len(payload)
        self.data[start : start + size] = payload
        self.missing &= ~(((1 << size) - 1) << start)
        return not self.missing


class Reassembly:
    """Packets in reassembly, in the order of their first fragments."""

    def __init__(self, limits: LinkParameters = DEFAULTS) -> None:
        self._limits = limits
        self._most_whole = limits.most_packet + CHECKSUM.size
        self._open: dict[_Key, _Open] = {}
        self._counters = ReassemblyCounters()

    def counters(self) -> dict[str, int]:
        """What became of everything that was heard, by the names in ReassemblyCounters."""
        return asdict(self._counters)

    def take(self, now: Instant, sender: int, frame: bytes) -> list[bytes]:
        """The packets that a frame completes, if their checksums hold, in the frame's order.

        `sender` is the address of who sent the frame. `now` should not go back.
        """
        end = len(frame)
        if self._open:
            self.give_up(now)
        elif end >= SHORTEST:  # most frames are one whole packet, and nothing else is open
            total, size, start, _, _ = HEADER.unpack_from(frame)
            if size == total == end - HEADER.size and not start and total <= self._most_whole:
                packet = self._checked(frame[HEADER.size :])
                return [packet] if packet else []
        packets = []
        position = 0
        while position + HEADER.size < end:
            total, size, start, number, source = HEADER.unpack_from(frame, position)
            position += HEADER.size
            if not 0 < size <= min(end - position, total - start) or total <= CHECKSUM.size:
                break
            payload = frame[position : position + size]
            position += size
            if total > self._most_whole:
                self._counters.oversized += 1
                continue
            whole = self._put(now, (sender, source, number), total, start, payload)
            if whole is not None and (packet := self._checked(whole)):
                packets.append(packet)
        if position != end or not end:
            self._counters.junk_frames += 1
        return packets

    def give_up(self, now: Instant) -> None:
        """Drop packets whose time is over; `take` does so first."""
        while self._open:
            key, oldest = next(iter(self._open.items()))
            if now - oldest.since < self._limits.reassembly_timeout:
                break
            del self._open[key]
            self._counters.timed_out += 1

    def _put(self, now: Instant, key: _Key, total: int, start: int, payload: bytes) -> bytes | None:
        known = self._open.get(key)
        if known is not None and len(known.data) != total:
            del self._open[key]
            self._counters.contradicted += 1
            known = None
        if len(payload) == total:
            self._open.pop(key, None)
            return payload
        if known is None:
            known = self._begin(now, key, total)
        if not known.put(start, payload):
            return None
        del self._open[key]
        return bytes(known.data)

    def _begin(self, now: Instant, key: _Key, total: int) -> _Open:
        if len(self._open) >= self._limits.most_open:
            del self._open[next(iter(self._open))]
            self._counters.evicted += 1
        begun = self._open[key] = _Open(now, bytearray(total), (1 << total) - 1)
        return begun

    def _checked(self, whole: bytes) -> bytes | None:
        packet = whole[: -CHECKSUM.size]
        if CHECKSUM.unpack_from(whole, len(packet))[0] != zlib.crc32(packet):
            self._counters.bad_checksum += 1
            return None
        self._counters.complete += 1
        return packet
