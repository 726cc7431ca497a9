"""Writer of recordings."""

import functools
import hashlib
import io
import os
import zlib
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Final, Protocol, Self

import msgspec
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
from msgspec import inspect

from actors.messages import TOPICS
from actors.runtime.recording.format import (
    COMPUTED,
    DEFLATED,
    FIELDS,
    HASHED,
    HEAD,
    LARGE,
    LARGEST_RECORD,
    MESSAGE_HEAD,
    MESSAGES,
    MIN_PACKED_SIZE,
    SCANNED,
    SEAL,
    SEALED,
    SEALS,
    UNSEALED,
    Direction,
    MessagePacker,
    RecordingError,
    UnwritableError,
)
from actors.topic import Message

DESCRIPTION: Final = "acrc-fields"
"""Encoding of schemas: a JSON object with the fields of each type, in wire order.

The first type is the message, after a version byte; each type of a union has its tag before its fields. For
packed messages, `packing` describes the encoding.
"""
_PACKING: Final = {
    MESSAGES: (),
    SCANNED: (
        "two bytes, most significant first: where the scan begins",
        "then the message, whose scan (bin 16) has two bytes with the number of ranges, and these packed",
        "actors/runtime/recording/scans.py",
    ),
    DEFLATED: (
        "a part of the stream of deflate (RFC 1951) that runs through all such messages of the file",
        "flushed behind each message, without the bytes 00 00 ff ff at the end of each",
    ),
    COMPUTED: (
        "a part of another such stream of deflate, of all messages that are only recorded",
        "flushed behind each message, without the bytes 00 00 ff ff at the end of each",
    ),
}
_KINDS: Final = {topic.pattern.rpartition("/")[2]: topic.kind for topic in TOPICS}


_COMPACT: Final = frozenset(topic.pattern.rpartition("/")[2] for topic in TOPICS if not topic.is_packed)
"""Last parts of the keys whose messages are recorded without packing."""


def message_type(key: str) -> type[Message] | None:
    """Return the type of the messages on a key; None for an unknown key."""
    return _KINDS.get(key.rpartition("/")[2])


@functools.cache
def message_schema(kind: type[Message], encoding: str = MESSAGES) -> bytes:
    """Return the schema of a message type on a channel with that encoding."""
    types = {one.cls.__name__: _fields(one) for one in _structs(inspect.type_info(kind))}
    packing = {"packing": _PACKING[encoding]} if _PACKING[encoding] else {}
    return msgspec.json.encode(types | packing)


def _fields(kind: inspect.StructType) -> list[str]:
    tag = [] if kind.tag is None else [f"tag {kind.tag!r}"]
    return tag + [field.name for field in kind.fields]


def _structs(kind: inspect.Type) -> Iterator[inspect.StructType]:
    """Yield the type and the types of its parts."""
    inner: tuple[inspect.Type, ...] = ()
    match kind:
        case inspect.StructType():
            yield kind
            inner = tuple(field.type for field in kind.fields)
        case inspect.UnionType():
            inner = kind.types
        case inspect.VarTupleType():
            inner = (kind.item_type,)
        case inspect.TupleType():
            inner = kind.item_types
    for one in inner:
        yield from _structs(one)


_MESSAGE: Final = Opcode.MESSAGE.value
_HASHED_SIZE: Final = 40
"""Bytes of a step and a SHA-256."""
_SEAL_LENGTH: Final = FIELDS.size + SEAL.size
_SEALED_SIZE: Final = HEAD.size + _SEAL_LENGTH
_PendingMessage = tuple[Direction, str, int, int, bytes, int, bytes | None, str | None]
"""Direction, key, step, sequence, payload, its size, its SHA-256 if known; the encoding of a payload that is
packed already."""


class Journal(Protocol):
    """Destination of a shell's messages."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Record a received message."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """Record a sent message; `sha256`: of the payload, if known."""

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Record a recorded-only message completely."""

    def flush(self) -> None:
        """Ensure that everything so far survives a crash of this process."""


