"""Recordings of a field trial: files, robots and messages."""

import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
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
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    RadioEvents,
    SensorData,
    Transmit,
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
from actors.task.loading import DEFAULT
from actors.task.task import TaskDeclaration
from actors.topic import Message, Topic
from firmware_bridge.onboard.base_core import BaseReport

EVENT_COUNTERS: Final[Mapping[type[Any], str]] = {
    FrameSent: "frames_sent",
    AccessFailure: "frames_access_failure",
    FrameOverflow: "frames_overflowed",
    FrameRefused: "frames_refused",
    FrameUnconfirmed: "frames_unconfirmed",
    FrameReceived: "copies_heard",
}
"""Counter of each kind of event, named as in simulated runs."""


_LATEST_US: Final = 1 << 60
"""Upper limit of plausible instants, µs: 36 000 years, well within 64 bits."""


class RobotIdentity(msgspec.Struct, frozen=True):
    """Part of a robot's set-up, from the first record of its recording."""

    id: str
    epoch: int
    address: int
    step_us: int
    items: tuple[Any, ...] = ()


class Tick(NamedTuple):
    """A step and its beginning by the robot's clock, µs."""

    step: int
    instant: int


class Moment(NamedTuple):
    """An instant by the robot's clock, and the index of the tick in which it was reported."""

    tick: int
    instant: int


@dataclass
class SentFrame:
    """A frame handed to the robot's transceiver."""

    handed: Moment
    data: bytes
    sent: Moment | None = None
    """Confirmation of the transmission; None: not confirmed."""


class RecordedMessage(NamedTuple):
    """A message of a robot, and the index of the tick that it answers or follows."""

    tick: int
    key: str
    message: Message


M = TypeVar("M", bound=Message)


@dataclass
class RobotLog:
    """Messages of one recording, up to its end or first damage."""

    path: Path
    identity: RobotIdentity
    ticks: list[Tick] = field(default_factory=list)
    messages: list[RecordedMessage] = field(default_factory=list)
    """Answers, transmitted frames and radio events."""
    senses: list[SensorData] | None = None
    """Sensor data of each tick; None: not asked for."""
    hashed: Counter[type[Message]] = field(default_factory=Counter)
    """Counts of messages recorded as a hash only."""
    final: FinalNote | None = None
    failure: FailureNote | None = None
    damage: str | None = None
    """Reason why the rest of the file cannot be read; None: complete."""

    def messages_of(self, kind: type[M]) -> Iterator[tuple[int, M]]:
        """Yield the messages of a type with their ticks."""
        return ((one.tick, one.message) for one in self.messages if isinstance(one.message, kind))

    def received_frames(self) -> Iterator[tuple[int, FrameReceived]]:
        """Yield the frames received with their ticks."""
        for tick, received in self.messages_of(RadioEvents):
            yield from ((tick, event) for event in received.events if isinstance(event, FrameReceived))

    def sent_frames(self) -> list[SentFrame]:
        """Return all frames handed to the transceiver with their confirmations."""
        frames: list[SentFrame] = []
        pending: dict[int, SentFrame] = {}
        for tick, _, message in self.messages:
            if isinstance(message, Transmit):
                for outgoing in message.frames:
                    pending[outgoing.tag] = SentFrame(Moment(tick, outgoing.instant), outgoing.data)
                    frames.append(pending[outgoing.tag])
            elif isinstance(message, RadioEvents):
                for event in message.events:
                    frame = None if isinstance(event, FrameReceived) else pending.pop(event.tag, None)
                    if frame is not None and isinstance(event, FrameSent):
                        frame.sent = Moment(tick, event.instant)
        return frames


_TOPICS: Final = (SENSES, RECEIVED, DRIVE, TRANSMIT)


