"""Re-executes one actor from its recording: given the same inputs, its outputs must be the same."""

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
from actors.runtime.recording import Entry, read_recording
from actors.runtime.shell import Shell, run_shell
from actors.topic import Message, Topic


class _Absent:
    """Stands where the shorter of two sequences has ended."""

    def __repr__(self) -> str:
        return "absent"


_ABSENT: Final = _Absent()


class Difference(NamedTuple):
    """A field with two values."""

    field: str
    """Such as `Drive.route[2].place`."""
    one: object
    other: object


def first_difference(one: object, other: object, field: str = "") -> Difference | None:
    """The first field, in the order of the declaration, in which two values differ; None if none does.

    Of sequences that are not equally long it is the first element; what the shorter one lacks is `absent`.
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
"""Characters of a value that a sentence shows."""


class ReplayError(AcrcError):
    """The actor does not do again what it did."""


class RecordingEnds(Exception):  # noqa: N818  # no error: the recorded process was ended here
    """There is no further input in the recording."""


class ReplayBus:
    """Gives the inputs of a recording in their order and compares every output with the recorded one.

    It is the replayed actor's journal, too: so messages that are only recorded are compared as well.
    """

    def __init__(self, path: Path, recall: Callable[[bytes], bytes | None] = lambda sha256: None) -> None:
        """`recall` gives a message by its sha256, where only that was kept; asked for at a difference."""
        entries = [item for item in read_recording(path) if isinstance(item, Entry)]
        self._path = path
        self._recall = recall
        self._inputs = deque(entry for entry in entries if entry.direction == "in")
        self._outputs = deque(entry for entry in entries if entry.direction == "out")
        self.compared = 0

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next recorded input; it must be on `topic`. RecordingEnds after the last one."""
        delivery = self.poll(topic)
        if delivery is not None:
            return delivery
        if not self._inputs:
            raise RecordingEnds
        raise ReplayError(
            f"{self._path}: the actor waits for {topic.pattern} where {self._inputs[0].key} was recorded"
        )

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next recorded input if it is on `topic`."""
        if not self._inputs or topic_of(self._inputs[0].key) is not topic:
            return None
        entry = self._inputs.popleft()
        assert entry.payload is not None
        return Delivery(topic, entry.key, entry.payload)

    def publish(self, key: str, payload: bytes) -> None:
        """Compare with what was recorded; the first difference ends the replay with a sentence."""
        if topic_of(key).is_telemetry:
            return
        if not self._outputs:
            if self._inputs:
                raise ReplayError(f"{self._path}: sends on {key}, where nothing more was recorded")
            return  # the recording was cut while this step was being written
        entry = self._outputs.popleft()
        if (entry.key, entry.sha256) != (key, sha256(payload).digest()):
            raise ReplayError(self._difference(entry, key, payload))
        self.compared += 1

    def received(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Nothing is kept."""

    def sent(self, key: str, step: int, sequence: int, payload: bytes, sha256: bytes | None = None) -> None:
        """Nothing is kept."""

    def computed(self, key: str, step: int, sequence: int, payload: bytes) -> None:
        """Compare with what was recorded."""
        self.publish(key, payload)

    def flush(self) -> None:
        """Nothing is kept."""

    def close(self) -> None:
        """ReplayError if something was recorded that has not been sent again."""
        if self._outputs:
            entry = self._outputs[0]
            raise ReplayError(
                f"{self._path}: step {entry.step}: does not send again what was recorded on {entry.key}"
            )

    def _difference(self, entry: Entry, key: str, payload: bytes) -> str:
        where = f"{self._path}: step {entry.step}"
        if key != entry.key:
            return f"{where}: sends on {key}; recorded was a message on {entry.key}"
        recorded = entry.payload if entry.payload is not None else self._recall(entry.sha256)
        if recorded is None:
            return f"{where}: {key}: sends other bytes than those recorded, of which only the hash is kept"
        topic = topic_of(key)
        found = first_difference(decode(topic, key, payload), decode(topic, key, recorded))
        if found is None:
            return f"{where}: {key}: sends other bytes for the same {topic.kind.__name__}"
        return f"{where}: {key}: {found.field} is {_shown(found.one)}; recorded was {_shown(found.other)}"


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def replay(shell: Shell, bus: ReplayBus) -> None:
    """Drive `shell`, whose outlet must be `bus`, through the whole recording."""
    with contextlib.suppress(RecordingEnds):
        run_shell(shell, bus)
    bus.close()


@functools.lru_cache(maxsize=16_384)
def topic_of(key: str) -> Topic[Message]:
    """The topic that `key` belongs to."""
    for topic in TOPICS:
        prefix, hole, suffix = topic.pattern.partition("{id}")
        if key == topic.pattern or (hole and key.startswith(prefix) and key.endswith(suffix)):
            return topic
    raise ReplayError(f"{key[:80]!r}: no key of this project")
