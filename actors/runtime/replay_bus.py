"""Re-executes one actor from its recording: given the same inputs, its outputs must be the same."""

from collections import deque
from hashlib import sha256
from pathlib import Path

from actors.messages import TOPICS, Message, Topic
from actors.runtime.bus import Delivery
from actors.runtime.codec import decode
from actors.runtime.errors import AcrcError
from actors.runtime.recording import Entry, read_recording
from actors.runtime.shell import Shell
from actors.runtime.tally import is_telemetry


class ReplayError(AcrcError):
    """The actor does not do again what it did."""


class ReplayBus:
    """Gives the inputs of a recording in their order and compares every output with the recorded one."""

    def __init__(self, path: Path) -> None:
        entries = [item for item in read_recording(path) if isinstance(item, Entry)]
        self._path = path
        self._inputs = deque(entry for entry in entries if entry.direction == "in")
        self._outputs = deque(entry for entry in entries if entry.direction == "out")
        self.compared = 0

    @property
    def exhausted(self) -> bool:
        """True once every recorded input has been given."""
        return not self._inputs

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next recorded input; it must be on `topic`."""
        delivery = self.poll(topic)
        if delivery is None:
            found = self._inputs[0].key if self._inputs else "the end of the recording"
            raise ReplayError(f"{self._path}: the actor waits for {topic.pattern} where {found} was recorded")
        return delivery

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next recorded input if it is on `topic`."""
        if not self._inputs or topic_of(self._inputs[0].key) is not topic:
            return None
        entry = self._inputs.popleft()
        assert entry.payload is not None
        return Delivery(topic, entry.key, entry.payload)

    def publish(self, key: str, payload: bytes) -> None:
        """Compare with what was recorded; the first difference ends the replay with a sentence."""
        if is_telemetry(topic_of(key)):
            return
        if not self._outputs:
            if self._inputs:
                raise ReplayError(f"{self._path}: sends on {key}, where nothing more was recorded")
            return  # the recording was cut while this step was being written
        entry = self._outputs.popleft()
        if (entry.key, entry.sha256) != (key, sha256(payload).digest()):
            raise ReplayError(self._difference(entry, key, payload))
        self.compared += 1

    def _difference(self, entry: Entry, key: str, payload: bytes) -> str:
        now = decode(topic_of(key), key, payload)
        then = (
            decode(topic_of(entry.key), entry.key, entry.payload)
            if entry.payload is not None
            else f"other bytes on {entry.key} (only their hash is kept)"
        )
        return f"{self._path}: step {entry.step}: sends {now} on {key}; recorded was {then}"


def replay(shell: Shell, bus: ReplayBus) -> None:
    """Drive `shell`, whose outlet must be `bus`, through the whole recording."""
    while not shell.finished:
        for address in shell.open_to():
            delivery = bus.poll(address.topic)
            if delivery is not None:
                shell.deliver(delivery)
        awaited = shell.pump()
        if awaited is not None:
            if bus.exhausted:
                return  # the recorded process was ended here
            shell.deliver(bus.receive(awaited.topic))


def topic_of(key: str) -> Topic[Message]:
    """The topic that `key` belongs to."""
    for topic in TOPICS:
        prefix, hole, suffix = topic.pattern.partition("{id}")
        if key == topic.pattern or (hole and key.startswith(prefix) and key.endswith(suffix)):
            return topic
    raise ReplayError(f"{key}: no key of this project")
