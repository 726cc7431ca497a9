"""The form of a recording, for those who write and those who read it.

Channel metadata `direction` is `in` or `out`; `sequence` counts the messages of one key and direction;
a channel whose messages are there in full has a schema that names their fields (`description`);
`log_time` is the instant of the message's step, ns. A channel with message encoding `sha256` holds the step
as eight little-endian bytes and then the sha256 of the encoded message, which was too large to be kept twice
and which its receiver recorded in full; there it is packed, which the encodings `acrc-msgpack-scan` and
`acrc-msgpack-deflate` say (`packing`). Files from before that have none of these, and are read alike.
Messages of topics that are only recorded (`Topic.is_recorded_only`) have nobody to receive them: their sender
records them in full, packed as `acrc-msgpack-deflate-computed`.
Metadata records: `run` first, then `final` or `failure` as the last one before the end of data; each has its
text as `json` and the text's CRC-32 as `crc32`.

The channel `seal` has the checksums: each of its messages holds the CRC-32 of the whole file before it and of
its own head, and the step of the last message before it (-1: there is none). What no seal vouches for does
not count.
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
"""A sender keeps its messages up to so many bytes in full."""
LARGEST_RECORD: Final = 16 * 1024 * 1024
"""Bytes; the world's last note on 1000 robots with 10 places each has less than 4 MB."""
UNSEALED: Final = 1024 * 1024
"""After so many bytes there is a seal, also within a step."""
MOST_CHANNELS: Final = 20_000
"""Three times what a world of 1000 robots has."""
MOST_NOTES: Final = 100
HEAD: Final = struct.Struct("<BQ")
"""Of every record: opcode, and the length of what follows."""
FIELDS: Final = struct.Struct("<HIQQ")
"""Of a message before its data: channel, sequence, log time, publish time."""
MESSAGE_HEAD: Final = struct.Struct(f"<{HEAD.format[1:]}{FIELDS.format[1:]}")
"""Both together: all of a message record before its data."""
SEAL: Final = struct.Struct("<Iq")
"""CRC-32 of the file up to it and of the seal's own head, fields and step (SEALED); and that step."""
SEALED: Final = struct.Struct(f"{MESSAGE_HEAD.format}q")
"""Of a seal, what its checksum covers: head and fields of its record, and the step."""
MESSAGES: Final = "acrc-msgpack"
SCANNED: Final = "acrc-msgpack-scan"
"""The same with its longest run of bytes, a scan, packed."""
DEFLATED: Final = "acrc-msgpack-deflate"
"""The same as a part of the file's one stream of deflate."""
COMPUTED: Final = "acrc-msgpack-deflate-computed"
"""The same as a part of a second stream of deflate: of the messages that are only recorded."""
HASHED: Final = "sha256"
SEALS: Final = "acrc-seal"

Direction = Literal["in", "out"]


class RecordingError(AcrcError):
    """A recording that cannot be written or read."""


class UnwritableError(RecordingError):
    """A recording of which the disk takes no more."""


class Entry(NamedTuple):
    """One recorded message; `payload` is None where only its hash was kept."""

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


WORTH: Final = 128
"""A shorter message stays as it is, in bytes: a packed one costs some µs."""
_SPEED: Final = 1
"""The least that deflate may do: more takes twice the time, and saves a tenth."""
_WINDOW: Final = 13
"""Packets come again within some seconds: so many bits of a place in what was there before, 8 KiB, reach."""
_MEMORY: Final = 5
"""Of 1 to 9. With zlib's own choices, 15 and 8, a message takes half as long again: caches are cold."""
_FLUSHED: Final = b"\x00\x00\xff\xff"
"""What each part of a flushed stream ends with; it is left out."""
_RUN: Final = 0xC5
"""msgpack's `bin 16`: two bytes with the length follow, most significant first, and then so many bytes."""
_PLACE: Final = struct.Struct(">H")
_FARTHEST: Final = 0xFFFF
_HEAD: Final = struct.Struct(">BHH")
"""Of a packed run: `bin 16`, how many bytes follow, and how many numbers it has."""


