"""The recordings of a field trial: which files there are, whose they are, and what they tell."""

import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

from actors.messages import (
    DRIVE,
    RECEIVED,
    SENSES,
    TRANSMIT,
    AccessFailure,
    Drive,
    Heard,
    Overflow,
    Received,
    Refused,
    Senses,
    Sent,
    Transmit,
    Unconfirmed,
)
from actors.runtime import typed_json
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.failure import FailureNote
from actors.runtime.process import FinalNote, RunNote
from actors.runtime.recording import (
    LARGE,
    Entry,
    Note,
    RecordingError,
    RecordingReader,
    decode_note,
    read_notes,
    read_recording,
)
from actors.runtime.replay_bus import topic_of
from actors.topic import Message, Topic
from firmware_bridge.onboard.base_core import BaseReport

FRAME_OUTCOMES: Final[Mapping[type[Any], str]] = {
    Sent: "frames_sent",
    AccessFailure: "frames_access_failure",
    Overflow: "frames_overflowed",
    Refused: "frames_refused",
    Unconfirmed: "frames_unconfirmed",
    Heard: "copies_heard",
}
"""By kind of event, the name under which it is counted; as the radio of a simulated run calls it, too."""


_LATEST_US: Final = 1 << 60
"""36 000 years: beyond what any clock shows, and well within 64 bits."""


class RobotIdentity(msgspec.Struct, frozen=True):
    """The part of a robot's set-up that is needed here, from its first record."""

    id: str
    epoch: int
    address: int
    step_us: int
    places: tuple[tuple[float, float], ...]


class Tick(NamedTuple):
    """Begin of a step by the robot's clock, µs."""

    step: int
    instant: int


class Moment(NamedTuple):
    """An instant by the robot's clock, and the number of the tick at which the robot reported it."""

    tick: int
    instant: int


@dataclass
class SentFrame:
    """A frame that the robot handed to its transceiver."""

    handed: Moment
    data: bytes
    sent: Moment | None = None
    """When the transceiver confirmed it."""


class RecordedMessage(NamedTuple):
    """A message of a robot, and the number of the tick that it answers or follows."""

    tick: int
    key: str
    message: Message


M = TypeVar("M", bound=Message)


@dataclass
class RobotLog:
    """Messages of one recording, as far as it can be read."""

    path: Path
    identity: RobotIdentity
    ticks: list[Tick] = field(default_factory=list)
    messages: list[RecordedMessage] = field(default_factory=list)
    """Answers, frames handed over and radio events."""
    hashed: Counter[type[Message]] = field(default_factory=Counter)
    """Messages of which only the hash is known."""
    final: FinalNote | None = None
    failure: FailureNote | None = None
    damage: str | None = None
    """Why the rest of the file could not be read."""

    def of(self, kind: type[M]) -> Iterator[tuple[int, M]]:
        """Yield the messages of a type, each with its tick."""
        return ((one.tick, one.message) for one in self.messages if isinstance(one.message, kind))

    def sent_frames(self) -> list[SentFrame]:
        """Match the frames handed over with their confirmations."""
        frames: list[SentFrame] = []
        pending: dict[int, SentFrame] = {}
        for tick, _, message in self.messages:
            if isinstance(message, Transmit):
                for outgoing in message.frames:
                    pending[outgoing.tag] = SentFrame(Moment(tick, outgoing.instant), outgoing.data)
                    frames.append(pending[outgoing.tag])
            elif isinstance(message, Received):
                for event in message.events:
                    frame = None if isinstance(event, Heard) else pending.pop(event.tag, None)
                    if frame is not None and isinstance(event, Sent):
                        frame.sent = Moment(tick, event.instant)
        return frames


_TOPICS: Final = (SENSES, RECEIVED, DRIVE, TRANSMIT)


def read_log(path: Path, identity: RobotIdentity, full: Mapping[bytes, bytes]) -> RobotLog:
    """Read a robot's recording up to its end or the first damage.

    `full`: messages that other processes have recorded in full, by their sha256.
    """
    log = RobotLog(path, identity)
    topics = {topic.key(identity.id): topic for topic in _TOPICS}
    try:
        for item in RecordingReader(path, strict=True):
            if isinstance(item, Note):
                _take_note(log, item)
            elif item.key in topics:
                _take_message(log, item, topics[item.key], full)
            else:
                topic_of(item.key)  # refuses keys of no topic
    except RecordingError as error:
        log.damage = str(error)
    except (AcrcError, ValueError) as error:
        log.damage = f"{path}: {error}"
    return log


