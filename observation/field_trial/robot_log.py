"""What one recording of one robot tells: its steps, its word on places, and what went over its radio."""

import hashlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from actors.messages import (
    DRIVE,
    RECEIVED,
    SENSES,
    TRANSMIT,
    AccessFailure,
    Drive,
    Heard,
    Outgoing,
    Overflow,
    RadioEvent,
    Received,
    Refused,
    Senses,
    Sent,
    Transmit,
    Unconfirmed,
)
from actors.runtime.bus.replay_bus import topic_of
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle.failure import FailureNote
from actors.runtime.process import FinalNote
from actors.runtime.recording import Entry, Note, Reading, RecordingError, decoded, read_recording
from actors.topic import Message

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
    """What a robot's first record says of it, as far as it is needed here."""

    id: str
    epoch: int
    address: int
    step_us: int
    places: tuple[tuple[float, float], ...]


class Tick(NamedTuple):
    """The beginning of a step, as the robot was told."""

    step: int
    instant: int


class Moment(NamedTuple):
    """An instant by the robot's clock, and the number of the tick at which the robot said or heard it."""

    tick: int
    instant: int


@dataclass
class SentFrame:
    """A frame that the robot handed to its transceiver."""

    handed: Moment
    data: bytes
    sent: Moment | None = None
    """When its transceiver said that it had left."""


class HeardFrame(NamedTuple):
    """A frame that the robot's transceiver received."""

    heard: Moment
    sender: int
    data: bytes


@dataclass
class RobotLog:
    """One recording, as far as it can be read."""

    path: Path
    identity: RobotIdentity
    ticks: list[Tick] = field(default_factory=list)
    drives: list[tuple[int, Drive]] = field(default_factory=list)
    """With the number of the tick that each answers."""
    sent: list[SentFrame] = field(default_factory=list)
    heard: list[HeardFrame] = field(default_factory=list)
    newest: list[Moment] = field(default_factory=list)
    """The last event of each message from the transceiver."""
    events: Counter[str] = field(default_factory=Counter)
    """Events from the transceiver by their names in FRAME_OUTCOMES."""
    frames_handed: int = 0
    """Frames that its answers count."""
    hashed_drives: int = 0
    """Answers of which only the hash is known."""
    hashed_transmits: int = 0
    """Messages with frames of which only the hash is known."""
    final: FinalNote | None = None
    failure: FailureNote | None = None
    damage: str | None = None
    """Why the rest of the file could not be read."""


def read_log(path: Path, identity: RobotIdentity, kept: Mapping[bytes, bytes]) -> RobotLog:
    """Read a robot's recording up to its end, or as far as it makes sense.

    `kept`: messages that others have recorded in full, by their sha256.
    """
    reader = _Reader(RobotLog(path, identity), kept)
    try:
        for item in Reading(path, strict=True):
            reader.take(item)
    except RecordingError as error:
        reader.log.damage = str(error)
    except (AcrcError, ValueError) as error:
        reader.log.damage = f"{path}: {error}"
    return reader.log


class _Reader:
    """Takes in a recording item by item."""

    def __init__(self, log: RobotLog, kept: Mapping[bytes, bytes]) -> None:
        self.log = log
        self._kept = kept
        self._under_way: dict[int, SentFrame] = {}
        robot = log.identity.id
        self._topics = {topic.key(robot): topic for topic in (SENSES, RECEIVED, DRIVE, TRANSMIT)}

    def take(self, item: Entry | Note) -> None:
        """Take in one item."""
        if isinstance(item, Note):
            if item.name == "final":
                self.log.final = decoded(self.log.path, item.name, item.json, FinalNote)
            elif item.name == "failure":
                self.log.failure = decoded(self.log.path, item.name, item.json, FailureNote)
        elif item.key in self._topics:
            self._message(item)
        else:
            topic_of(item.key)  # another one of this project's, such as Ready

    def _message(self, entry: Entry) -> None:
        log = self.log
        payload = entry.payload if entry.payload is not None else self._kept.get(entry.sha256)
        topic = self._topics[entry.key]
        if payload is None:
            log.hashed_drives += topic.kind is Drive
            log.hashed_transmits += topic.kind is Transmit
            return
        message: Message = decode(topic, entry.key, payload)  # type: ignore[arg-type]
        if isinstance(message, Senses):
            log.ticks.append(Tick(message.step, self._checked(message.instant)))
        elif log.ticks:
            self._within_step(message)
        else:
            raise RecordingError(f"{log.path}: a message on {entry.key} before the robot's first step")

    def _within_step(self, message: Message) -> None:
        log = self.log
        match message:
            case Drive():
                log.drives.append((self._tick, message))
                log.frames_handed += message.transmits
            case Transmit():
                for frame in message.frames:
                    self._hand(frame)
            case Received():
                for event in message.events:
                    self._event(event)
                newest = max((event.instant for event in message.events), default=None)
                log.newest += [] if newest is None else [Moment(self._tick, newest)]

    @property
    def _tick(self) -> int:
        return len(self.log.ticks) - 1

    def _checked(self, instant: int) -> int:
        if abs(instant) > _LATEST_US:
            raise RecordingError(f"{self.log.path}: damaged: an instant is {instant} µs, as no clock shows")
        return instant

    def _hand(self, frame: Outgoing) -> None:
        sent = SentFrame(Moment(self._tick, self._checked(frame.instant)), frame.data)
        self.log.sent.append(sent)
        self._under_way[frame.tag] = sent

    def _event(self, event: RadioEvent) -> None:
        log = self.log
        log.events[FRAME_OUTCOMES[type(event)]] += 1
        moment = Moment(self._tick, self._checked(event.instant))
        if isinstance(event, Heard):
            log.heard.append(HeardFrame(moment, event.sender, event.data))
            return
        frame = self._under_way.pop(event.tag, None)
        if frame is not None and isinstance(event, Sent):
            frame.sent = moment


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
