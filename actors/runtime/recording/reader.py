"""Reader of recordings, up to the end or the last valid checksum.

Files are untrusted: every length is checked before use. A power failure can leave zeros or garbage in place
of the last writes, so readers return the data before, and report the damage on standard error; `strict`
readers raise RecordingError.
"""

import errno
import hashlib
import struct
import sys
import zlib
from collections import deque
from collections.abc import Collection, Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, ClassVar, Final, NamedTuple, TypeVar

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, MetadataIndex
from mcap.writer import MCAP0_MAGIC

from actors.runtime import regular_file, typed_json
from actors.runtime.errors import printable
from actors.runtime.recording.format import (
    FIELDS,
    HASHED,
    HEAD,
    LARGEST_RECORD,
    MOST_CHANNELS,
    MOST_NOTES,
    SEAL,
    SEALS,
    STREAMED,
    UNSEALED,
    Direction,
    Entry,
    MessageUnpacker,
    Note,
    RecordingError,
)

_FOOTER: Final = struct.Struct("<BQQQI")
"""Opcode, length, start of the summary, start of its offsets, CRC-32 of everything from the summary to
here."""
_SUMMARY: Final = (
    *(Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS),
    *(Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER),
)
END: Final = _FOOTER.size + len(MCAP0_MAGIC)
"""Bytes after the summary."""


def is_complete_end(data_end: bytes, rest: bytes) -> bool:
    """Return True if the end of a file is complete, False if it is truncated.

    `data_end`: body of the DataEnd record; `rest`: everything after it.
    Raises ValueError if it is damaged, or followed by more data.
    """
    if data_end != bytes(4):  # seals are used instead of its checksum
        raise ValueError("damaged end-of-data record")
    if len(rest) > LARGEST_RECORD:
        raise ValueError("too many bytes after the end of data")
    at, opcode = 0, Opcode.DATA_END
    while opcode != Opcode.FOOTER:
        if len(rest) < at + HEAD.size:
            return False
        opcode, length = HEAD.unpack_from(rest, at)
        if opcode not in _SUMMARY:
            raise ValueError(f"unexpected record {opcode:#04x} after the end of data")
        at += HEAD.size + length
    if rest[at:] != MCAP0_MAGIC:
        if MCAP0_MAGIC.startswith(rest[at:]):
            return False
        raise ValueError("bytes after the end of the file")
    if not _has_valid_checksum(rest):
        raise ValueError("wrong checksum of the summary")
    return True


def note_positions(stream: IO[bytes]) -> Iterator["RecordPosition"]:
    """Yield the positions of the notes from the index at the end. ValueError if it is missing or damaged."""
    size = stream.seek(0, 2)
    stream.seek(max(0, size - END))
    end = stream.read(END)
    if len(end) < END or not end.endswith(MCAP0_MAGIC):
        raise ValueError("truncated: no footer")
    start = _FOOTER.unpack_from(end)[2]
    if not 0 < size - END - start <= LARGEST_RECORD:
        raise ValueError(f"summary starts at byte {start} of {size}")
    stream.seek(start)
    rest = stream.read(size - start)
    if not _has_valid_checksum(rest):
        raise ValueError("wrong checksum of the summary")
    at, found = 0, 0
    while at < len(rest) - END:
        opcode, length = HEAD.unpack_from(rest, at)
        at += HEAD.size
        if opcode == Opcode.METADATA_INDEX:
            index = MetadataIndex.read(ReadDataStream(BytesIO(rest[at : at + length])))
            found += 1
            if found > MOST_NOTES or index.length > LARGEST_RECORD:
                raise ValueError("too many or too large notes")
            yield RecordPosition(index.offset, index.length)
        at += length


class RecordPosition(NamedTuple):
    """Position of a record in its file, bytes."""

    offset: int
    length: int


def _has_valid_checksum(rest: bytes) -> bool:
    opcode, length, _, _, crc = _FOOTER.unpack_from(rest, len(rest) - END)
    true = zlib.crc32(rest[: len(rest) - len(MCAP0_MAGIC) - 4])
    return (opcode, length, crc) == (Opcode.FOOTER, _FOOTER.size - HEAD.size, true)


FAULTS: Final = (McapError, struct.error, zlib.error, LookupError, ValueError, RecursionError)
"""Exceptions that damaged bytes may cause."""


class _RecordedStep(msgspec.Struct, array_like=True):
    """First field of every message."""

    step: int


_DIRECTIONS: Final[dict[str, Direction]] = {"in": "in", "out": "out"}
_STEP: Final = 8
"""Bytes of the step at the end of a seal."""
_STEPS: Final = msgspec.msgpack.Decoder(_RecordedStep)
_REPORTED: Final[set[Path]] = set()
"""Files whose damage this process has reported on standard error."""


