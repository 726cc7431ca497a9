"""Messages and last records of one recording; decisions and places that robots reported."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final, NamedTuple, TypeVar, cast

import msgspec

from actors.instant import in_seconds
from actors.messages import Drive
from actors.runtime.codec import decode
from actors.runtime.process import FinalNote
from actors.runtime.recording import Direction, Note, decoded, read_notes, read_recording
from actors.task.words import PlaceKey
from actors.topic import M, Message, Topic
from observation.results.outcome import MOST_LISTED, Count, Metres, Name, Words, told

_SUBJECT: Final = "adaptation"


class SaidDecision(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A decision of a robot's adaptation, as it has told it; instants and ages in µs."""

    instant: Count
    by: Name
    words: Words
    source: Name
    age: Count
    old: tuple[Metres, Metres] | None
    new: tuple[Metres, Metres] | None


class SaidAdaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All that one process said; instants in µs."""

    decisions: Annotated[tuple[SaidDecision, ...], msgspec.Meta(max_length=MOST_LISTED)]
    decisions_unlisted: Count
    blocked: Annotated[tuple[tuple[Count, Count | None], ...], msgspec.Meta(max_length=MOST_LISTED)] | None
    """Spells in which it held itself to be blocked; None if it never asks."""


def adaptation(record: Path, outcome: Mapping[str, msgspec.Raw]) -> SaidAdaptation | None:
    """What a process's last record says on it; None if nothing. Raises OutcomeError."""
    return told(record, outcome, _SUBJECT, SaidAdaptation, "a robot's adaptation")


class Deed(NamedTuple):
    """Something that a robot said of a place."""

    robot: str
    second: float
    place: PlaceKey


class Route(NamedTuple):
    """What a robot means to visit from an instant on."""

    robot: str
    second: float
    places: tuple[PlaceKey, ...]


class SaidPlaces:
    """Takes in words of robots; silence means: as before, and before the first word, its own places."""

    def __init__(self, places: Mapping[str, int], step_us: int) -> None:
        """`places`: how many each robot has to clean at first."""
        self._step_us = step_us
        self._held = {robot: {PlaceKey(robot, n) for n in range(count)} for robot, count in places.items()}
        self.reported: list[Deed] = []
        self.taken_over: list[Deed] = []
        self.given_up: list[Deed] = []
        self.routes: list[Route] = []

    def left(self, robot: str) -> int:
        """How many places it means to visit now."""
        return len(self._held.get(robot, ()))

    def take(self, robot: str, drive: Drive) -> None:
        """The robot's word of one step."""
        for report in drive.reports:
            key = PlaceKey(report.owner, report.place)
            self.reported.append(Deed(robot, in_seconds(report.instant), key))
        for gone in drive.given_up:
            key = PlaceKey(gone.owner, gone.place)
            self.given_up.append(Deed(robot, in_seconds(gone.instant), key))
        if drive.route is not None:
            before, now = self._held.get(robot, set()), in_seconds(drive.step * self._step_us)
            self.routes.append(Route(robot, now, drive.route))
            for key in drive.route:
                if key not in before and key.owner != robot:
                    self.taken_over.append(Deed(robot, now, key))
            self._held[robot] = set(drive.route)

    def forget(self) -> None:
        """Begin new lists; what each means to visit stays."""
        self.reported, self.taken_over, self.given_up, self.routes = [], [], [], []


T = TypeVar("T")


def taken(path: Path, topic: Topic[M], direction: Direction = "in") -> Iterator[tuple[str, M]]:
    """Yield the messages of a topic that the process received, each with the robot in its key, or "".

    `direction`: "out" for the messages that it sent.

    Raises RecordingError for a damaged file, WireError for a message that is none of the topic.
    """
    prefix, hole, suffix = topic.pattern.partition("{id}")
    for item in read_recording(path):
        if isinstance(item, Note) or item.direction != direction or item.payload is None:
            continue
        if item.key.startswith(prefix) and item.key.endswith(suffix):
            message = decode(cast(Topic[Message], topic), item.key, item.payload)
            assert isinstance(message, topic.kind)
            yield item.key[len(prefix) : len(item.key) - len(suffix)] if hole else "", message


def outcomes(path: Path) -> Mapping[str, msgspec.Raw]:
    """What the process's last record says, by subject; empty if it left none. Raises RecordingError."""
    text = read_notes(path).get("final")
    return {} if text is None else decoded(path, "final", text, FinalNote).outcome


def outcome(path: Path, subject: str, kind: type[T], whose: str) -> T | None:
    """What it says on one subject; None if nothing. `whose`: as in `told`. Raises OutcomeError, too."""
    return told(path, outcomes(path), subject, kind, whose)
