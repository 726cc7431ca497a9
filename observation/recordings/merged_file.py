"""The recordings of a run in one MCAP file that any reader of such files shows, message by message as JSON.

The order is canonical: by step; within it in the order in which a step goes (`PHASES`), then by robot, as
robots are sorted by name, then as they were sent. No arrival and no clock has a part in it, nor has anything
else that differs between two executions of one run: the same run gives the same bytes.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import msgspec
from mcap.records import Channel, Footer, Metadata
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from actors.messages import (
    AIRED,
    BOARD,
    CONTROL,
    DRIVE,
    MESSAGE_VERSION,
    RADIO_READY,
    READY,
    RECEIVED,
    ROSTER,
    SENSES,
    TRANSMIT,
    TRUTH,
)
from actors.runtime import regular_file
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.recording import RecordingError
from actors.runtime.recording.form import LARGEST_RECORD
from actors.runtime.recording.reading import FAULTS
from actors.topic import Message, Topic
from observation.recordings.plain import plain, schema
from observation.recordings.topics import MERGED, Growing, Recorded, files, is_merged
from observation.replay.record_check import check
from observation.replay.record_pass import read_pass

PHASES: Final[tuple[Topic[Any], ...]] = (
    CONTROL, RADIO_READY, READY, ROSTER, SENSES, RECEIVED, TRANSMIT, DRIVE, TRUTH, AIRED, BOARD,
)  # fmt: skip
"""What comes after what within a step."""
_PHASE: Final = {topic.pattern: number for number, topic in enumerate(PHASES)}
_ABOUT: Final = "run"
_SEQUENCES: Final = 0xFFFFFFFF
_PART: Final = re.compile(r"(\d+)")


class Merged(msgspec.Struct, frozen=True):
    """What the file says of its run, as the metadata record `run`, a JSON object."""

    digest: str
    """Of the run, by its recordings."""
    step_us: int
    commit: str
    """Of the testbed that recorded it."""
    message_version: int
    messages: int
    hashes: int
    """Of them, those of which only the hash is there: nobody took them."""
    complete: bool
    """False: at least one process left no final record."""
    recordings: tuple[str, ...]
    """The processes, by name."""


class MergeReport(NamedTuple):
    """What has come of it."""

    about: Merged
    size: int
    """Bytes of the file."""


class _Sent(NamedTuple):
    """One message of a run, and where it belongs."""

    place: tuple[Any, ...]
    key: str
    step: int
    payload: bytes | None
    sha256: bytes


def merge(out: Path, file: Path) -> MergeReport:
    """Write the recordings of a run into one new file; all messages are held in memory meanwhile.

    Raises CheckError where they contradict one another, RecordingError for damaged ones and for a file that
    is there already.
    """
    told = check(out, strict=False)
    runs, sent = _gathered(out)
    step_us, commit = runs[0]
    messages = sorted(sent, key=lambda one: one.place)
    about = Merged(
        digest=told.digest,
        step_us=step_us,
        commit=commit,
        message_version=MESSAGE_VERSION,
        messages=len(messages),
        hashes=sum(one.payload is None for one in messages),
        complete=told.complete,
        recordings=tuple(files(out)),
    )
    try:
        with file.open("xb") as stream:
            _write(stream, about, messages)
    except FileExistsError:
        raise RecordingError(f"{file}: is there already; should be a new file") from None
    except OSError as error:
        raise RecordingError(f"{file}: cannot be written: {error.strerror or error}") from None
    return MergeReport(about, file.stat().st_size)


def _gathered(out: Path) -> tuple[list[tuple[int, str]], list[_Sent]]:
    """Step and commit of each recording, and every message of the run once."""
    runs: list[tuple[int, str]] = []
    by_key: dict[str, list[Recorded]] = defaultdict(list)
    for path in files(out).values():
        with Growing(path) as growing:
            for one in growing.poll():
                by_key[one.key].append(one)
            if growing.run is not None:
                runs.append((growing.run.step_us, growing.run.commit))
    return runs, [one for key, all_ in by_key.items() for one in _once(key, all_)]


def _once(key: str, recorded: Sequence[Recorded]) -> Iterator[_Sent]:
    """Each message of a key once, be it as sender or as receiver has it; in full if either has it so."""
    payloads = {one.sha256: one.payload for one in recorded if one.payload is not None}
    sent = [(one.step, one.sha256) for one in recorded if one.direction == "out"]
    left = Counter(sent)
    for one in recorded:  # what the sender's recording, cut before, has not
        if one.direction == "in":
            if not left[one.step, one.sha256]:
                sent.append((one.step, one.sha256))
            else:
                left[one.step, one.sha256] -= 1
    phase, robot = _PHASE[topic_of(key).pattern], _by_number(key)
    for number, (step, sha256) in enumerate(sorted(sent, key=lambda stamp: stamp[0])):
        yield _Sent((step, phase, robot, number), key, step, payloads.get(sha256), sha256)


def _by_number(key: str) -> tuple[tuple[str, int], ...]:
    """So that r10 stands behind r9."""
    parts = _PART.split(key)
    numbers = [int(part) for part in parts[1::2]] + [0]
    return tuple(zip(parts[::2], numbers, strict=True))


def _write(stream: IO[bytes], about: Merged, messages: Iterable[_Sent]) -> None:
    writer = Writer(stream, compression=CompressionType.NONE, enable_data_crcs=True)
    writer.start(profile=MERGED, library="acrc")
    writer.add_metadata(_ABOUT, {"json": msgspec.json.encode(about).decode()})
    schemas: dict[str, int] = {}
    channels: dict[str, int] = {}
    for sequence, one in enumerate(messages):
        kind = topic_of(one.key).kind
        if kind.__name__ not in schemas:
            shape = msgspec.json.encode(schema(kind))
            schemas[kind.__name__] = writer.register_schema(kind.__name__, "jsonschema", shape)
        if one.key not in channels:
            channels[one.key] = writer.register_channel(one.key, "json", schemas[kind.__name__])
        instant = one.step * about.step_us * 1000
        writer.add_message(channels[one.key], instant, _json(one), instant, sequence & _SEQUENCES)
    writer.finish()  # type: ignore[no-untyped-call]


def _json(one: _Sent) -> bytes:
    if one.payload is None:
        return msgspec.json.encode({"step": one.step, "sha256": one.sha256.hex()})
    return msgspec.json.encode(plain(decode(topic_of(one.key), one.key, one.payload)))


def check_merged(file: Path) -> Merged:
    """Read all of a merged file: its checksums, its order, its number of messages, their fields.

    Raises RecordingError for one that is not as it was written.
    """
    try:
        with regular_file.opened(file) as stream:
            return _checked(stream)
    except (AcrcError, *FAULTS) as error:
        why = str(error)[:300] or "it ends before its end"
        raise RecordingError(f"{file}: damaged, or not a merged file: {why}") from None
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read: {error.strerror or error}") from None


def _checked(stream: IO[bytes]) -> Merged:
    about: Merged | None = None
    topics: dict[int, Topic[Message]] = {}
    count, before, ended = 0, (0, 0), False
    for record in StreamReader(stream, validate_crcs=True, record_size_limit=LARGEST_RECORD).records:
        if isinstance(record, Metadata) and record.name == _ABOUT:
            about = msgspec.json.decode(record.metadata["json"], type=Merged)
        elif isinstance(record, Channel):
            topics[record.id] = topic_of(record.topic)
        elif isinstance(record, McapMessage):
            topic = topics[record.channel_id]
            _check_fields(topic, record.data)
            place = (record.log_time, _PHASE[topic.pattern])
            if place < before or record.sequence != count & _SEQUENCES:
                raise ValueError(f"message {count}, on {topic.pattern}, is not where it should be")
            count, before = count + 1, place
        ended = isinstance(record, Footer)
    if about is None or not ended:
        raise ValueError("it has no end, or does not say of which run it is")
    if count != about.messages:
        raise ValueError(f"it holds {count} messages, and should hold {about.messages}")
    return about


def _check_fields(topic: Topic[Message], data: bytes) -> None:
    fields = msgspec.json.decode(data, type=dict[str, Any])
    unknown = fields.keys() - {*topic.kind.__struct_fields__, "sha256"}
    if unknown:
        raise ValueError(f"a message on {topic.pattern} has the field {min(unknown)[:40]!r}")


def told(file: Path) -> tuple[dict[str, Any], str]:
    """What a file is, for programs and for people. Raises RecordingError and CheckError.

    It is a merged one, or one process's recording.
    """
    if not is_merged(file):
        found = read_pass(file.stem, file, strict=True)
        state = "whole" if found.whole else "cut"
        until = "" if found.step is None else f", good up to step {found.step}"
        count = found.digest.count
        said = f"the recording of {found.actor}: {count} digested messages, {state}{until}"
        plainly = {"actor": found.actor, "messages": count, "whole": found.whole, "good_until": found.step}
        return {"is": "recording", **plainly}, said
    about = check_merged(file)
    state = "" if about.complete else ", which did not end as planned"
    hashes = f"; of {about.hashes} only the hash" if about.hashes else ""
    said = (
        f"a merged file of {', '.join(about.recordings)}: {about.messages} messages{hashes}, in canonical "
        f"order, of the run with the digest {about.digest}{state}"
    )
    return {"is": "merged", **msgspec.to_builtins(about)}, said