class RecordingReader:
    """One pass over a recording, in the order of writing; yields sealed data only."""

    reports: ClassVar[bool] = True
    """False in a process whose parent reports damage."""

    def __init__(
        self, path: Path, *, strict: bool = False, wanted: Collection[tuple[Direction, str]] | None = None
    ) -> None:
        """`strict`: raise RecordingError at damage, instead of stopping there with a line on standard error.

        `wanted`: directions and keys of the messages to yield; None: all. Checksums of others are verified
        without decoding, a hundred times as fast if none is wanted.
        """
        self.path = path
        self._strict, self._wanted = strict, wanted
        self.step: int | None = None
        """Last complete step; None: none."""
        self.whole = False
        """True once a complete end has been read: the process closed the file. False: truncated."""
        self.damage: RecordingError | None = None
        """Error that stopped reading before the end of the file; None: no error."""
        self.seals = 0
        """Number of valid checksums so far."""
        self._crc = self._size = self._at = 0
        self._channels: dict[int, Channel] = {}
        self._unsealed: list[Entry | Note] = []
        self._notes = 0
        self._unpacker = MessageUnpacker()

    def __iter__(self) -> Iterator[Entry | Note]:
        """Yield everything up to the end, a truncation or damage. Raises RecordingError if `strict`."""
        with open_recording(self.path) as stream:
            yield from self.read_new(stream)

    def read_new(self, stream: IO[bytes]) -> Iterator[Entry | Note]:
        """Yield data written since the last call; read it to its end before the next call."""
        if self.damage is not None:
            return
        try:
            yield from self._records(stream)
        except (*FAULTS, OSError) as error:
            good = "before the first step" if self.step is None else f"after step {self.step}"
            self.damage = RecordingError(f"{self.path}: damaged {good}, read up to there: {error}")
            if self._strict:
                raise self.damage from None
            self._report()

    def _records(self, stream: IO[bytes]) -> Iterator[Entry | Note]:
        """Yield sealed data. Raises one of FAULTS at damage."""
        stream.seek(self._at)
        if not self._at and not self._begins(stream):
            return
        while (record := self._next(stream)) is not None:
            opcode, head, body = record
            if opcode == Opcode.DATA_END:
                self._end(body, stream)
                return
            if self._take(opcode, head, body, self._crc):
                yield from self._unsealed
                self._unsealed, self._size = [], 0
            self._size += len(body)
            if self._size > UNSEALED + 2 * LARGEST_RECORD:
                raise ValueError(f"{self._size} bytes without a checksum")
            self._crc = zlib.crc32(body, zlib.crc32(head, self._crc))
            self._at += len(head) + len(body)

    def _begins(self, stream: IO[bytes]) -> bool:
        """Return True once the file has its magic bytes."""
        magic = stream.read(len(MCAP0_MAGIC))
        if not MCAP0_MAGIC.startswith(magic):
            raise RecordingError(f"{self.path}: not a recording, or damaged at its start")
        if len(magic) < len(MCAP0_MAGIC):
            return False
        self._crc, self._at = zlib.crc32(magic), len(magic)
        return True

    def _next(self, stream: IO[bytes]) -> tuple[int, bytes, bytes] | None:
        """Return the next record; None if the file is truncated here."""
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        if length > LARGEST_RECORD:
            raise ValueError(f"a record has {length} bytes; the limit is {LARGEST_RECORD}")
        body = stream.read(length)
        return (opcode, head, body) if len(body) == length else None

    def _take(self, opcode: int, head: bytes, body: bytes, crc: int) -> bool:
        """Process one record; return True for a valid seal."""
        match opcode:
            case Opcode.MESSAGE:
                channel, sequence, _, _ = FIELDS.unpack_from(body)
                data = body[FIELDS.size :]
                if self._channels[channel].message_encoding == SEALS:
                    self._check(head, body, crc)
                    return True
                self._unsealed += self._entry(self._channels[channel], sequence, data)
            case Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(body)))
                if self._channels.setdefault(channel.id, channel) != channel:
                    raise ValueError(f"duplicate channel {channel.id}")
                if len(self._channels) > MOST_CHANNELS:
                    raise ValueError(f"more than {MOST_CHANNELS} channels")
            case Opcode.METADATA:
                self._unsealed.append(parse_note(body))
                self._notes += 1
                if self._notes > MOST_NOTES:
                    raise ValueError(f"more than {MOST_NOTES} notes")
            case Opcode.SCHEMA:  # only for other readers
                pass
            case Opcode.HEADER if not self._channels:  # later, it is a damaged record
                pass
            case _:
                raise ValueError(f"unexpected record {opcode:#04x}")
        return False

    def _entry(self, channel: Channel, sequence: int, data: bytes) -> Iterator[Entry]:
        """Yield the message, if it is wanted."""
        direction = _DIRECTIONS[channel.metadata["direction"]]
        is_wanted = self._wanted is None or (direction, channel.topic) in self._wanted
        if not (is_wanted or (self._wanted and channel.message_encoding in STREAMED)):
            return
        if channel.message_encoding == HASHED:
            if len(data) != 40:
                raise ValueError(f"a message hash with its step has {len(data)} bytes, not 40")
            step = int.from_bytes(data[:8], "little")
            yield Entry(direction, channel.topic, step, sequence, None, data[8:])
            return
        payload = self._unpacker.unpacked(channel.message_encoding, data)
        self._size += len(payload) - len(data)
        if not is_wanted:  # later messages of its stream require it
            return
        step = _STEPS.decode(memoryview(payload)[1:]).step
        yield Entry(direction, channel.topic, step, sequence, payload, hashlib.sha256(payload).digest())

    def _check(self, head: bytes, body: bytes, crc: int) -> None:
        checksum, step = SEAL.unpack(body[FIELDS.size :])
        due = zlib.crc32(head + body[: FIELDS.size] + body[-_STEP:], crc)
        if checksum != due:
            raise ValueError(f"checksum {due:08x}, recorded {checksum:08x}")
        self.step = None if step < 0 else step
        self.seals += 1

    def _end(self, body: bytes, stream: IO[bytes]) -> None:
        """Check the end of the file: everything must be sealed, and the summary has its own checksum."""
        if self._unsealed:
            raise ValueError(f"the last {len(self._unsealed)} records have no checksum")
        rest = stream.read(LARGEST_RECORD + 1)
        self.whole = is_complete_end(body, rest)

    def _report(self) -> None:
        """Print the damage once, since a command may read a file several times."""
        file = self.path.resolve()
        if self.reports and file not in _REPORTED:
            _REPORTED.add(file)
            sys.stderr.write(f"acrc: {printable(str(self.damage))}\n")


