"""Writes a recording."""

import functools
import hashlib
import io
import os
import zlib
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self

import msgspec
from mcap.opcode import Opcode
from mcap.writer import CompressionType, IndexType, Writer
from msgspec import inspect

from actors.messages import TOPICS
from actors.runtime.recording.form import (
    COMPUTED,
    DEFLATED,
    FIELDS,
    HASHED,
    HEAD,
    LARGE,
    LARGEST_RECORD,
    MESSAGE_HEAD,
    MESSAGES,
    SCANNED,
    SEAL,
    SEALED,
    SEALS,
    UNSEALED,
    WORTH,
    Direction,
    Packer,
    RecordingError,
    UnwritableError,
)
from actors.topic import Message

DESCRIPTION: Final = "acrc-fields"
"""The encoding of such a schema: a JSON object with the fields of each type, in their order on the wire.

The first type is the message, behind a byte with the version; of a union each has its tag before its fields.
Where messages are packed, `packing` says in words how.
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
"""Last parts of the keys whose messages are recorded as they are."""


def kind_on(key: str) -> type[Message] | None:
    """The type of what travels on a key; None for a key that is none of this project."""
    return _KINDS.get(key.rpartition("/")[2])


@functools.cache
def described(kind: type[Message], encoding: str = MESSAGES) -> bytes:
    """The schema of a type of message, on a channel of that encoding."""
    types = {one.cls.__name__: _fields(one) for one in _structs(inspect.type_info(kind))}
    packing = {"packing": _PACKING[encoding]} if _PACKING[encoding] else {}
    return msgspec.json.encode(types | packing)


def _fields(kind: inspect.StructType) -> list[str]:
    tag = [] if kind.tag is None else [f"tag {kind.tag!r}"]
    return tag + [field.name for field in kind.fields]


def _structs(kind: inspect.Type) -> Iterator[inspect.StructType]:
    """The type itself, and those of its parts."""
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
"""Of a step and a sha256."""
_SEAL_LENGTH: Final = FIELDS.size + SEAL.size
_SEALED_SIZE: Final = HEAD.size + _SEAL_LENGTH
_Noted = tuple[Direction, str, int, int, bytes, int, bytes | None, str | None]
"""Direction, key, step, sequence, payload, its size, its sha256 if that is known; if the payload is packed
already, how."""


class Journal(Protocol):
    """Where a shell writes down what passes through it."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message came in."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """A message went out; `sha256`: of the payload, if it is known already."""

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message that is only recorded: keep it in full."""

    def flush(self) -> None:
        """Everything up to here must survive the death of this process."""


class Recorder:
    """Writes one process's file, which must be new. RecordingError where that cannot be made."""

    def __init__(self, path: Path, step_us: int, descriptor: int | None = None) -> None:
        """`descriptor`: the new file is open there already."""
        self.path = path
        file = _created(path) if descriptor is None else FileIO(descriptor, "wb")
        self._stream = _Checked(file, path)
        self._writer = Writer(
            self._stream,  # type: ignore[arg-type]  # it needs `write`, `tell` and `flush`
            compression=CompressionType.NONE,  # the others need what constraints.txt leaves out
            index_types=IndexType.METADATA,
            use_chunking=False,
            use_statistics=False,  # not all messages pass the library, so it could not count them
        )
        self._writer.start(profile="acrc", library="acrc")
        self._seals = self._writer.register_channel("seal", SEALS, 0, {})
        self._writer.flush()  # type: ignore[no-untyped-call]  # or the channel would follow its first message
        self._sealed = 0
        self._last = -1
        self._channels: dict[tuple[str, str, str], int] = {}
        self._schemas: dict[tuple[str, str], int] = {}
        self._packer = Packer()
        self._noted: list[_Noted] = []
        """What passed, and is still to be written: io.DEFAULT_BUFFER_SIZE bytes at most, and a message."""
        self._noted_size = 0
        """Bytes of them."""
        self._step_ns = step_us * 1000

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stream.recover()
        self._seal()
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def fileno(self) -> int:
        """The file's descriptor, for a process that closes or hides all else."""
        return self._stream.fileno()

    def note(self, name: str, content: msgspec.Struct) -> None:
        """A metadata record with `content` as JSON; RecordingError if that is larger than one may be."""
        self._write_noted()
        text = msgspec.json.encode(content)
        if len(text) > LARGEST_RECORD // 2:
            raise RecordingError(
                f"{self.path}: the record {name!r} would have {len(text)} bytes; it may have at most "
                f"{LARGEST_RECORD // 2}"
            )
        self._writer.add_metadata(name, {"json": text.decode(), "crc32": f"{zlib.crc32(text):08x}"})
        self._seal()
        self._stream.hand_over()

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message came in."""
        size = len(payload)
        self._noted += (("in", key, step, sequence, payload, size, None, None),)
        self._noted_size += size
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """A message went out; `sha256`: of the payload, if it is known already."""
        size = len(payload)
        self._noted += (("out", key, step, sequence, payload, size, sha256, None),)
        self._noted_size += size
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message that is only recorded: it is kept in full."""
        compact = key.rpartition("/")[2] in _COMPACT
        encoding, data = (MESSAGES, payload) if compact else self._packer.computed(payload)
        self._noted += (("out", key, step, sequence, data, len(payload), None, encoding),)
        self._noted_size += len(data)
        if self._noted_size > io.DEFAULT_BUFFER_SIZE:
            self._write_noted()

    def flush(self) -> None:
        """Seal everything, and hand it to the operating system."""
        self._seal()
        self._stream.hand_over()

    def _write_noted(self) -> None:
        """All of it at once: message records as the library writes them, without its five calls per field.

        This is where a step costs most. (MCAP specification, "Message (op=0x05)") Only at its end may the
        disk take no more: then everything stays, and is offered again.
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
            elif size >= WORTH:
                encoding, data = self._packer.packed(payload)
                length = len(data)
            place = direction, key, encoding
            if place not in self._channels:
                self._stream.take(parts, written, counted)  # or the channel would precede what came before it
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
        """The number of a new channel."""
        schema = self._schema(key, encoding) if encoding != HASHED else 0
        number = self._writer.register_channel(key, encoding, schema, {"direction": direction})
        self._writer.flush()  # type: ignore[no-untyped-call]  # or the channel would follow its first message
        return number

    def _schema(self, key: str, encoding: str) -> int:
        """The number of the description of what travels on the key, so encoded; 0 if there is none."""
        kind = kind_on(key)
        if kind is None:
            return 0
        name = kind.__name__
        if (name, encoding) not in self._schemas:
            number = self._writer.register_schema(name, DESCRIPTION, described(kind, encoding))
            self._schemas[name, encoding] = number
        return self._schemas[name, encoding]

    def _seal(self) -> None:
        """Vouch for everything up to here."""
        if self._noted:
            self._write_noted()
        last = self._last
        instant = last * self._step_ns if last > 0 else 0
        seal = SEALED.pack(_MESSAGE, _SEAL_LENGTH, self._seals, self._sealed, instant, instant, last)
        self._stream.seal(seal, last)
        self._sealed += 1


class _Checked:
    """A file that knows the CRC-32 of what was written to it; UnwritableError where the disk takes no more.

    What the disk has not taken is kept, and offered again with what follows: nothing is cut in the middle.
    A signal may end any call before any of its statements: what belongs together is one statement.
    """

    def __init__(self, file: FileIO, path: Path) -> None:
        self._file = file
        self._path = path
        self._parts: list[bytes] = []
        """What was written and is not in the CRC yet."""
        self.unsummed = 0
        """Bytes of them; the recorder hands them over before they are many."""
        self._waiting = b""
        self._handed = 0
        """Bytes that the operating system has."""
        self._size = 0
        self._crc32 = 0
        self.unsealed = 0
        """Bytes since the last seal, those of packed messages as they come back."""
        self.fileno = file.fileno

    def tell(self) -> int:
        """Bytes so far."""
        return self._size

    def write(self, data: bytes) -> int:
        """Append."""
        size = len(data)
        self.take([data], size, size)
        return size

    def take(self, parts: list[bytes], written: int, counted: int) -> None:
        """Append them, `written` bytes together; `counted` as unsealed."""
        self._parts += parts
        self._size += written
        self.unsummed += written
        self.unsealed += counted

    def seal(self, sealed: bytes, step: int) -> None:
        """Append what vouches for all before it; `sealed`: its head, fields and step (`SEALED`)."""
        self._sum_up()
        checksum = zlib.crc32(sealed, self._crc32)
        seal = sealed[: MESSAGE_HEAD.size] + SEAL.pack(checksum, step)
        crc32 = zlib.crc32(seal, self._crc32)
        self._waiting, self._crc32, self.unsealed = self._waiting + seal, crc32, 0
        self._size += _SEALED_SIZE

    def _sum_up(self) -> None:
        """Take into the CRC what is not in it yet."""
        data = b"".join(self._parts)
        crc32 = zlib.crc32(data, self._crc32)
        self._parts, self.unsummed, self._waiting, self._crc32 = [], 0, self._waiting + data, crc32

    def flush(self) -> None:
        """Nothing: the library calls it between records that belong together; see `hand_over`."""

    def hand_over(self) -> None:
        """Give everything to the operating system."""
        if self._parts:
            self._sum_up()
        while self._waiting:
            try:
                written = self._file.write(self._waiting)
            except OSError as error:
                raise self._full(error) from None
            self._waiting, self._handed = self._waiting[written:], self._handed + written

    def recover(self) -> None:
        """Before the last calls: a signal may have ended one that had handed something over already."""
        taken = self._file.tell() - self._handed
        self._waiting, self._handed = self._waiting[taken:], self._handed + taken

    def close(self) -> None:
        """The last call."""
        try:
            self.hand_over()
            self._file.close()
        except OSError as error:
            raise self._full(error) from None

    def _full(self, error: OSError) -> UnwritableError:
        return UnwritableError(f"{self._path}: cannot be written: {(error.strerror or str(error)).lower()}")


class Unrecorded:
    """A journal that keeps nothing, for benchmarks and for replays."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Nothing is kept."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """Nothing is kept."""

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Nothing is kept."""

    def flush(self) -> None:
        """Nothing is kept."""


def _created(path: Path) -> FileIO:
    """A new file, never one that a link leads to."""
    try:
        return FileIO(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644), "wb")
    except OSError as error:
        raise RecordingError(f"{path}: the recording cannot be made: {error.strerror}") from None
