"""Replay of one actor from its recording: equal inputs must give equal outputs."""

import contextlib
import functools
from collections import deque
from collections.abc import Callable, Sequence
from hashlib import sha256
from itertools import zip_longest
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from actors.messages import TOPICS
from actors.runtime.codec import decode
from actors.runtime.core import Delivery
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Entry, NullJournal, read_recording
from actors.runtime.shell import Shell, run_shell
from actors.topic import Message, Topic


class _Placeholder:
    """Placeholder beyond the end of the shorter sequence."""

    def __repr__(self) -> str:
        return "absent"


_ABSENT: Final = _Placeholder()


class Difference(NamedTuple):
    """A field with two different values."""

    field: str
    """Path such as `Drive.route[2].number`."""
    one: object
    other: object


def first_difference(one: object, other: object, field: str = "") -> Difference | None:
    """Return the first field, in declaration order, in which two values differ; None: equal values.

    For sequences of different lengths, return the first different element; missing elements are `absent`.
    """
    field = field or type(one).__name__
    if isinstance(one, msgspec.Struct) and type(one) is type(other):
        parts = [
            (f"{field}.{name}", getattr(one, name), getattr(other, name)) for name in one.__struct_fields__
        ]
    elif isinstance(one, Sequence) and isinstance(other, Sequence) and not isinstance(one, str | bytes):
        pairs = list(zip_longest(one, other, fillvalue=_ABSENT))
        if len(one) != len(other):
            index = next(index for index, (a, b) in enumerate(pairs) if repr(a) != repr(b))
            return Difference(f"{field}[{index}]", *pairs[index])
        parts = [(f"{field}[{index}]", *pair) for index, pair in enumerate(pairs)]
    else:
        return None if repr(one) == repr(other) else Difference(field, one, other)  # -0.0 is not 0.0
    return next((found for name, a, b in parts if (found := first_difference(a, b, name))), None)


_LONGEST: Final = 200
"""Most characters of a value in a message."""


class ReplayError(AcrcError):
    """The replayed actor's outputs differ from its recording."""


class EndOfRecording(Exception):  # noqa: N818  # not an error: the recorded process ended here
    """The recording has no further input."""


class ReplayBus(NullJournal):
    """Bus that replays a recording's inputs in order and compares every output with the recorded one.

    It is also the replayed actor's journal, to compare messages that are only recorded.
    """

    def __init__(self, path: Path, recall: Callable[[bytes], bytes | None] = lambda sha256: None) -> None:
        """`recall`: return a message by SHA-256, or None; for differences where only the hash is recorded."""
        entries = [item for item in read_recording(path) if isinstance(item, Entry)]
        self._path = path
        self._recall = recall
        self._inputs = deque(entry for entry in entries if entry.direction == "in")
        self._outputs = deque(entry for entry in entries if entry.direction == "out")
        self.compared = 0

    def receive(self, topic: Topic[Message]) -> Delivery:
        """Return the next recorded input, which must be on `topic`. Raises EndOfRecording at the end."""
        delivery = self.poll(topic)
        if delivery is not None:
            return delivery
        if not self._inputs:
            raise EndOfRecording
        raise ReplayError(
            f"{self._path}: the actor waits for {topic.pattern}, but the next recorded input is on "
            f"{self._inputs[0].key}"
        )

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """Return the next recorded input if it is on `topic`."""
        if not self._inputs or topic_of(self._inputs[0].key) is not topic:
            return None
        entry = self._inputs.popleft()
        assert entry.payload is not None
        return Delivery(topic, entry.key, entry.payload)

    def publish(self, key: str, payload: bytes) -> None:
        """Compare an output with the recorded one. Raises ReplayError at a difference."""
        if topic_of(key).is_telemetry:
            return
        if not self._outputs:
            if self._inputs:
                raise ReplayError(f"{self._path}: sends on {key}, but the recording has no further output")
            return  # the recording is truncated in this step
        entry = self._outputs.popleft()
        if (entry.key, entry.sha256) != (key, sha256(payload).digest()):
            raise ReplayError(self._difference(entry, key, payload))
        self.compared += 1

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Compare with the recorded message."""
        self.publish(key, payload)

    def close(self) -> None:
        """Raise ReplayError if recorded outputs are left."""
        if self._outputs:
            entry = self._outputs[0]
            raise ReplayError(
                f"{self._path}: step {entry.step}: does not send the recorded message on {entry.key}"
            )

    def _difference(self, entry: Entry, key: str, payload: bytes) -> str:
        where = f"{self._path}: step {entry.step}"
        if key != entry.key:
            return f"{where}: sends on {key}, recorded was {entry.key}"
        recorded = entry.payload if entry.payload is not None else self._recall(entry.sha256)
        if recorded is None:
            return f"{where}: {key}: sends a different message (only a hash was recorded)"
        topic = topic_of(key)
        found = first_difference(decode(topic, key, payload), decode(topic, key, recorded))
        if found is None:
            return f"{where}: {key}: sends different bytes for an equal {topic.kind.__name__}"
        return f"{where}: {key}: {found.field} is {_shown(found.one)}, recorded was {_shown(found.other)}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def replay(shell: Shell, bus: ReplayBus) -> None:
    """Run `shell`, whose outlet must be `bus`, through the whole recording."""
    with contextlib.suppress(EndOfRecording):
        run_shell(shell, bus)
    bus.close()


@functools.lru_cache(maxsize=16_384)
def topic_of(key: str) -> Topic[Message]:
    """Return the topic of `key`. Raises ReplayError."""
    for topic in TOPICS:
        prefix, hole, suffix = topic.pattern.partition("{id}")
        if key == topic.pattern or (hole and key.startswith(prefix) and key.endswith(suffix)):
            return topic
    raise ReplayError(f"{key[:80]!r}: not a key of this project")
