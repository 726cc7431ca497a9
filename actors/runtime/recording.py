"""One process's append-only MCAP file: what it received in full, what it sent in full or as a hash.

Layout: channel metadata `direction` is `in` or `out`; `sequence` counts the messages of one key and
direction; `log_time` is the instant of the message's step, ns. A channel with message encoding `sha256` holds
the step as eight little-endian bytes and then the sha256 of the encoded message, which was too large to be
kept twice and which its receiver recorded in full.
Metadata records: `run` first, then `final` or `failure` as the last one before the end of data.
"""

import hashlib
import struct
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Final, Literal, NamedTuple, Protocol, Self

import msgspec
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Metadata
from mcap.records import Message as Record
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from actors.runtime.errors import AcrcError

LARGE: Final = 256
"""A sender keeps its messages up to so many bytes in full."""
_MESSAGE: Final = struct.Struct("<BQHIQQ")
_FIXED_FIELDS: Final = struct.calcsize("<HIQQ")
_ENCODING: Final = "acrc-msgpack"
_HASHED: Final = "sha256"

Direction = Literal["in", "out"]


class RecordingError(AcrcError):
    """A recording that cannot be read."""


class Journal(Protocol):
    """Where a shell writes down what passes through it."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message came in."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes) -> None:
        """A message went out."""

    def flush(self) -> None:
        """Everything up to here must survive the death of this process."""


class Recorder:
    """Writes one process's file."""

    def __init__(self, path: Path, step_us: int) -> None:
        self._stream: IO[bytes] = path.open("xb")
        self._writer = Writer(
            self._stream,
            compression=CompressionType.NONE,  # the others need what constraints.txt leaves out
            index_types=IndexType.METADATA,
            use_chunking=False,
            use_statistics=False,  # not all messages pass the library, so it could not count them
        )
        self._writer.start(profile="acrc", library="acrc")
        self._channels: dict[tuple[str, str, str], int] = {}
        self._step_ns = step_us * 1000

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def fileno(self) -> int:
        """The file's descriptor, for a process that closes or hides all else."""
        return self._stream.fileno()

    def note(self, name: str, content: msgspec.Struct) -> None:
        """A metadata record with `content` as JSON."""
        self._writer.add_metadata(name, {"json": msgspec.json.encode(content).decode()})
        self._stream.flush()

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """A message came in."""
        self._add("in", key, _ENCODING, step, sequence, payload)

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes) -> None:
        """A message went out."""
        if len(payload) <= LARGE:
            self._add("out", key, _ENCODING, step, sequence, payload)
        else:
            self._add("out", key, _HASHED, step, sequence, step.to_bytes(8, "little") + sha256)

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._stream.flush()

    def _add(
        self, direction: Direction, key: str, encoding: str, step: int, sequence: int, data: bytes
    ) -> None:
        instant = step * self._step_ns
        channel = self._channels.get((direction, key, encoding))
        if channel is None:
            channel = self._writer.register_channel(key, encoding, 0, {"direction": direction})
            self._channels[direction, key, encoding] = channel
            self._writer.add_message(channel, instant, data, instant, sequence)
            return
        # A message record as the library writes it, without its five calls per field: this is the place where
        # a step costs most. (MCAP specification, "Message (op=0x05)")
        head = _MESSAGE.pack(Opcode.MESSAGE, _FIXED_FIELDS + len(data), channel, sequence, instant, instant)
        self._stream.write(head)
        self._stream.write(data)


class Unrecorded:
    """A journal that keeps nothing, for benchmarks and for replays."""

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Nothing is kept."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes) -> None:
        """Nothing is kept."""

    def flush(self) -> None:
        """Nothing is kept."""


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


def read_recording(path: Path) -> Iterator[Entry | Note]:
    """Everything in a file, in the order it was written; a file cut short ends where it was cut."""
    with _opened(path) as stream:
        channels: dict[int, Channel] = {}
        try:
            for record in StreamReader(_WholeReads(stream)).records:  # type: ignore[arg-type]
                if isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Record):
                    yield _entry(channels[record.channel_id], record)
                elif isinstance(record, Metadata):
                    yield Note(record.name, record.metadata["json"])
        except EndOfFile:
            return
        except (McapError, struct.error, LookupError, ValueError) as error:
            raise RecordingError(f"{path}: not a recording of this project, or damaged: {error}") from None


def read_notes(path: Path) -> dict[str, str]:
    """The metadata records of a file by name; the last one where a name occurs twice."""
    with _opened(path) as stream:
        try:
            return {note.name: note.metadata["json"] for note in make_reader(stream).iter_metadata()}
        except (McapError, struct.error, LookupError, ValueError):
            pass  # no index at the end: the process died, so the file has to be read through
    return {item.name: item.json for item in read_recording(path) if isinstance(item, Note)}


class _WholeReads:
    """A stream that ends where a read would come out short, as at the cut of a file."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def read(self, size: int) -> bytes:
        """Exactly `size` bytes, or EndOfFile."""
        data = self._stream.read(size)
        if len(data) < size:
            raise EndOfFile
        return data


def _opened(path: Path) -> IO[bytes]:
    if not path.is_file():
        raise RecordingError(f"{path}: no such recording")
    return path.open("rb")


def _entry(channel: Channel, record: Record) -> Entry:
    direction: Direction = "in" if channel.metadata["direction"] == "in" else "out"
    data = record.data
    if channel.message_encoding == _HASHED:
        step = int.from_bytes(data[:8], "little")
        return Entry(direction, channel.topic, step, record.sequence, None, data[8:])
    step = msgspec.msgpack.decode(_FIELDS.decode(memoryview(data)[1:])[0], type=int)
    return Entry(direction, channel.topic, step, record.sequence, data, hashlib.sha256(data).digest())


_FIELDS: Final = msgspec.msgpack.Decoder(list[msgspec.Raw])
