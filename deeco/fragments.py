"""Fragmentation of packets into frames (L1): long packets are split, short ones share a frame.

The header of a fragment has the size of the whole, the fragment's size and position, the packet number and
the node number (JDEECo, L1Packet). The whole is the packet with a CRC-32, which JDEECo lacks: a frame's own
checksum does not show whether fragments belong together, and packet numbers repeat.

Reassembly accepts fragments of any node in any order. Frames are untrusted, and memory is bounded: at most
`max_open` packets of at most `max_packet` bytes each, plus checksum.
"""

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from deeco.errors import ExecutionError
from deeco.instant import Instant
from deeco.link import DEFAULTS, LinkParameters

HEADER: Final = struct.Struct("<HHHHB")
"""totalSize, payloadSize, startPos, dataId, srcNode."""
CHECKSUM: Final = struct.Struct("<I")
"""CRC-32 (zlib) after the packet."""
_RESIDUE: Final = zlib.crc32(bytes(CHECKSUM.size))
"""CRC-32 of any packet followed by its CRC-32."""
SHORTEST: Final = HEADER.size + 1 + CHECKSUM.size
"""Bytes of the shortest packet in a frame, with header and checksum."""
_IDS: Final = 1 << 16


class _Fragment(NamedTuple):
    """Part of a packet (with checksum) in one frame."""

    whole: int
    """Index of the packet."""
    start: int
    size: int


