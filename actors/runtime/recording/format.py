"""File format of recordings.

Channel metadata `direction` is `in` or `out`; `sequence` counts the messages of one key and direction;
`log_time` is the instant of the message's step, ns. A channel with complete messages has a schema that names
their fields (`description`). A channel with message encoding `sha256` has, per message, the step as eight
little-endian bytes and the SHA-256 of the encoded message: large messages are recorded completely by their
receiver only, packed with encoding `acrc-msgpack-scan` or `acrc-msgpack-deflate` (`packing`). Older files
without packing remain readable. Messages of recorded-only topics (`Topic.is_recorded_only`) have no receiver:
their sender records them completely, packed as `acrc-msgpack-deflate-computed`. Metadata records: `run`
first, and `final` or `failure` as the last one before the end of data, each with its text as `json` and the
text's CRC-32 as `crc32`.

The channel `seal` has the checksums: each of its messages has the CRC-32 of the whole file before it and of
its own head, and the step of the last message before it (-1: none). Data after the last valid seal is
ignored.
"""

import struct
import zlib
from collections.abc import Callable
from functools import cached_property, partial
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from actors.runtime.errors import AcrcError

if TYPE_CHECKING:
    from actors.runtime.recording.scans import ScanBuffers

LARGE: Final = 256
"""Largest message that its sender records completely, bytes."""
LARGEST_RECORD: Final = 16 * 1024 * 1024
"""Most bytes of a record; the world's last note on 1000 robots with 10 items each has less than 4 MB."""
UNSEALED: Final = 1024 * 1024
"""Most bytes between seals, also within a step."""
MOST_CHANNELS: Final = 20_000
"""Three times the channels of a world with 1000 robots."""
MOST_NOTES: Final = 100
HEAD: Final = struct.Struct("<BQ")
"""Head of every record: opcode, length of the rest."""
FIELDS: Final = struct.Struct("<HIQQ")
"""Fields of a message before its data: channel, sequence, log time, publish time."""
MESSAGE_HEAD: Final = struct.Struct(f"<{HEAD.format[1:]}{FIELDS.format[1:]}")
"""Head and fields: a message record before its data."""
SEAL: Final = struct.Struct("<Iq")
"""CRC-32 of the file up to the seal, and of the seal's head, fields and step (SEALED); the step."""
SEALED: Final = struct.Struct(f"{MESSAGE_HEAD.format}q")
"""Part of a seal that its checksum covers: head and fields of its record, and the step."""
MESSAGES: Final = "acrc-msgpack"
SCANNED: Final = "acrc-msgpack-scan"
"""A message whose longest run of bytes, a scan, is packed."""
DEFLATED: Final = "acrc-msgpack-deflate"
"""A message as part of the file's deflate stream."""
COMPUTED: Final = "acrc-msgpack-deflate-computed"
"""A message as part of a second deflate stream, for recorded-only messages."""
STREAMED: Final = (DEFLATED, COMPUTED)
"""Encodings that require the earlier messages of their stream."""
HASHED: Final = "sha256"
SEALS: Final = "acrc-seal"

Direction = Literal["in", "out"]


class RecordingError(AcrcError):
    """A recording that cannot be written or read."""


class UnwritableError(RecordingError):
    """A recording on a disk that accepts no more data."""


class Entry(NamedTuple):
    """One recorded message; `payload` is None if only its hash was recorded."""

    direction: Direction
    key: str
    step: int
    sequence: int
    payload: bytes | None
    sha256: bytes


class Note(NamedTuple):
    """One metadata record: its name and its content as JSON text."""

    name: str
    json: str


MIN_PACKED_SIZE: Final = 128
"""Smallest message that is packed, bytes: packing takes some µs."""
_SPEED: Final = 1
"""Lowest deflate level: higher ones double the time and save a tenth."""
_WINDOW: Final = 13
"""Window of 8 KiB, as a power of two: packets repeat within seconds."""
_MEMORY: Final = 5
"""1 to 9. zlib's defaults for window and memory, 15 and 8, make a message take half as long again: cold
caches."""
_FLUSHED: Final = b"\x00\x00\xff\xff"
"""End of each part of a flushed stream; omitted from the file."""
_RUN: Final = 0xC5
"""msgpack's `bin 16`: followed by the length in two bytes, big-endian, and the data."""
_PLACE: Final = struct.Struct(">H")
_FARTHEST: Final = 0xFFFF
_HEAD: Final = struct.Struct(">BHH")
"""Head of a packed run: `bin 16`, number of bytes that follow, number of ranges."""


