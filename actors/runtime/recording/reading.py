"""Reads a recording up to its end, or up to its last true checksum where it was cut or damaged.

Bytes of a file are not to be trusted: every length is bounded before it is used. A power cut can leave zeros
or garbage in place of the last writes, so every reader takes what comes before, with a line on standard
error; `strict` readers raise RecordingError there.
"""

import errno
import hashlib
import struct
import sys
import zlib
from collections import deque
from collections.abc import Iterator
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
from actors.runtime.recording.form import (
    FIELDS,
    HASHED,
    HEAD,
    LARGEST_RECORD,
    MOST_CHANNELS,
    MOST_NOTES,
    SEAL,
    SEALS,
    UNSEALED,
    Direction,
    Entry,
    MessageUnpacker,
    Note,
    RecordingError,
)

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


FAULTS: Final = (McapError, struct.error, zlib.error, LookupError, ValueError, RecursionError)
"""What reading damaged bytes may raise."""


class _RecordedStep(msgspec.Struct, array_like=True):
    """The beginning of every message."""

    step: int


_DIRECTIONS: Final[dict[str, Direction]] = {"in": "in", "out": "out"}
_STEP: Final = 8
"""Bytes of the step that a seal ends with."""
_STEPS: Final = msgspec.msgpack.Decoder(_RecordedStep)
_REPORTED: Final[set[Path]] = set()
"""Files whose damage this process has reported on standard error."""


class Reading:
    """One pass over a recording, in the order it was written; what is not sealed is not given."""

    reports: ClassVar[bool] = True
    """False in a process whose starter reports damage."""

    def __init__(self, path: Path, *, strict: bool = False, decodes: bool = True) -> None:
        """`strict`: raise RecordingError at damage, instead of ending there with a line on standard error.

        `decodes`: False yields nothing, and compares checksums alone, which is a hundred times as fast.
        """
        self.path = path
        self._strict, self._decodes = strict, decodes
        self.step: int | None = None
        """Up to this one everything is there; None: not even the first one."""
        self.whole = False
        """True once the end has been read, and is one: the process closed its file. False: it was cut."""
        self.damage: RecordingError | None = None
        """Error at which reading ended before the end of the file; None: there is none."""
        self.seals = 0
        """Checksums so far, all of them true."""
        self._crc = self._size = self._at = 0
        self._channels: dict[int, Channel] = {}
        self._unsealed: list[Entry | Note] = []
        self._notes = 0
        self._unpacker = MessageUnpacker()

    def __iter__(self) -> Iterator[Entry | Note]:
        """Yield everything up to the end, the cut or the damage. Raises RecordingError: see `strict`."""
        with opened(self.path) as stream:
            yield from self.more(stream)

    def more(self, stream: IO[bytes]) -> Iterator[Entry | Note]:
        """Yield what has been written since the last call; to be read to its end before the next one."""
        if self.damage is not None:
            return
        try:
            yield from self._records(stream)
        except (*FAULTS, OSError) as error:
            good = "before its first step" if self.step is None else f"after step {self.step}"
            self.damage = RecordingError(f"{self.path}: damaged {good}; read up to there: {error}")
            if self._strict:
                raise self.damage from None
            self._report()

    def _records(self, stream: IO[bytes]) -> Iterator[Entry | Note]:
        """Yield what is sealed. Raises one of FAULTS at damage."""
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
        """True once the file has its first bytes."""
        magic = stream.read(len(MCAP0_MAGIC))
        if not MCAP0_MAGIC.startswith(magic):
            raise RecordingError(f"{self.path}: not a recording of this project, or damaged at its start")
        if len(magic) < len(MCAP0_MAGIC):
            return False
        self._crc, self._at = zlib.crc32(magic), len(magic)
        return True

    def _next(self, stream: IO[bytes]) -> tuple[int, bytes, bytes] | None:
        """The next record; None where the file was cut."""
        head = stream.read(HEAD.size)
        if len(head) < HEAD.size:
            return None
        opcode, length = HEAD.unpack(head)
        if length > LARGEST_RECORD:
            raise ValueError(f"a record would have {length} bytes; it may have at most {LARGEST_RECORD}")
        body = stream.read(length)
        return (opcode, head, body) if len(body) == length else None

    def _take(self, opcode: int, head: bytes, body: bytes, crc: int) -> bool:
        """Take in one record; True if it was a seal, and a true one."""
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
                    raise ValueError(f"channel {channel.id} is there twice")
                if len(self._channels) > MOST_CHANNELS:
                    raise ValueError(f"it has more than {MOST_CHANNELS} channels")
            case Opcode.METADATA:
                self._unsealed.append(noted(body))
                self._notes += 1
                if self._notes > MOST_NOTES:
                    raise ValueError(f"it has more than {MOST_NOTES} notes")
            case Opcode.SCHEMA:  # for people: who reads here knows the messages
                pass
            case Opcode.HEADER if not self._channels:  # later, it is a record whose kind was damaged
                pass
            case _:
                raise ValueError(f"a record of kind {opcode:#04x}, which a recording has not")
        return False

    def _entry(self, channel: Channel, sequence: int, data: bytes) -> Iterator[Entry]:
        """Yield the message, if messages are decoded."""
        if not self._decodes:
            return
        direction = _DIRECTIONS[channel.metadata["direction"]]
        if channel.message_encoding == HASHED:
            if len(data) != 40:
                raise ValueError(f"the hash of a message has {len(data)} bytes with its step, and not 40")
            step = int.from_bytes(data[:8], "little")
            yield Entry(direction, channel.topic, step, sequence, None, data[8:])
            return
        payload = self._unpacker.unpacked(channel.message_encoding, data)
        self._size += len(payload) - len(data)
        step = _STEPS.decode(memoryview(payload)[1:]).step
        yield Entry(direction, channel.topic, step, sequence, payload, hashlib.sha256(payload).digest())

    def _check(self, head: bytes, body: bytes, crc: int) -> None:
        checksum, step = SEAL.unpack(body[FIELDS.size :])
        due = zlib.crc32(head + body[: FIELDS.size] + body[-_STEP:], crc)
        if checksum != due:
            raise ValueError(f"its checksum is {due:08x}, where {checksum:08x} was written")
        self.step = None if step < 0 else step
        self.seals += 1

    def _end(self, body: bytes, stream: IO[bytes]) -> None:
        """At the end of the data: nothing may lie unsealed, and what follows has a checksum of its own."""
        if self._unsealed:
            raise ValueError(f"its last {len(self._unsealed)} records have no checksum")
        rest = stream.read(LARGEST_RECORD + 1)
        self.whole = sound_end(body, rest)

    def _report(self) -> None:
        """Print the damage once: a command may read a file several times."""
        file = self.path.resolve()
        if self.reports and file not in _REPORTED:
            _REPORTED.add(file)
            sys.stderr.write(f"acrc: {printable(str(self.damage))}\n")


