"""Large messages in fewer bytes, on their way into a recording and out of it; each comes back as it was.

A message that is mostly one run of bytes, as a scan is, has that run packed (`scans`) and stays what it is
otherwise. Every other one from `WORTH` bytes on goes through one stream of deflate (RFC 1951) per file,
message by message: radio brings the same packets again and again.
"""

import struct
import zlib
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final, Literal

from actors.runtime.recording.form import DEFLATED, LARGEST_RECORD, MESSAGES, SCANNED

if TYPE_CHECKING:
    from actors.runtime.recording.scans import ScanBuffers

Encoding = Literal["acrc-msgpack", "acrc-msgpack-scan", "acrc-msgpack-deflate"]
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
    def _deflate(self) -> "zlib._Compress":
        return zlib.compressobj(_SPEED, zlib.DEFLATED, -_WINDOW, _MEMORY)

    def packed(self, payload: bytes) -> tuple[Encoding, bytes]:
        """How the message stands in the file, and its bytes there."""
        size = len(payload)
        if not WORTH <= size <= LARGEST_RECORD:
            return MESSAGES, payload
        found = _run(payload, size)
        if found is not None and (data := self._with_scan(payload, *found)) is not None:
            return SCANNED, data
        deflate = self._deflate
        data = deflate.compress(payload) + deflate.flush(zlib.Z_SYNC_FLUSH)
        return DEFLATED, data[: -len(_FLUSHED)]

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
        self._inflate = zlib.decompressobj(-zlib.MAX_WBITS)
        self._ways: dict[str, Callable[[bytes], bytes]] = {
            MESSAGES: lambda data: data,
            SCANNED: self._without_scan,
            DEFLATED: self._inflated,
        }

    def unpacked(self, encoding: str, data: bytes) -> bytes:
        """The message; never more than LARGEST_RECORD bytes, whatever `data` claims."""
        way = self._ways.get(encoding)
        if way is None:
            raise ValueError(f"a message is encoded as {encoding!r:.80}, which this version does not read")
        return way(data)

    def _inflated(self, data: bytes) -> bytes:
        payload = self._inflate.decompress(data + _FLUSHED, LARGEST_RECORD)
        if self._inflate.unconsumed_tail or self._inflate.eof:
            raise ValueError(f"a message deflated to {len(data)} bytes has no end where it should have one")
        return payload

    def _without_scan(self, data: bytes) -> bytes:
        (place,) = _PLACE.unpack_from(data)
        at = _PLACE.size + place
        kind, length, count = _HEAD.unpack_from(data, at)
        begin, end = at + _HEAD.size, at + 3 + length
        if kind != _RUN or not begin <= end <= len(data):
            raise ValueError(f"a message says that its scan begins at byte {place}, where none does")
        run = self._scans.unpacked(data[begin:end], count)
        return b"".join((data[_PLACE.size : at], b"\xc5", _PLACE.pack(2 * count), run, data[end:]))


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
