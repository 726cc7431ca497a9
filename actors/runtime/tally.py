"""What one process sent and received: the counts, and the hash that the run's digest is made of."""

import hashlib
from collections import defaultdict
from typing import Final

import msgspec

from actors.messages import AIRED, CONTROL, DRIVE, PROGRESS, RECEIVED, ROSTER, SENSES, TRANSMIT, TRUTH
from actors.topic import Message, Topic

_DIGESTED: Final = frozenset(
    topic.pattern for topic in (SENSES, RECEIVED, DRIVE, TRANSMIT, TRUTH, AIRED, CONTROL, ROSTER)
)


def is_telemetry(topic: Topic[Message]) -> bool:
    """True for what is only shown to people: neither counted, nor recorded, nor in the digest."""
    return topic.pattern == PROGRESS.pattern


def is_from_outside(topic: Topic[Message]) -> bool:
    """True for what no actor publishes, and so cannot be balanced against what was received."""
    return topic.pattern == CONTROL.pattern


def is_digested(pattern: str) -> bool:
    """True for the topics whose messages make up the run's digest."""
    return pattern in _DIGESTED


class ActorDigest(msgspec.Struct, frozen=True):
    """The messages that one process sent on the digested topics: how many, and their hash in order."""

    actor: str
    count: int
    sha256: str


class MessageHash:
    """A running hash over (key, step, sequence, encoded bytes)."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.count = 0

    def add(self, key: str, step: int, sequence: int, payload_sha256: bytes) -> None:
        """Take in one message; its bytes come as their own hash, so that a recording may hold just that."""
        self._hash.update(b"%b\0%d\0%d\0%b" % (key.encode(), step, sequence, payload_sha256))
        self.count += 1

    def digest(self, actor: str) -> ActorDigest:
        """The state of the hash now, under the actor's name."""
        return ActorDigest(actor, self.count, self._hash.hexdigest())


class Tally:
    """Counts what a process publishes and receives, and hashes what it publishes."""

    def __init__(self) -> None:
        self.published = 0
        self.received = 0
        self.hash = MessageHash()
        self._next_out: dict[str, int] = defaultdict(int)
        self._next_in: dict[str, int] = defaultdict(int)

    def sending(self, key: str) -> int:
        """The sequence number of the next message published on `key`."""
        self.published += 1
        sequence = self._next_out[key]
        self._next_out[key] = sequence + 1
        return sequence

    def receiving(self, key: str) -> int:
        """The sequence number of the next message taken from `key`."""
        sequence = self._next_in[key]
        self._next_in[key] = sequence + 1
        return sequence


def run_digest(digests: list[ActorDigest]) -> str:
    """The digest of a run: sha256 over its processes' digests, sorted by actor."""
    lines = sorted(f"{digest.actor} {digest.count} {digest.sha256}\n" for digest in digests)
    return hashlib.sha256("".join(lines).encode()).hexdigest()