class Fragmenter:
    """Splits the packets of one node into frames."""

    def __init__(self, source: int, limits: LinkParameters = DEFAULTS, *, first: int = 0) -> None:
        """Create a fragmenter for the node number `source` (its lowest byte is used).

        `first`: number of the first packet (its lowest two bytes are used).
        """
        self._source = source & 0xFF
        self._limits = limits
        self._next = first % _IDS

    def frames(self, packets: Sequence[bytes]) -> list[bytes]:
        """Return frames filled in the packets' order; split a packet that fits one frame only to save a
        frame.

        Packets are numbered from `first`, and from 0 after 65535. Raises ExecutionError, without using a
        number, for a packet that is empty or longer than `max_packet`.
        """
        wholes = [self._verified(packet) for packet in packets]
        sizes = [len(whole) for whole in wholes]
        first, source, left = self._next, self._source, self._limits.frame_data
        for size in sizes:
            left -= HEADER.size + size
        self._next = (first + len(wholes)) % _IDS
        if wholes and left >= 0:  # usual case: one frame
            heads = [
                HEADER.pack(size, size, 0, (first + whole) % _IDS, source) for whole, size in enumerate(sizes)
            ]
            return [b"".join([part for pair in zip(heads, wholes, strict=True) for part in pair])]
        frames = min((self._layout(sizes, fill) for fill in (False, True)), key=len)
        return [
            b"".join(
                HEADER.pack(len(wholes[whole]), size, start, (first + whole) % _IDS, source)
                + wholes[whole][start : start + size]
                for whole, start, size in frame
            )
            for frame in frames
        ]

    def _verified(self, packet: bytes) -> bytes:
        if not 0 < len(packet) <= self._limits.max_packet:
            raise ExecutionError(
                f"a packet for the link has {len(packet)} bytes; "
                f"must have 1 to {self._limits.max_packet} (LinkParameters.max_packet)"
            )
        return packet + CHECKSUM.pack(zlib.crc32(packet))

    def _layout(self, sizes: Sequence[int], fill: bool) -> list[list[_Fragment]]:
        """Assign pieces to frames; if `fill`, fill every frame even if that splits a packet."""
        frames: list[list[_Fragment]] = []
        room = 0
        for whole, size in enumerate(sizes):
            start = 0
            if not self._fits(size, room, fill):
                room = 0
            while start < size:
                if room <= HEADER.size:
                    frames.append([])
                    room = self._limits.frame_data
                part = min(size - start, room - HEADER.size)
                frames[-1].append(_Fragment(whole, start, part))
                start += part
                room -= HEADER.size + part
        return frames

    def _fits(self, size: int, room: int, fill: bool) -> bool:
        """Return whether a packet of `size` bytes starts in the current frame with `room` bytes left."""
        here, full = room - HEADER.size, self._limits.frame_data - HEADER.size
        if size <= here:
            return True
        if here < self._limits.min_fragment:
            return False
        return fill or 1 + -((here - size) // full) <= -(-size // full)


_PacketKey = tuple[int, int, int]
"""Sender's link address, srcNode, dataId."""


@dataclass
class ReassemblyCounters:
    """Counters of a reassembly."""

    complete: int = 0
    """Packets completed."""
    bad_checksum: int = 0
    """Complete packets with a wrong checksum."""
    timed_out: int = 0
    """Incomplete packets dropped after the timeout."""
    evicted: int = 0
    """Incomplete packets dropped because too many were open."""
    contradicted: int = 0
    """Incomplete packets dropped because a fragment had another total size."""
    oversized: int = 0
    """Fragments of packets above the size limit."""
    junk_frames: int = 0
    """Frames with bytes that are not fragments; fragments before these bytes are used."""


@dataclass
class _PartialPacket:
    """An incomplete packet."""

    since: Instant
    data: bytearray
    missing: int
    """Bit mask of missing bytes."""

    def put(self, start: int, payload: bytes) -> bool:
        """Store a fragment, overwriting earlier bytes; return whether the packet is complete."""
        size = len(payload)
        self.data[start : start + size] = payload
        self.missing &= ~(((1 << size) - 1) << start)
        return not self.missing


class Reassembly:
    """Incomplete packets in the order of their first fragments."""

    def __init__(self, limits: LinkParameters = DEFAULTS) -> None:
        self._limits = limits
        self._max_whole = limits.max_packet + CHECKSUM.size
        self.open: dict[_PacketKey, _PartialPacket] = {}
        """Incomplete packets."""
        self.counters = ReassemblyCounters()

    def take(self, now: Instant, sender: int, frame: bytes) -> list[bytes]:
        """Return the packets with valid checksums that a frame completes, in the frame's order.

        `sender`: link address of the frame's transmitter. `now` must not decrease.
        """
        end = len(frame)
        if self.open:
            self.drop_expired(now)
        elif end >= SHORTEST:  # usual case: the frame is one whole packet
            total, size, start, _, _ = HEADER.unpack_from(frame)
            if size == total == end - HEADER.size and not start and total <= self._max_whole:
                packet = self._verified(frame[HEADER.size :])
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
            if total > self._max_whole:
                self.counters.oversized += 1
                continue
            whole = self._put(now, (sender, source, number), total, start, payload)
            if whole is not None and (packet := self._verified(whole)):
                packets.append(packet)
        if position != end or not end:
            self.counters.junk_frames += 1
        return packets

    def drop_expired(self, now: Instant) -> None:
        """Drop packets after the timeout; `take` does so first."""
        while self.open:
            key, oldest = next(iter(self.open.items()))
            if now - oldest.since < self._limits.reassembly_timeout:
                break
            del self.open[key]
            self.counters.timed_out += 1

    def _put(self, now: Instant, key: _PacketKey, total: int, start: int, payload: bytes) -> bytes | None:
        known = self.open.get(key)
        if known is not None and len(known.data) != total:
            del self.open[key]
            self.counters.contradicted += 1
            known = None
        if len(payload) == total:
            self.open.pop(key, None)
            return payload
        if known is None:
            known = self._begin(now, key, total)
        if not known.put(start, payload):
            return None
        del self.open[key]
        return bytes(known.data)

    def _begin(self, now: Instant, key: _PacketKey, total: int) -> _PartialPacket:
        if len(self.open) >= self._limits.max_open:
            del self.open[next(iter(self.open))]
            self.counters.evicted += 1
        begun = self.open[key] = _PartialPacket(now, bytearray(total), (1 << total) - 1)
        return begun

    def _verified(self, whole: bytes) -> bytes | None:
        if zlib.crc32(whole) != _RESIDUE:
            self.counters.bad_checksum += 1
            return None
        self.counters.complete += 1
        return whole[: -CHECKSUM.size]