class Recorder:
    """Writes one process's recording, a new file. Raises RecordingError if it cannot be created."""

    def __init__(self, path: Path, step_us: int, descriptor: int | None = None) -> None:
        """`descriptor`: of the new file, if it is already open."""
        self.path = path
        file = _create(path) if descriptor is None else FileIO(descriptor, "wb")
        self._stream = _ChecksummedFile(file, path)
        self._writer = Writer(
            self._stream,  # type: ignore[arg-type]  # it needs `write`, `tell` and `flush`
            compression=CompressionType.NONE,  # other types need packages that are not in constraints.txt
            index_types=IndexType.METADATA,
            use_chunking=False,
            use_statistics=False,  # would be wrong: most messages bypass the library
        )
        self._writer.start(profile="acrc", library="acrc")
        self._seals = self._writer.register_channel("seal", SEALS, 0, {})
        self._writer.flush()  # type: ignore[no-untyped-call]  # the channel must precede its first message
        self._sealed = 0
        self._last = -1
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._packer = MessagePacker()
        self._noted: list[_PendingMessage] = []
        """Messages to be written: at most io.DEFAULT_BUFFER_SIZE bytes, and one message."""
        self._noted_size = 0
        """Their size, bytes."""
        self._step_ns = step_us * 1000

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.recover()
        self._seal()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def fileno(self) -> int:
        """Return the file's descriptor, for a process that closes or hides all others."""
        return self._stream.fileno()

    def note(self, name: str, content: msgspec.Struct) -> None:
        """Write a metadata record with `content` as JSON. Raises RecordingError if it is too large."""
        self._write_noted()
        text = msgspec.json.encode(content)
        if len(text) > LARGEST_RECORD // 2:
            raise RecordingError(
                f"{self.path}: the record {name!r} has {len(text)} bytes; the limit is {LARGEST_RECORD // 2}"
            )
        self._writer.add_metadata(name, {"json": text.decode(), "crc32": f"{zlib.crc32(text):08x}"})
        self._seal()
        self._stream.hand_over()

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Record a received message."""
        size = len(payload)
        self._noted += (("in", key, step, sequence, payload, size, None, None),)
        self._noted_size += size
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """Record a sent message; `sha256`: of the payload, if known."""
        size = len(payload)
        self._noted += (("out", key, step, sequence, payload, size, sha256, None),)
        self._noted_size += size
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Record a recorded-only message completely."""
        compact = key.rpartition("/")[2] in _COMPACT
        encoding, data = (MESSAGES, payload) if compact else self._packer.computed(payload)
        self._noted += (("out", key, step, sequence, data, len(payload), None, encoding),)
        self._noted_size += len(data)
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def flush(self) -> None:
        """Seal all data, and write it to the file."""
        self._seal()
        self._stream.hand_over()

    def _write_noted(self) -> None:
        """Write all waiting messages at once, in the library's format but without its five calls per field.

        The most expensive part of a step. (MCAP specification, "Message (op=0x05)") A full disk can fail only
        the last statement: then all data is kept and retried.
        """
        noted, self._noted, self._noted_size = self._noted, [], 0
        parts: list[bytes] = []
        written = counted = 0
        for direction, key, step, sequence, payload, size, sha256, packed in noted:
            encoding, data, length, whole = MESSAGES, payload, size, size
            if packed is not None:
                encoding, length = packed, len(payload)
            elif direction == "out":
                if size > LARGE:
                    data = step.to_bytes(8, "little") + (sha256 or hashlib.sha256(payload).digest())
                    encoding, length, whole = HASHED, _HASHED_SIZE, _HASHED_SIZE
            elif size >= MIN_PACKED_SIZE:
                encoding, data = self._packer.packed(payload)
                length = len(data)
            place = direction, key, encoding
            if place not in self._channels:
                self._stream.take(parts, written, counted)  # earlier messages must precede the channel
                parts, written, counted = [], 0, 0
                self._channels[place] = self._channel(direction, key, encoding)
            instant = step * self._step_ns
            length += FIELDS.size
            head = MESSAGE_HEAD.pack(_MESSAGE, length, self._channels[place], sequence, instant, instant)
            parts += (head, data)
            written += HEAD.size + length
            counted += MESSAGE_HEAD.size + whole
            self._last = step
        self._stream.take(parts, written, counted)
        if self._stream.unsealed > UNSEALED:
            self._seal()
        if self._stream.unsummed > io.DEFAULT_BUFFER_SIZE:
            self._stream.hand_over()

    def _channel(self, direction: Direction, key: str, encoding: str) -> int:
        """Register a channel; return its number."""
        schema = self._schema(key, encoding) if encoding != HASHED else 0
        number = self._writer.register_channel(key, encoding, schema, {"direction": direction})
        self._writer.flush()  # type: ignore[no-untyped-call]  # the channel must precede its first message
        return number

    def _schema(self, key: str, encoding: str) -> int:
        """Return the number of the schema of a key and encoding; 0 if there is none."""
        kind = message_type(key)
        if kind is None:
            return 0
        name = kind.__name__
        if (name, encoding) not in self._schemas:
            number = self._writer.register_schema(name, DESCRIPTION, message_schema(kind, encoding))
            self._schemas[name, encoding] = number
        return self._schemas[name, encoding]

    def _seal(self) -> None:
        """Write a seal over all data so far."""
        if self._noted:
            self._write_noted()
        last = self._last
        instant = last * self._step_ns if last > 0 else 0
        seal = SEALED.pack(_MESSAGE, _SEAL_LENGTH, self._seals, self._sealed, instant, instant, last)
        self._stream.seal(seal, last)
        self._sealed += 1