def read_recording(path: Path) -> Iterator[Entry | Note]:
    """Yield everything in a file, in the order of writing, up to its end, a truncation or damage."""
    return iter(RecordingReader(path))


def report_damage(path: Path) -> None:
    """Verify the checksums of a file that another process decodes. Raises RecordingError."""
    deque(RecordingReader(path, wanted=()), 0)


def open_recording(path: Path) -> IO[bytes]:
    """Open a recording; it must be a regular file, not a link. Raises RecordingError."""
    try:
        return regular_file.open_regular(path, links=False)
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such recording") from None
    except OSError as error:
        link = error.errno == errno.ELOOP and path.is_symlink()
        why = "is a symbolic link, not a recording" if link else f"cannot be read: {error.strerror}"
        why = "is not a regular file" if error.errno in {errno.EINVAL, errno.EISDIR} else why
        raise RecordingError(f"{path}: {why}") from None
    except ValueError as error:  # a null byte
        raise RecordingError(f"{str(path)!r} is not a valid file name: {error}") from None


def parse_note(body: bytes) -> Note:
    """Return the note in a metadata record; raises one of FAULTS if it is invalid."""
    record = Metadata.read(ReadDataStream(BytesIO(body)))
    text = record.metadata["json"]
    if int(record.metadata["crc32"], 16) != zlib.crc32(text.encode()):
        raise ValueError(f"wrong checksum of the note {record.name!r}")
    return Note(record.name, text)


T = TypeVar("T")


def read_notes(path: Path) -> dict[str, str]:
    """Return the metadata records of a file by name; the last of each name.

    Uses the index at the end of the file, or reads the whole file. Raises RecordingError.
    """
    with open_recording(path) as stream:
        try:
            return {note.name: note.json for note in _indexed(stream)}
        except FAULTS:
            pass  # truncated or damaged
    return {item.name: item.json for item in read_recording(path) if isinstance(item, Note)}


def decode_note(path: Path, name: str, text: str, kind: type[T]) -> T:
    """Return a note's content as a value of type `kind`. Raises RecordingError."""
    try:
        return typed_json.decode(text, kind)
    except ValueError as error:
        raise RecordingError(f"{path}: invalid record {name!r}: {str(error)[:300]}") from None


def _indexed(stream: IO[bytes]) -> list[Note]:
    notes = []
    for place in list(note_positions(stream)):
        stream.seek(place.offset)
        record = stream.read(place.length)
        if HEAD.unpack_from(record) != (Opcode.METADATA, len(record) - HEAD.size):
            raise ValueError("wrong index of notes")
        notes.append(parse_note(record[HEAD.size :]))
    return notes