def read_log(path: Path, identity: RobotIdentity, full: Mapping[bytes, bytes], *, senses: bool) -> RobotLog:
    """Read a robot's recording up to its end or the first damage.

    `full`: messages that other processes recorded in full, by SHA-256; `senses`: keep the sensor data.
    """
    log = RobotLog(path, identity, senses=[] if senses else None)
    topics = {topic.key(identity.id): topic for topic in _TOPICS}
    try:
        for item in RecordingReader(path, strict=True):
            if isinstance(item, Note):
                _add_note(log, item)
            elif item.key in topics:
                _add_message(log, item, topics[item.key], full)
            else:
                topic_of(item.key)  # raises for keys of no topic
    except RecordingError as error:
        log.damage = str(error)
    except (AcrcError, ValueError) as error:
        log.damage = f"{path}: {error}"
    return log


def _add_note(log: RobotLog, note: Note) -> None:
    if note.name == "final":
        log.final = decode_note(log.path, note.name, note.json, FinalNote)
    elif note.name == "failure":
        log.failure = decode_note(log.path, note.name, note.json, FailureNote)


def _add_message(log: RobotLog, entry: Entry, topic: Topic[Any], full: Mapping[bytes, bytes]) -> None:
    payload = entry.payload if entry.payload is not None else full.get(entry.sha256)
    if payload is None:
        log.hashed[topic.kind] += 1
        return
    message = decode(topic, entry.key, payload)
    for instant in _instants(message):
        if abs(instant) > _LATEST_US:
            raise RecordingError(f"{log.path}: damaged: implausible instant {instant} µs")
    if isinstance(message, SensorData):
        log.ticks.append(Tick(message.step, message.instant))
        if log.senses is not None:
            log.senses.append(message)
    elif log.ticks:
        log.messages.append(RecordedMessage(len(log.ticks) - 1, entry.key, message))
    else:
        raise RecordingError(f"{log.path}: message on {entry.key} before the robot's first step")


def _instants(message: Message) -> Iterator[int]:
    match message:
        case SensorData():
            yield message.instant
        case Transmit():
            yield from (frame.instant for frame in message.frames)
        case RadioEvents():
            yield from (event.instant for event in message.events)


def large_messages(path: Path) -> dict[bytes, bytes]:
    """Return the robots' messages above LARGE bytes that the recording's process received, by SHA-256.

    Stops at damage.
    """
    messages: dict[bytes, bytes] = {}
    prefix = DRIVE.pattern.partition("{id}")[0]
    try:
        for item in read_recording(path):
            if isinstance(item, Note) or item.direction != "in" or not item.key.startswith(prefix):
                continue
            if item.payload is not None and len(item.payload) > LARGE:
                messages[hashlib.sha256(item.payload).digest()] = item.payload
    except AcrcError:
        return messages  # missing messages matter, and are noted, only if a robot recorded their hash alone
    return messages


class FieldTrialError(AcrcError):
    """Recordings that are not those of one field trial."""


class RecordedTask(msgspec.Struct, frozen=True):
    """Task of a field trial, as far as recordings name it; its code is never loaded from their folder."""

    use: str = DEFAULT
    """Name, or entry `module:Class`."""
    settings: dict[str, Any] = {}
    declaration: TaskDeclaration | None = None


UNNAMED_TASK: Final = RecordedTask()
"""Task of recordings that name none."""


class _BaseSetup(msgspec.Struct, frozen=True):
    """Part of the set-up in the recording of a robot's base; a world's has a task, too."""

    id: str = ""
    task: RecordedTask | None = None


class _LinkReport(msgspec.Struct, frozen=True):
    """Parts of the set-up and of the outcome in the recording of a robot's bridge."""

    robot: str = ""
    keys: str | None = None
    round_trips_ms: dict[int, int] = {}


@dataclass
class FieldTrial:
    """Recordings of a field trial."""

    logs: dict[str, list[RobotLog]]
    """By robot in natural order (r2 before r10), then by epoch."""
    lateness_ms: dict[str, Counter[int]]
    """Histogram of lateness by robot, over all starts of its base."""
    overruns: Counter[str]
    """Skipped steps by robot."""
    task: RecordedTask = UNNAMED_TASK
    """From the set-up of a base, or of a world."""
    round_trips_ms: dict[str, Counter[int]] = field(default_factory=dict)
    """Histogram of round trips to the simulated medium, by robot without a board."""
    notes: list[str] = field(default_factory=list)
    """Faults of the files, a sentence each."""

    def all_logs(self) -> Iterator[RobotLog]:
        """Yield all recordings of robots."""
        for logs in self.logs.values():
            yield from logs


