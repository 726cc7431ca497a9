"""What one process sent and received: the counts, and the hash that the run's digest is made of.

Every message of a run is sent or taken by the world or by the radio. So the run's digest is made of these two
alone: what a robot says of itself, with its user's code in its process, changes no digest.
"""

import hashlib
from collections import defaultdict
from collections.abc import Iterable
from typing import Final

import msgspec

_WITNESSES: Final = frozenset({"world", "radio"})


def carries_digest(actor: str) -> bool:
    """True for the actors whose digests make up the run's."""
    return actor in _WITNESSES


class ActorDigest(msgspec.Struct, frozen=True):
    """The messages that one process sent or took on the digested topics: their number and their hash."""

    actor: str
    count: int
    sha256: str


Hashed = tuple[str, int, int, bytes]
"""One message as it is hashed: key, step, sequence, and the sha256 of its encoded bytes: a recording may
hold just that."""


class _EncodedKeys(dict[str, bytes]):
    """Each key as bytes, encoded once."""

    def __missing__(self, key: str) -> bytes:
        self[key] = encoded = key.encode()
        return encoded


class MessageHash:
    """A running hash over (key, step, sequence, encoded bytes)."""

    def __init__(self) -> None:
        self.waiting: list[Hashed] = []
        """Messages that are still to be hashed, in their order. Whoever appends to it calls `settle` before
        they are many: so a message costs no call of its own."""
        self._hash = hashlib.sha256()
        self._keys = _EncodedKeys()
        self._count = 0

    def digest(self, actor: str) -> ActorDigest:
        """The state of the hash now, under the actor's name."""
        self.settle()
        return ActorDigest(actor, self._count, self._hash.hexdigest())

    def settle(self) -> None:
        """Hash what waits."""
        keys, waiting, self.waiting = self._keys, self.waiting, []
        lines = [
            b"%b\0%d\0%d\0%b" % (keys[key], step, sequence, sha256) for key, step, sequence, sha256 in waiting
        ]
        self._hash.update(b"".join(lines))
        self._count += len(lines)


class MessageCounts:
    """Counts what a process publishes and receives, and hashes what it publishes and takes."""

    def __init__(self) -> None:
        self.hash = MessageHash()
        self.sent: dict[str, int] = defaultdict(int)
        """Messages published, by key: the sequence number of the next one."""
        self.arrived: dict[str, int] = defaultdict(int)
        """Messages received from other actors, by key, whether the core took them or not."""
        self.taken: dict[str, int] = defaultdict(int)
        """Messages that the core took, by key."""

    @property
    def published(self) -> int:
        """Messages published, on all keys."""
        return sum(self.sent.values())

    @property
    def received(self) -> int:
        """Messages received from other actors, on all keys."""
        return sum(self.arrived.values())


def run_digest(digests: Iterable[ActorDigest]) -> str:
    """The digest of a run: sha256 over the digests of the processes that carry it, sorted by actor."""
    lines = sorted(
        f"{digest.actor} {digest.count} {digest.sha256}\n"
        for digest in digests
        if carries_digest(digest.actor)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()