class _PartWithScans:
    @cached_property
    def _scans(self) -> "ScanBuffers":
        # importing numba takes half a second: only for readers of scans
        from actors.runtime.recording.scans import ScanBuffers  # noqa: PLC0415

        return ScanBuffers()


class MessagePacker(_PartWithScans):
    """Packs the messages of one file, in order."""

    @cached_property
    def _received(self) -> "zlib._Compress":
        return zlib.compressobj(_SPEED, zlib.DEFLATED, -_WINDOW, _MEMORY)

    @cached_property
    def _computed(self) -> "zlib._Compress":
        return zlib.compressobj(_SPEED, zlib.DEFLATED, -zlib.MAX_WBITS, _MEMORY)

    def packed(self, payload: bytes) -> tuple[str, bytes]:
        """Return encoding and bytes of a received message."""
        size = len(payload)
        if not MIN_PACKED_SIZE <= size <= LARGEST_RECORD:
            return MESSAGES, payload
        found = _run(payload, size)
        if found is not None and (data := self._with_scan(payload, *found)) is not None:
            return SCANNED, data
        return DEFLATED, _deflated(self._received, payload)

    def computed(self, payload: bytes) -> tuple[str, bytes]:
        """Return encoding and bytes of a recorded-only message."""
        if not MIN_PACKED_SIZE <= len(payload) <= LARGEST_RECORD:
            return MESSAGES, payload
        return COMPUTED, _deflated(self._computed, payload)

    def _with_scan(self, payload: bytes, at: int, size: int) -> bytes | None:
        begin = at + 3
        run = self._scans.packed(payload[begin : begin + size])
        if run is None:
            return None
        head = _HEAD.pack(_RUN, len(run) + 2, size >> 1)
        return _PLACE.pack(at) + payload[:at] + head + run + payload[begin + size :]


class MessageUnpacker(_PartWithScans):
    """Unpacks the messages of one file, in order. Raises ValueError or zlib.error for invalid data."""

    def __init__(self) -> None:
        received, computed = (zlib.decompressobj(-zlib.MAX_WBITS) for _ in range(2))
        self._ways: dict[str, Callable[[bytes], bytes]] = {
            MESSAGES: lambda data: data,
            SCANNED: self._without_scan,
            DEFLATED: partial(_inflated, received),
            COMPUTED: partial(_inflated, computed),
        }

    def unpacked(self, encoding: str, data: bytes) -> bytes:
        """Return the message; at most LARGEST_RECORD bytes, whatever `data` claims."""
        way = self._ways.get(encoding)
        if way is None:
            raise ValueError(f"message encoding {encoding!r:.80} is not supported by this version")
        return way(data)

    def _without_scan(self, data: bytes) -> bytes:
        (place,) = _PLACE.unpack_from(data)
        at = _PLACE.size + place
        kind, length, count = _HEAD.unpack_from(data, at)
        begin, end = at + _HEAD.size, at + 3 + length
        if kind != _RUN or not begin <= end <= len(data):
            raise ValueError(f"a message has no packed scan at byte {place}")
        run = self._scans.unpacked(data[begin:end], count)
        return b"".join((data[_PLACE.size : at], b"\xc5", _PLACE.pack(2 * count), run, data[end:]))


def _deflated(stream: "zlib._Compress", payload: bytes) -> bytes:
    return (stream.compress(payload) + stream.flush(zlib.Z_SYNC_FLUSH))[: -len(_FLUSHED)]


def _inflated(stream: "zlib._Decompress", data: bytes) -> bytes:
    payload = stream.decompress(data + _FLUSHED, LARGEST_RECORD)
    if stream.unconsumed_tail or stream.eof:
        raise ValueError(f"a message deflated to {len(data)} bytes is incomplete")
    return payload


def _run(payload: bytes, whole: int) -> tuple[int, int] | None:
    """Return start and length of the run of bytes that makes up more than half of a message; None: no such
    run.

    A false match is harmless: unpacking restores the same bytes.
    """
    at = payload.find(_RUN)
    while 0 <= at <= _FARTHEST and at + 3 <= whole:
        size = payload[at + 1] << 8 | payload[at + 2]
        if at + 3 + size <= whole < 2 * size and not size % 2:
            return at, size
        at = payload.find(_RUN, at + 1)
    return None