def read_field_trial(folders: Sequence[Path], *, senses: bool = False) -> FieldTrial:
    """Read all recordings in the folders; `senses`: keep the sensor data. Raises FieldTrialError without one
    of a robot.

    A folder is a robot's or contains robots' folders; with `r2`, its siblings `r2.base` and `r2.radio` are
    read, too.
    """
    trial = FieldTrial({}, {}, Counter())
    robots: list[tuple[Path, RobotIdentity]] = []
    other_recordings: list[tuple[Path, RunNote]] = []
    for path in _recordings(folders):
        run = _first_record(path, trial.notes)
        if run is None:
            continue
        identity = _identity(run)
        if identity is None:
            other_recordings.append((path, run))
        else:
            robots.append((path, identity))
    if not robots:
        damaged = f"; {trial.notes[0]}" if trial.notes else ""
        raise FieldTrialError(
            f"{', '.join(map(str, folders))}: no recording of a robot, such as r2.mcap{damaged}"
        )
    _check_unique(robots)
    trial.task = _recorded_task(other_recordings)
    full_messages: dict[bytes, bytes] = {}
    for path, run in other_recordings:
        full_messages |= large_messages(path)
        _add_base_counters(path, run, trial)
        _add_link_counters(path, run, trial)
    if trial.round_trips_ms:
        trial.notes.append(
            f"{', '.join(sorted(trial.round_trips_ms))}: the radio was simulated over a network; range, loss "
            "and air time are those of the model at the robots' estimated positions, not those of the room"
        )
    for path, identity in sorted(robots, key=lambda one: (natural_key(one[1].id), one[1].epoch)):
        log = read_log(path, identity, full_messages, senses=senses)
        trial.logs.setdefault(identity.id, []).append(log)
        trial.notes += _gap_sentences(log)
    trial.notes += _unknown_sender_sentences(trial)
    return trial


