"""What one process's recording holds: messages of one kind that it took in, and its last words by subject."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeVar, cast

import msgspec

from actors.runtime.codec import decode
from actors.runtime.process import FinalNote
from actors.runtime.recording import Direction, Note, decoded, read_notes, read_recording
from actors.topic import M, Message, Topic
from observation.results.outcome import told

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
