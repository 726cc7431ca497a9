"""The end of a recording: what follows the data, with an index of the notes and a checksum of its own.

Layout (MCAP specification): the record DataEnd, the summary section, the record Footer, the magic bytes.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import IO, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import MetadataIndex
from mcap.writer import MCAP0_MAGIC

from actors.runtime.recording.form import HEAD, LARGEST_RECORD, MOST_NOTES

_FOOTER: Final = struct.Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, CRC-32 over all from the summary to here."""
_SUMMARY: Final = (
    *(Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS),
    *(Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER),
)
END: Final = _FOOTER.size + len(MCAP0_MAGIC)
"""Bytes after the summary."""


def sound_end(data_end: bytes, rest: bytes) -> bool:
    """Return True if the end of a file is whole, False if it was cut.

    `data_end` is the body of the DataEnd, `rest` what follows it.
    Raises ValueError if it is damaged, or if anything follows it.
    """
    if data_end != bytes(4):  # the seals are its checksum
        raise ValueError("the end of its data is not as it was written")
    if len(rest) > LARGEST_RECORD:
        raise ValueError("more follows its data than may")
    at, opcode = 0, Opcode.DATA_END
    while opcode != Opcode.FOOTER:
        if len(rest) < at + HEAD.size:
            return False
        opcode, length = HEAD.unpack_from(rest, at)
        if opcode not in _SUMMARY:
            raise ValueError(f"a record of kind {opcode:#04x} follows its data")
        at += HEAD.size + length
    if rest[at:] != MCAP0_MAGIC:
        if MCAP0_MAGIC.startswith(rest[at:]):
            return False
        raise ValueError("more bytes follow its end")
    if not _holds(rest):
        raise ValueError("what follows its data has another checksum")
    return True


def note_places(stream: IO[bytes]) -> Iterator["RecordPlace"]:
    """Where the notes lie, by the index at the end. ValueError if there is none, or a damaged one."""
    size = stream.seek(0, 2)
    stream.seek(max(0, size - END))
    end = stream.read(END)
    if len(end) < END or not end.endswith(MCAP0_MAGIC):
        raise ValueError("it has no end")
    start = _FOOTER.unpack_from(end)[2]
    if not 0 < size - END - start <= LARGEST_RECORD:
        raise ValueError(f"its summary would begin at byte {start} of {size}")
    stream.seek(start)
    rest = stream.read(size - start)
    if not _holds(rest):
        raise ValueError("its summary has another checksum")
    at, found = 0, 0
    while at < len(rest) - END:
        opcode, length = HEAD.unpack_from(rest, at)
        at += HEAD.size
        if opcode == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(ReadDataStream(BytesIO(rest[at : at + length])))
            found += 1
            if found > MOST_NOTES or index.length > LARGEST_RECORD:
                raise ValueError("it has more notes than may be, or a larger one")
            yield RecordPlace(index.offset, index.length)
        at += length


class RecordPlace(NamedTuple):
    """Where a record lies in its file."""

    offset: int
    length: int


def _holds(rest: bytes) -> bool:
    opcode, length, _, _, crc = _FOOTER.unpack_from(rest, len(rest) - END)
    true = zlib.crc32(rest[: len(rest) - len(MCAP0_MAGIC) - 4])
    return (opcode, length, crc) == (Opcode.FOOTER, _FOOTER.size - HEAD.size, true)
