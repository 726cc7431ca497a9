"""What one process sent and received: the counts, and the hash that the run's digest is made of.

Every message of a run is sent or taken by the world or by the radio. So the run's digest is made of these two
alone: what a robot says of itself, with its user's code in its process, changes no digest.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import msgspec

from actors.messages import (
    AIRED,
    ANSWERED,
    CONTROL,
    DRIVE,
    PROGRESS,
    RECEIVED,
    ROSTER,
    SENSES,
    TRANSMIT,
    TRUTH,
)
from actors.topic import Message, Topic

_DIGESTED: Final = frozenset(
    topic.pattern for topic in (SENSES, RECEIVED, DRIVE, TRANSMIT, TRUTH, AIRED, ROSTER)
)
_WITNESSES: Final = frozenset({"world", "radio"})


_TELEMETRY: Final = frozenset({PROGRESS.pattern, ANSWERED.pattern})


def is_telemetry(topic: Topic[Message]) -> bool:
    """True for what is only shown to people: neither counted, nor recorded, nor in the digest."""
    return topic.pattern in _TELEMETRY


def is_from_outside(topic: Topic[Message]) -> bool:
    """True for what no actor publishes, and so cannot be balanced against what was received."""
    return topic.pattern == CONTROL.pattern


def carries_digest(actor: str) -> bool:
    """True for the actors whose digests make up the run's."""
    return actor in _WITNESSES


def is_digested(pattern: str) -> bool:
    """True for the topics whose messages make up the run's digest."""
    return pattern in _DIGESTED


class ActorDigest(msgspec.Struct, frozen=True):
    """The messages that one process sent or took on the digested topics: their number and their hash."""

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


class MessageCounts:
    """Counts what a process publishes and receives, and hashes what it publishes and takes."""

    def __init__(self) -> None:
        self.hash = MessageHash()
        self.sent: dict[str, int] = defaultdict(int)
        """Messages published, by key."""
        self.arrived: dict[str, int] = defaultdict(int)
        """Messages received from other actors, by key, whether the core took them or not."""
        self._next_in: dict[str, int] = defaultdict(int)

    @property
    def published(self) -> int:
        """Messages published, on all keys."""
        return sum(self.sent.values())

    @property
    def received(self) -> int:
        """Messages received from other actors, on all keys."""
        return sum(self.arrived.values())

    def sending(self, key: str) -> int:
        """The sequence number of the next message published on `key`."""
        sequence = self.sent[key]
        self.sent[key] = sequence + 1
        return sequence

    def receiving(self, key: str) -> int:
        """The sequence number of the next message taken from `key`."""
        sequence = self._next_in[key]
        self._next_in[key] = sequence + 1
        return sequence


def run_digest(digests: Iterable[ActorDigest]) -> str:
    """The digest of a run: sha256 over the digests of the processes that carry it, sorted by actor."""
    lines = sorted(
        f"{digest.actor} {digest.count} {digest.sha256}\n"
        for digest in digests
        if carries_digest(digest.actor)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()