class _ChecksummedFile:
    """A file with the CRC-32 of its content. Raises UnwritableError if the disk accepts no more data.

    Rejected data is kept and retried with the next write, so no record is cut. A signal may interrupt any
    call between statements: changes that belong together are one statement.
    """

    def __init__(self, file: FileIO, path: Path) -> None:
        self._file = file
        self._path = path
        self._parts: list[bytes] = []
        """Written data that is not in the CRC yet."""
        self.unsummed = 0
        """Their size, bytes; the recorder limits it."""
        self._waiting = b""
        self._handed = 0
        """Bytes passed to the operating system."""
        self._size = 0
        self._crc32 = 0
        self.unsealed = 0
        """Bytes since the last seal; packed messages count unpacked."""
        self.fileno = file.fileno

    def tell(self) -> int:
        """Return the number of bytes so far."""
        return self._size

    def write(self, data: bytes) -> int:
        """Append data."""
        size = len(data)
        self.take([data], size, size)
        return size

    def take(self, parts: list[bytes], written: int, counted: int) -> None:
        """Append `written` bytes in parts, which count as `counted` unsealed bytes."""
        self._parts += parts
        self._size += written
        self.unsummed += written
        self.unsealed += counted

    def seal(self, sealed: bytes, step: int) -> None:
        """Append a seal over all data before it; `sealed`: its head, fields and step (`SEALED`)."""
        self._sum_up()
        checksum = zlib.crc32(sealed, self._crc32)
        seal = sealed[: MESSAGE_HEAD.size] + SEAL.pack(checksum, step)
        crc32 = zlib.crc32(seal, self._crc32)
        self._waiting, self._crc32, self.unsealed = self._waiting + seal, crc32, 0
        self._size += _SEALED_SIZE

    def _sum_up(self) -> None:
        """Add new data to the CRC."""
        data = b"".join(self._parts)
        crc32 = zlib.crc32(data, self._crc32)
        self._parts, self.unsummed, self._waiting, self._crc32 = [], 0, self._waiting + data, crc32

    def flush(self) -> None:
        """Do nothing: the library flushes within groups of records; see `hand_over`."""

    def hand_over(self) -> None:
        """Write all data to the file."""
        if self._parts:
            self._sum_up()
        while self._waiting:
            try:
                written = self._file.write(self._waiting)
            except OSError as error:
                raise self._full(error) from None
            self._waiting, self._handed = self._waiting[written:], self._handed + written

    def recover(self) -> None:
        """Adjust to a write that a signal interrupted; before the last calls."""
        taken = self._file.tell() - self._handed
        self._waiting, self._handed = self._waiting[taken:], self._handed + taken

    def close(self) -> None:
        """Write all data and close; the last call."""
        try:
            self.hand_over()
            self._file.close()
        except OSError as error:
            raise self._full(error) from None

    def _full(self, error: OSError) -> UnwritableError:
        return UnwritableError(f"{self._path}: cannot be written: {(error.strerror or str(error)).lower()}")


class NullJournal:
    """A journal that records nothing."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Do nothing."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """Do nothing."""

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Do nothing."""

    def flush(self) -> None:
        """Do nothing."""


def _create(path: Path) -> FileIO:
    """Create a file, never through a link."""
    try:
        return FileIO(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644), "wb")
    except OSError as error:
        raise RecordingError(f"{path}: the recording cannot be created: {error.strerror}") from None