def natural_key(robot: str) -> tuple[tuple[int, int, str], ...]:
    """Return a sort key of robot ids that orders numbers by value."""
    parts = re.findall(r"\d+|\D+", robot)
    return tuple((0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts)


def _recordings(folders: Iterable[Path]) -> list[Path]:
    """Return every recording once, in a fixed order."""
    recordings: dict[Path, Path] = {}
    for folder in folders:
        if not folder.is_dir():
            raise FieldTrialError(
                f"{folder}: no such folder; give a robot's folder or one that contains robots' folders"
            )
        own = sorted(folder.glob("*.mcap"))
        resolved = folder.absolute()
        siblings = sorted(resolved.parent.glob(f"{glob.escape(resolved.name)}.*/*.mcap")) if own else []
        inside = sorted(folder.glob("*/*.mcap"))
        if not own and not inside:
            raise FieldTrialError(f"{folder}: no recordings (*.mcap or */*.mcap)")
        for path in (*own, *inside, *siblings):
            recordings.setdefault(Path(os.path.realpath(path)), path)
    return list(recordings.values())


def _first_record(path: Path, notes: list[str]) -> RunNote | None:
    """Return the run note of a recording; None, with a sentence in `notes`, if there is none."""
    try:
        first = next(read_recording(path), None)
    except RecordingError as error:
        notes.append(str(error))
        return None
    if not isinstance(first, Note) or first.name != "run":
        notes.append(f"{path}: empty or not an actor's recording; skipped")
        return None
    try:
        return decode_note(path, "run", first.json, RunNote)
    except RecordingError as error:
        notes.append(f"{error}; skipped")
        return None


def _identity(run: RunNote) -> RobotIdentity | None:
    """Return the robot of a recording; None if it is another actor's."""
    try:
        return msgspec.json.decode(run.setup, type=RobotIdentity)
    except (ValueError, RecursionError):
        return None


def _check_unique(robots: Sequence[tuple[Path, RobotIdentity]]) -> None:
    seen: dict[tuple[str, int], Path] = {}
    for path, identity in robots:
        first = seen.setdefault((identity.id, identity.epoch), path)
        if first != path:
            raise FieldTrialError(
                f"{first} and {path}: two recordings of {identity.id} in epoch {identity.epoch}; "
                "give one of each epoch, from one field trial"
            )


def _recorded_task(recordings: Sequence[tuple[Path, RunNote]]) -> RecordedTask:
    """Return the task of a field trial. Raises FieldTrialError if recordings name different ones."""
    found: dict[str, tuple[Path, RecordedTask]] = {}
    for path, run in recordings:
        with suppress(ValueError, RecursionError):
            if task := msgspec.json.decode(run.setup, type=_BaseSetup).task:
                found.setdefault(task.use, (path, task))
    if len(found) > 1:
        (first, one), (second, other) = list(found.values())[:2]
        raise FieldTrialError(
            f"{first} and {second}: recordings of the tasks {one.use!r} and {other.use!r}; "
            "the recordings must be of one field trial"
        )
    return next((task for _, task in found.values()), UNNAMED_TASK)


def _add_base_counters(path: Path, run: RunNote, trial: FieldTrial) -> None:
    """Add the counters of a robot's base, if this is a base's recording with a final record."""
    if run.actor != "base":
        return
    try:
        robot = typed_json.decode(run.setup, _BaseSetup).id
        final = read_notes(path).get("final")
        if final is None:
            trial.notes.append(f"{path}: no final record, so lateness is unknown")
            return
        report = typed_json.decode(final, FinalNote).report(BaseReport)
    except (AcrcError, ValueError) as error:
        trial.notes.append(f"{path}: first or final record is not that of a base: {error}")
        return
    trial.lateness_ms.setdefault(robot, Counter()).update(report.lateness_ms)
    trial.overruns[robot] += report.overruns


def _add_link_counters(path: Path, run: RunNote, trial: FieldTrial) -> None:
    """Add the round trips of a robot without a board, if this is its bridge's recording."""
    with suppress(AcrcError, ValueError):
        bridge = typed_json.decode(run.setup, _LinkReport)
        if bridge.robot and bridge.keys is not None:
            counts = trial.round_trips_ms.setdefault(bridge.robot, Counter())
            final = typed_json.decode(read_notes(path).get("final", ""), FinalNote)
            counts.update(final.report(_LinkReport).round_trips_ms)


def _unknown_sender_sentences(trial: FieldTrial) -> Iterator[str]:
    """Yield a sentence for each sender without a recording."""
    known = {log.identity.address for log in trial.all_logs()}
    heard = Counter(event.sender for log in trial.all_logs() for _, event in log.received_frames())
    for sender in sorted(heard.keys() - known):
        yield (
            f"{heard[sender]} frames were received from address {sender}, of which there is no recording; "
            "its reports and route are unknown"
        )


def _gap_sentences(log: RobotLog) -> Iterator[str]:
    """Yield a sentence for each gap in a robot's recording."""
    if log.damage is not None:
        yield f"{log.damage}; used up to there"
    elif log.failure is not None:
        yield f"{log.path}: {log.identity.id} failed in step {log.failure.step}: {log.failure.cause}"
    elif log.final is None:
        until = f"at step {log.ticks[-1].step}" if log.ticks else "before its first step"
        yield f"{log.path}: truncated {until}: no final record, as after a power-off"
    if log.hashed[Drive]:
        yield (
            f"{log.path}: {log.hashed[Drive]} answers are recorded as hashes only, so their reports are "
            "unknown; add the recording of the base or the world"
        )
    if log.hashed[Transmit]:
        yield (
            f"{log.path}: the frames of {log.hashed[Transmit]} messages are recorded as hashes only; add the "
            "recording of the bridge or the radio"
        )
