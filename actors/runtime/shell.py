"""The one shell around every core: gathers, advances, counts, records, publishes; many in one process."""

import hashlib
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import msgspec

from actors.runtime.codec import decode, encode
from actors.runtime.core import Address, Bus, Core, Delivery, Outlet, Output
from actors.runtime.errors import AcrcError
from actors.runtime.linux import cpu_s
from actors.runtime.prints import Prints
from actors.runtime.recording import LARGEST_RECORD, Journal
from actors.topic import Message, Topic, sender

_WITNESSES: Final = frozenset({"world", "radio"})


def carries_digest(actor: str) -> bool:
    """True for the actors whose digests make up the run's."""
    return actor in _WITNESSES


class ActorDigest(msgspec.Struct, frozen=True):
    """Number and hash of the digested messages that one process sent or took."""

    actor: str
    count: int
    sha256: str


Hashed = tuple[str, int, int, bytes]
"""One message as it is hashed: key, step, sequence, and the sha256 of its bytes."""


class _EncodedKeys(dict[str, bytes]):
    """Each key as bytes, encoded once."""

    def __missing__(self, key: str) -> bytes:
        self[key] = encoded = key.encode()
        return encoded


class MessageHash:
    """A running hash over (key, step, sequence, encoded bytes)."""

    def __init__(self) -> None:
        self.waiting: list[Hashed] = []
        """Messages to be hashed, in order. Append to it, and call `settle` before they are many: so a message
        costs no call of its own."""
        self._hash = hashlib.sha256()
        self._keys = _EncodedKeys()
        self._count = 0

    def digest(self, actor: str) -> ActorDigest:
        """Return the hash so far, under the actor's name."""
        self.settle()
        return ActorDigest(actor, self._count, self._hash.hexdigest())

    def settle(self) -> None:
        """Hash the waiting messages."""
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
    """Return the digest of a run: sha256 over the digests of its witnesses, sorted by actor."""
    lines = sorted(
        f"{digest.actor} {digest.count} {digest.sha256}\n"
        for digest in digests
        if carries_digest(digest.actor)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


class Clocks(NamedTuple):
    """Times of a process, s."""

    wall_s: float
    """Since the epoch."""
    cpu_s: float
    """Of the process, since its start."""


class Shell:
    """Runs one core over any bus.

    `open_to` returns the addresses whose messages the core takes at its next advance if there are any; others
    are taken only when the core misses them.
    """

    INBOX_LIMIT: Final = 100_000
    """Messages that may wait for the core; more mean a broken barrier."""
    KEY_LIMIT: Final = 5000
    """Of them, on one key; more mean a flood."""
    HASHED_TOGETHER: Final = 16
    """Advances whose messages are hashed together."""

    def __init__(
        self,
        core: Core,
        outlet: Outlet,
        journal: Journal,
        *,
        actor: str,
        open_to: Callable[[], Sequence[Address]] = tuple,
    ) -> None:
        self.actor = actor
        self.core = core
        self.tally = MessageCounts()
        self.advances = 0
        self.finished: bool = core.finished
        """True once the core will take no further step."""
        self.began = clocks()
        """Times after the first advance: a world's roll call, another actor's first step."""
        self._outlet = outlet
        self._journal = journal
        self.open_to = open_to
        self.prints: Prints | None = None
        """Takes the output of the core's code; None: the usual streams."""
        self._computed: dict[str, int] = defaultdict(int)
        """Messages recorded and not published, by key."""
        self._inbox: dict[str, deque[bytes]] = {}
        self._waiting = 0
        self._inputs: dict[str, Message] = {}
        self._awaited: list[Address] = []
        self.held_by: str | None = None
        """The key whose next message `pump` needs; None: none is known to be missing."""
        self._step = core.step
        self._newest = core.step
        """The latest step of an input; after a gap the core is behind it."""

    @property
    def unread(self) -> int:
        """Messages that have arrived and that the core has not taken."""
        return self._waiting

    @property
    def awaited(self) -> Sequence[Address]:
        """What the core is missing and has not arrived, next one first; of one topic."""
        missing = [one for one in reversed(self._awaited) if not self._inbox.get(one.key)]
        return [one for one in missing if one.topic is missing[0].topic]

    def deliver(self, delivery: Delivery) -> None:
        """Keep a message until the core takes it. Raises AcrcError where too many wait."""
        if self._waiting >= self.INBOX_LIMIT:
            raise AcrcError(
                f"step {self._step}: {self.actor} has {self._waiting} messages waiting, the last one on "
                f"{delivery.key}, and takes none; at most {self.INBOX_LIMIT} may wait"
            )
        key = delivery.key
        if key not in self._inbox:
            self._inbox[key] = deque()
        waiting = self._inbox[key]
        if self._waiting >= self.KEY_LIMIT and len(waiting) >= self.KEY_LIMIT:
            who = sender(key) or "somebody"
            raise AcrcError(
                f"step {self._step}: {who} floods {key}: {self.actor} has {len(waiting)} "
                f"messages from there and has asked for none of them; at most {self.KEY_LIMIT} may wait"
            )
        self._waiting += 1
        if not delivery.topic.is_from_outside:
            self.tally.arrived[key] += 1
        waiting.append(delivery.payload)
        if key == self.held_by:
            self.held_by = None

    def pump(self) -> Address | None:
        """Advance the core once if nothing is missing; else return the first missing address."""
        while True:
            while self._awaited:
                if not self._take(self._awaited[-1]):
                    self.held_by = self._awaited[-1].key
                    return self._awaited[-1]
                del self._awaited[-1]
            self._awaited = [*self.core.missing(self._inputs)][::-1]
            if not self._awaited:
                break
        for address in self.open_to():
            self._take(address)
        self._advance()
        return None

    def send(self, output: Output) -> None:
        """Publish one message, or record it if its topic is only recorded."""
        message = output.message
        key, topic = output.address.key, output.address.topic
        if topic.is_recorded_only:
            sequence = self._computed[key]
            self._computed[key] = sequence + 1
            self._journal.computed(key, message.step, sequence, encode(message, key, LARGEST_RECORD))
            return
        payload = encode(message, key)
        if not topic.is_telemetry:
            sequence = self.tally.sent[key]
            self.tally.sent[key] = sequence + 1
            sha256 = None
            if topic.is_digested:
                sha256 = hashlib.sha256(payload).digest()
                self.tally.hash.waiting += ((key, message.step, sequence, sha256),)
            self._journal.sent(key, message.step, sequence, payload, sha256)
        self._outlet.publish(key, payload)

    def _take(self, address: Address) -> bool:
        """Move the oldest waiting message of `address` to the inputs; False if there is none."""
        key, topic = address.key, address.topic
        if key not in self._inbox or not self._inbox[key]:
            return False
        payload = self._inbox[key].popleft()
        self._waiting -= 1
        message = decode(topic, key, payload)
        sequence = self.tally.taken[key]
        self.tally.taken[key] = sequence + 1
        self._journal.received(key, self._step, sequence, payload)
        if topic.is_digested:
            sha256 = hashlib.sha256(payload).digest()
            self.tally.hash.waiting += ((key, message.step, sequence, sha256),)
        if (step := message.step) > self._newest:
            self._newest = step
        self._inputs[key] = message
        return True

    def _advance(self) -> None:
        core, step = self.core, self._step
        if self.prints is None:
            outputs = core.advance(self._inputs)
        else:
            outputs = self.prints.of(self._newest, core.advance, self._inputs)
        self._newest = self._step = core.step
        self.finished = core.finished
        self._inputs = {}
        self.advances += 1
        if self.advances == 1:
            self.began = clocks()
        for output in outputs:
            self.send(output)
        if not self.advances % self.HASHED_TOGETHER:
            self.tally.hash.settle()
        if self._step != step or self.finished:
            self._journal.flush()


def clocks() -> Clocks:
    """Return the times now; no core sees them."""
    return Clocks(time.time(), cpu_s())


def run_shell(shell: Shell, bus: Bus, before_pump: Callable[[], None] = lambda: None) -> None:
    """Drive `shell`, whose outlet is `bus`, until its core has finished."""
    while not shell.finished:
        before_pump()
        for address in shell.open_to():
            while (delivery := bus.poll(address.topic)) is not None:
                shell.deliver(delivery)
        awaited = shell.pump()
        if awaited is not None:
            shell.deliver(bus.receive(awaited.topic))


class MemoryBus:
    """Bus of a run in one process: routes by exact key or by `*` for a robot's id, at once and in order."""

    def __init__(self) -> None:
        self._listeners: list[tuple[Address, Callable[[Delivery], None]]] = []
        self._routes: dict[str, list[tuple[Topic[Message], Callable[[Delivery], None]]]] = {}

    def listen(self, address: Address, deliver: Callable[[Delivery], None]) -> None:
        """Call `deliver` with every message on `address` from now on."""
        self._listeners.append((address, deliver))
        self._routes.clear()

    def leave(self, deliver: Callable[[Delivery], None]) -> None:
        """Forget a listener."""
        self._listeners = [entry for entry in self._listeners if entry[1] != deliver]
        self._routes.clear()

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`."""
        if key not in self._routes:
            self._routes[key] = [(a.topic, deliver) for a, deliver in self._listeners if _matches(a, key)]
        for topic, deliver in self._routes[key]:
            deliver(Delivery(topic, key, payload))


def _matches(address: Address, key: str) -> bool:
    if address.robot != "*":
        return address.key == key
    prefix, _, suffix = address.topic.pattern.partition("{id}")
    name = key[len(prefix) : len(key) - len(suffix)]
    return key.startswith(prefix) and key.endswith(suffix) and bool(name) and "/" not in name


def run_shells(shells: Sequence[Shell], before_pump: Callable[[Shell], None] = lambda shell: None) -> None:
    """Advance the shells in turn until all have finished.

    `shells` may grow while this runs. Raises AcrcError, naming who waits for what, if nobody can go on.
    """
    while True:
        advanced = False
        open_shells = 0
        for shell in tuple(shells):
            if shell.finished:
                continue
            open_shells += 1
            if shell.held_by is not None:
                continue
            before_pump(shell)
            while shell.pump() is None:
                advanced = True
                if shell.finished:
                    break
        if not open_shells:
            return
        if not advanced:
            raise AcrcError(_stalled(shells))


def _stalled(shells: Sequence[Shell]) -> str:
    waiting = deque(
        f"{shell.actor} (step {shell.core.step}) for {shell.awaited[0].key}"
        for shell in shells
        if not shell.finished and shell.awaited
    )
    return "nobody can go on: " + "; ".join(waiting) + " is awaited and never sent"