class _WithScans:
    @cached_property
    def _scans(self) -> "ScanBuffers":
        # numba takes half a second to import, which who reads no scan need not wait for
        from actors.runtime.recording.scans import ScanBuffers  # noqa: PLC0415

        return ScanBuffers()


class Packer(_WithScans):
    """Packs the messages of one file, in their order."""

    @cached_property
    def _received(self) -> "zlib._Compress":
        return zlib.compressobj(_SPEED, zlib.DEFLATED, -_WINDOW, _MEMORY)

    @cached_property
    def _computed(self) -> "zlib._Compress":
        return zlib.compressobj(_SPEED, zlib.DEFLATED, -zlib.MAX_WBITS, _MEMORY)

    def packed(self, payload: bytes) -> tuple[str, bytes]:
        """How the message stands in the file, and its bytes there."""
        size = len(payload)
        if not WORTH <= size <= LARGEST_RECORD:
            return MESSAGES, payload
        found = _run(payload, size)
        if found is not None and (data := self._with_scan(payload, *found)) is not None:
            return SCANNED, data
        return DEFLATED, _deflated(self._received, payload)

    def computed(self, payload: bytes) -> tuple[str, bytes]:
        """The same for a message that is only recorded."""
        if not WORTH <= len(payload) <= LARGEST_RECORD:
            return MESSAGES, payload
        return COMPUTED, _deflated(self._computed, payload)

    def _with_scan(self, payload: bytes, at: int, size: int) -> bytes | None:
        begin = at + 3
        run = self._scans.packed(payload[begin : begin + size])
        if run is None:
            return None
        head = _HEAD.pack(_RUN, len(run) + 2, size >> 1)
        return _PLACE.pack(at) + payload[:at] + head + run + payload[begin + size :]


class MessageUnpacker(_WithScans):
    """Gives the messages of one file back, in their order. ValueError or zlib.error for what is none."""

    def __init__(self) -> None:
        received, computed = (zlib.decompressobj(-zlib.MAX_WBITS) for _ in range(2))
        self._ways: dict[str, Callable[[bytes], bytes]] = {
            MESSAGES: lambda data: data,
            SCANNED: self._without_scan,
            DEFLATED: partial(_inflated, received),
            COMPUTED: partial(_inflated, computed),
        }

    def unpacked(self, encoding: str, data: bytes) -> bytes:
        """The message; never more than LARGEST_RECORD bytes, whatever `data` claims."""
        way = self._ways.get(encoding)
        if way is None:
            raise ValueError(f"a message is encoded as {encoding!r:.80}, which this version does not read")
        return way(data)

    def _without_scan(self, data: bytes) -> bytes:
        (place,) = _PLACE.unpack_from(data)
        at = _PLACE.size + place
        kind, length, count = _HEAD.unpack_from(data, at)
        begin, end = at + _HEAD.size, at + 3 + length
        if kind != _RUN or not begin <= end <= len(data):
            raise ValueError(f"a message says that its scan begins at byte {place}, where none does")
        run = self._scans.unpacked(data[begin:end], count)
        return b"".join((data[_PLACE.size : at], b"\xc5", _PLACE.pack(2 * count), run, data[end:]))


def _deflated(stream: "zlib._Compress", payload: bytes) -> bytes:
    return (stream.compress(payload) + stream.flush(zlib.Z_SYNC_FLUSH))[: -len(_FLUSHED)]


def _inflated(stream: "zlib._Decompress", data: bytes) -> bytes:
    payload = stream.decompress(data + _FLUSHED, LARGEST_RECORD)
    if stream.unconsumed_tail or stream.eof:
        raise ValueError(f"a message deflated to {len(data)} bytes has no end where it should have one")
    return payload


def _run(payload: bytes, whole: int) -> tuple[int, int] | None:
    """Where the run of bytes begins that is more than half of the message, and its length, if there is one.

    Whatever only looks like one does no harm: it comes back as it was.
    """
    at = payload.find(_RUN)
    while 0 <= at <= _FARTHEST and at + 3 <= whole:
        size = payload[at + 1] << 8 | payload[at + 2]
        if at + 3 + size <= whole < 2 * size and not size % 2:
            return at, size
        at = payload.find(_RUN, at + 1)
    return None