def _take_note(log: RobotLog, note: Note) -> None:
    if note.name == "final":
        log.final = decode_note(log.path, note.name, note.json, FinalNote)
    elif note.name == "failure":
        log.failure = decode_note(log.path, note.name, note.json, FailureNote)


def _take_message(log: RobotLog, entry: Entry, topic: Topic[Any], full: Mapping[bytes, bytes]) -> None:
    payload = entry.payload if entry.payload is not None else full.get(entry.sha256)
    if payload is None:
        log.hashed[topic.kind] += 1
        return
    message = decode(topic, entry.key, payload)
    for instant in _instants(message):
        if abs(instant) > _LATEST_US:
            raise RecordingError(f"{log.path}: damaged: an instant is {instant} µs, as no clock shows")
    if isinstance(message, Senses):
        log.ticks.append(Tick(message.step, message.instant))
    elif log.ticks:
        log.messages.append(RecordedMessage(len(log.ticks) - 1, entry.key, message))
    else:
        raise RecordingError(f"{log.path}: a message on {entry.key} before the robot's first step")


def _instants(message: Message) -> Iterator[int]:
    match message:
        case Senses():
            yield message.instant
        case Transmit():
            yield from (frame.instant for frame in message.frames)
        case Received():
            yield from (event.instant for event in message.events)


def large_messages(path: Path, least: int) -> dict[bytes, bytes]:
    """The messages of robots above `least` bytes that `path`'s process has received, by their sha256.

    Read as far as the file makes sense.
    """
    found: dict[bytes, bytes] = {}
    prefix = DRIVE.pattern.partition("{id}")[0]
    try:
        for item in read_recording(path):
            if isinstance(item, Note) or item.direction != "in" or not item.key.startswith(prefix):
                continue
            if item.payload is not None and len(item.payload) > least:
                found[hashlib.sha256(item.payload).digest()] = item.payload
    except AcrcError:
        return found  # what it did not say, nobody misses unless a robot's own file has the hash alone
    return found


class FieldTrialError(AcrcError):
    """Folders whose recordings do not make up one field trial."""


class _Base(msgspec.Struct, frozen=True):
    """What the first record of a robot's base says of it."""

    id: str


@dataclass
class FieldTrial:
    """Everything that was read."""

    logs: dict[str, list[RobotLog]]
    """By robot, r2 before r10; each robot's by epoch."""
    lateness_ms: dict[str, Counter[int]]
    """By robot: what its base has counted, over all starts of the base."""
    overruns: Counter[str]
    """By robot: steps that were left out."""
    notes: list[str] = field(default_factory=list)
    """What is wrong with the files, a sentence each."""

    def all_logs(self) -> Iterator[RobotLog]:
        """Every recording of a robot."""
        for logs in self.logs.values():
            yield from logs


def read_field_trial(folders: Sequence[Path]) -> FieldTrial:
    """Read every recording in the folders. Raises FieldTrialError if no robot's is among them.

    A folder is a robot's own, or holds such; with `r2` those of its base and bridge are read, which lie
    beside it as `r2.base` and `r2.radio`.
    """
    trial = FieldTrial({}, {}, Counter())
    own: list[tuple[Path, RobotIdentity]] = []
    others: list[tuple[Path, RunNote]] = []
    for path in _recordings(folders):
        run = _first_record(path, trial.notes)
        if run is None:
            continue
        identity = _identity(run)
        if identity is None:
            others.append((path, run))
        else:
            own.append((path, identity))
    if not own:
        damaged = f"; {trial.notes[0]}" if trial.notes else ""
        raise FieldTrialError(
            f"{', '.join(map(str, folders))}: no robot's recording in there, such as r2.mcap{damaged}"
        )
    _check_twice(own)
    kept: dict[bytes, bytes] = {}
    for path, run in others:
        kept |= large_messages(path, LARGE)
        _take_base(path, run, trial)
    for path, identity in sorted(own, key=lambda one: (natural(one[1].id), one[1].epoch)):
        log = read_log(path, identity, kept)
        trial.logs.setdefault(identity.id, []).append(log)
        trial.notes += _said_of(log)
    trial.notes += _strangers(trial)
    return trial