def read_recording(path: Path) -> Iterator[Entry | Note]:
    """Yield everything in a file, in the order it was written, up to its end, a cut or damage."""
    return iter(Reading(path))


def report_damage(path: Path) -> None:
    """Compare a file with its checksums, for one that another process decodes. Raises RecordingError."""
    deque(Reading(path, decodes=False), 0)


def opened(path: Path) -> IO[bytes]:
    """The file to read; a link, a pipe and the like are none. Raises RecordingError."""
    try:
        return regular_file.opened(path, links=False)
    except FileNotFoundError:
        raise RecordingError(f"{path}: no such recording") from None
    except OSError as error:
        link = error.errno == errno.ELOOP and path.is_symlink()
        why = "a link, and a recording never is" if link else f"cannot be read: {error.strerror}"
        why = "no recording, as it is no file" if error.errno in {errno.EINVAL, errno.EISDIR} else why
        raise RecordingError(f"{path}: {why}") from None
    except ValueError as error:  # a zero byte
        raise RecordingError(f"{str(path)!r}: no name of a recording: {error}") from None


def noted(body: bytes) -> Note:
    """The note in a metadata record; one of FAULTS if it is none, or damaged."""
    record = Metadata.read(ReadDataStream(BytesIO(body)))
    text = record.metadata["json"]
    if int(record.metadata["crc32"], 16) != zlib.crc32(text.encode()):
        raise ValueError(f"the note {record.name!r} has another checksum")
    return Note(record.name, text)


T = TypeVar("T")


def read_notes(path: Path) -> dict[str, str]:
    """The metadata records of a file by name; the last one where a name occurs twice.

    By the index at the file's end, and without one by reading all of it. Raises RecordingError.
    """
    with opened(path) as stream:
        try:
            return {note.name: note.json for note in _indexed(stream)}
        except FAULTS:
            pass  # the process died, or the end is damaged
    return {item.name: item.json for item in read_recording(path) if isinstance(item, Note)}


def decoded(path: Path, name: str, text: str, kind: type[T]) -> T:
    """A note's content; RecordingError if it is no `kind`, whoever wrote it."""
    try:
        return typed_json.decode(text, kind)
    except ValueError as error:
        raise RecordingError(
            f"{path}: its record {name!r} is not what it should be: {str(error)[:300]}"
        ) from None


def _indexed(stream: IO[bytes]) -> list[Note]:
    notes = []
    for place in list(note_places(stream)):
        stream.seek(place.offset)
        record = stream.read(place.length)
        if HEAD.unpack_from(record) != (Opcode.METADATA, len(record) - HEAD.size):
            raise ValueError("the index of its notes leads elsewhere")
        notes.append(noted(record[HEAD.size :]))
    return notes