def natural(robot: str) -> tuple[tuple[int, int, str], ...]:
    """A key to sort ids by: numbers in them by their value."""
    parts = re.findall(r"\d+|\D+", robot)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts)


def _recordings(folders: Iterable[Path]) -> list[Path]:
    """Every recording once, in a fixed order."""
    found: dict[Path, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise FieldTrialError(
                f"{folder}: no such folder; it should be a robot's, or one that holds robots'"
            )
        own = sorted(folder.glob("*.mcap"))
        place = folder.absolute()
        beside = sorted(place.parent.glob(f"{_literal(place.name)}.*/*.mcap")) if own else []
        inside = sorted(folder.glob("*/*.mcap"))
        if not own and not inside:
            raise FieldTrialError(f"{folder}: no recording in it; there should be *.mcap or */*.mcap")
        for path in (*own, *inside, *beside):
            found.setdefault(Path(os.path.realpath(path)), path)
    return list(found.values())


def _literal(name: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", name)


def _first_record(path: Path, notes: list[str]) -> RunNote | None:
    """What a recording begins with; None, and a sentence in `notes`, if that is nothing of ours."""
    try:
        first = next(read_recording(path), None)
    except RecordingError as error:
        notes.append(str(error))
        return None
    if not isinstance(first, Note) or first.name != "run":
        notes.append(f"{path}: ends before its first record, or is no actor's recording; left out")
        return None
    try:
        return decode_note(path, "run", first.json, RunNote)
    except RecordingError as error:
        notes.append(f"{error}; left out")
        return None


def _identity(run: RunNote) -> RobotIdentity | None:
    """Whose recording it is; None if it is no robot's."""
    try:
        return msgspec.json.decode(run.setup, type=RobotIdentity)
    except (ValueError, RecursionError):
        return None


def _check_twice(own: Sequence[tuple[Path, RobotIdentity]]) -> None:
    seen: dict[tuple[str, int], Path] = {}
    for path, identity in own:
        known = seen.setdefault((identity.id, identity.epoch), path)
        if known != path:
            raise FieldTrialError(
                f"{known} and {path}: both are recordings of {identity.id} in epoch {identity.epoch}; "
                "there should be one of each epoch, from one field trial"
            )


def _take_base(path: Path, run: RunNote, trial: FieldTrial) -> None:
    """Add what a robot's base has counted, if it is a base's recording with a last record."""
    if run.actor != "base":
        return
    try:
        robot = typed_json.decode(run.setup, _Base).id
        final = read_notes(path).get("final")
        if final is None:
            trial.notes.append(f"{path}: has no last record, so the lateness that it counted is not known")
            return
        report = typed_json.decode(final, FinalNote).report(BaseReport)
    except (AcrcError, ValueError) as error:
        trial.notes.append(f"{path}: its first or last record is not that of a base: {error}")
        return
    trial.lateness_ms.setdefault(robot, Counter()).update(report.lateness_ms)
    trial.overruns[robot] += report.overruns


def _strangers(trial: FieldTrial) -> Iterator[str]:
    """Whose recordings are missing."""
    known = {log.identity.address for log in trial.all_logs()}
    heard = Counter(
        event.sender
        for log in trial.all_logs()
        for _, received in log.of(Received)
        for event in received.events
        if isinstance(event, Heard)
    )
    for sender in sorted(heard.keys() - known):
        yield (
            f"{heard[sender]} frames were heard of address {sender}, which is no robot's here: what it did "
            "and where it still meant to go is not known"
        )


def _said_of(log: RobotLog) -> Iterator[str]:
    """What is missing in a robot's recording."""
    if log.damage is not None:
        yield f"{log.damage}; what comes before is taken"
    elif log.failure is not None:
        yield f"{log.path}: {log.identity.id} failed in step {log.failure.step}: {log.failure.cause}"
    elif log.final is None:
        until = f"at step {log.ticks[-1].step}" if log.ticks else "before its first step"
        yield f"{log.path}: cut short {until}, without a last record, as by switching off"
    if log.hashed[Drive]:
        yield (
            f"{log.path}: {log.hashed[Drive]} answers are known by their hash only, and so what they say of "
            "places is not; the recording of the base or the world would hold them"
        )
    if log.hashed[Transmit]:
        yield (
            f"{log.path}: the frames of {log.hashed[Transmit]} messages are known by their hash only; the "
            "recording of the bridge or the radio would hold them"
        )
