"""The shell around every core: collects inputs, advances, counts, records and publishes; many per process."""

import hashlib
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from typing import Final, NamedTuple

import msgspec

from actors.runtime.captured_output import CapturedOutput
from actors.runtime.codec import decode, encode
from actors.runtime.core import Address, Bus, Core, Delivery, Outlet, Output
from actors.runtime.errors import AcrcError
from actors.runtime.linux import cpu_s
from actors.runtime.recording import LARGEST_RECORD, Journal
from actors.topic import Message, Topic, sender

_DIGESTED_ACTORS: Final = frozenset({"world", "radio"})


def is_in_run_digest(actor: str) -> bool:
    """Return True for actors whose digests are part of the run's digest."""
    return actor in _DIGESTED_ACTORS


class ActorDigest(msgspec.Struct, frozen=True):
    """Number and hash of the digested messages that one process sent or used."""

    actor: str
    count: int
    sha256: str


HashedMessage = tuple[str, int, int, bytes]
"""One message to be hashed: key, step, sequence number, SHA-256 of its bytes."""


class _EncodedKeys(dict[str, bytes]):
    """Cache of keys encoded as bytes."""

    def __missing__(self, key: str) -> bytes:
        self[key] = encoded = key.encode()
        return encoded


class MessageHash:
    """Running hash over (key, step, sequence number, encoded bytes)."""

    def __init__(self) -> None:
        self.waiting: list[HashedMessage] = []
        """Messages to be hashed, in order. Callers append directly, which saves a call per message, and call
        `settle` before there are many."""
        self._hash = hashlib.sha256()
        self._keys = _EncodedKeys()
        self._count = 0

    def digest(self, actor: str) -> ActorDigest:
        """Return the hash so far with the actor's name."""
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
    """Counts of messages published and received, and the hash of messages published and used."""

    def __init__(self) -> None:
        self.hash = MessageHash()
        self.sent: dict[str, int] = defaultdict(int)
        """Messages published, by key: the sequence number of the next one."""
        self.arrived: dict[str, int] = defaultdict(int)
        """Messages received from other actors, by key, used or not."""
        self.taken: dict[str, int] = defaultdict(int)
        """Messages used by the core, by key."""

    @property
    def published(self) -> int:
        """Messages published on all keys."""
        return sum(self.sent.values())

    @property
    def received(self) -> int:
        """Messages received from other actors on all keys."""
        return sum(self.arrived.values())


def run_digest(digests: Iterable[ActorDigest]) -> str:
    """Return a run's digest: SHA-256 over the digests of world and radio, sorted by actor."""
    lines = sorted(
        f"{digest.actor} {digest.count} {digest.sha256}\n"
        for digest in digests
        if is_in_run_digest(digest.actor)
    )
    return hashlib.sha256("".join(lines).encode()).hexdigest()


class Clocks(NamedTuple):
    """Clock readings of a process, s."""

    wall_s: float
    """Wall-clock time, s since the epoch."""
    cpu_s: float
    """CPU time of the process since its start."""


class Shell:
    """Runs one core over any bus.

    `optional_inputs` returns the addresses of optional inputs, which the core gets at its next advance if
    they have arrived; other messages are used only when the core requires them.
    """

    INBOX_LIMIT: Final = 100_000
    """Most messages waiting for the core; more indicate a violated barrier."""
    KEY_LIMIT: Final = 5000
    """Most messages waiting on one key; more indicate flooding."""
    HASHED_TOGETHER: Final = 16
    """Number of advances between hashings."""

    def __init__(
        self,
        core: Core,
        outlet: Outlet,
        journal: Journal,
        *,
        actor: str,
        optional_inputs: Callable[[], Sequence[Address]] = tuple,
    ) -> None:
        self.actor = actor
        self.core = core
        self.counts = MessageCounts()
        self.advances = 0
        self.finished: bool = core.finished
        """True once the core will take no further step."""
        self.first_advance = read_clocks()
        """Clocks after the first advance: after the world's roll call, or another actor's first step."""
        self._outlet = outlet
        self._journal = journal
        self.optional_inputs = optional_inputs
        self.prints: CapturedOutput | None = None
        """Captures output of the core's code; None: no capture."""
        self._computed: dict[str, int] = defaultdict(int)
        """Messages recorded and not published, by key."""
        self._inbox: dict[str, deque[bytes]] = {}
        self._waiting = 0
        self._inputs: dict[str, Message] = {}
        self._awaited: list[Address] = []
        self.blocked_on: str | None = None
        """Key whose next message `pump` requires; None: unknown."""
        self._step = core.step
        self._newest = core.step
        """Latest step of an input; after a gap the core is behind it."""

    @property
    def unread(self) -> int:
        """Number of messages received and not used by the core."""
        return self._waiting

    @property
    def awaited(self) -> Sequence[Address]:
        """Missing messages that have not arrived, next one first; all of one topic."""
        missing = [one for one in reversed(self._awaited) if not self._inbox.get(one.key)]
        return [one for one in missing if one.topic is missing[0].topic]

    def deliver(self, delivery: Delivery) -> None:
        """Queue a message for the core. Raises AcrcError if too many are queued."""
        if self._waiting >= self.INBOX_LIMIT:
            raise AcrcError(
                f"step {self._step}: {self.actor} has {self._waiting} unread messages, the last one on "
                f"{delivery.key}; at most {self.INBOX_LIMIT} are allowed"
            )
        key = delivery.key
        if key not in self._inbox:
            self._inbox[key] = deque()
        waiting = self._inbox[key]
        if self._waiting >= self.KEY_LIMIT and len(waiting) >= self.KEY_LIMIT:
            origin = sender(key) or "a client"
            raise AcrcError(
                f"step {self._step}: {origin} floods {key}: {self.actor} has {len(waiting)} unread messages "
                f"from this key; at most {self.KEY_LIMIT} are allowed"
            )
        self._waiting += 1
        if not delivery.topic.is_from_outside:
            self.counts.arrived[key] += 1
        waiting.append(delivery.payload)
        if key == self.blocked_on:
            self.blocked_on = None

    def pump(self) -> Address | None:
        """Advance the core once if no message is missing; else return the first missing address."""
        while True:
            while self._awaited:
                if not self._take(self._awaited[-1]):
                    self.blocked_on = self._awaited[-1].key
                    return self._awaited[-1]
                del self._awaited[-1]
            self._awaited = [*self.core.missing(self._inputs)][::-1]
            if not self._awaited:
                break
        for address in self.optional_inputs():
            self._take(address)
        self._advance()
        return None

    def send(self, output: Output) -> None:
        """Publish a message; only record it if its topic is recorded only."""
        message = output.message
        key, topic = output.address.key, output.address.topic
        if topic.is_recorded_only:
            sequence = self._computed[key]
            self._computed[key] = sequence + 1
            self._journal.computed(key, message.step, sequence, encode(message, key, LARGEST_RECORD))
            return
        payload = encode(message, key)
        if not topic.is_telemetry:
            sequence = self.counts.sent[key]
            self.counts.sent[key] = sequence + 1
            sha256 = None
            if topic.is_digested:
                sha256 = hashlib.sha256(payload).digest()
                self.counts.hash.waiting += ((key, message.step, sequence, sha256),)
            self._journal.sent(key, message.step, sequence, payload, sha256)
        self._outlet.publish(key, payload)

    def _take(self, address: Address) -> bool:
        """Move the oldest queued message of `address` to the inputs; False if there is none."""
        key, topic = address.key, address.topic
        if key not in self._inbox or not self._inbox[key]:
            return False
        payload = self._inbox[key].popleft()
        self._waiting -= 1
        message = decode(topic, key, payload)
        sequence = self.counts.taken[key]
        self.counts.taken[key] = sequence + 1
        self._journal.received(key, self._step, sequence, payload)
        if topic.is_digested:
            sha256 = hashlib.sha256(payload).digest()
            self.counts.hash.waiting += ((key, message.step, sequence, sha256),)
        if (step := message.step) > self._newest:
            self._newest = step
        self._inputs[key] = message
        return True

    def _advance(self) -> None:
        core, step = self.core, self._step
        if self.prints is None:
            outputs = core.advance(self._inputs)
        else:
            outputs = self.prints.call(self._newest, core.advance, self._inputs)
        self._newest = self._step = core.step
        self.finished = core.finished
        self._inputs = {}
        self.advances += 1
        if self.advances == 1:
            self.first_advance = read_clocks()
        for output in outputs:
            self.send(output)
        if not self.advances % self.HASHED_TOGETHER:
            self.counts.hash.settle()
        if self._step != step or self.finished:
            self._journal.flush()


def read_clocks() -> Clocks:
    """Return the clocks; never passed to a core."""
    return Clocks(time.time(), cpu_s())


def run_shell(shell: Shell, bus: Bus, before_pump: Callable[[], None] = lambda: None) -> None:
    """Run `shell`, whose outlet is `bus`, until its core has finished."""
    while not shell.finished:
        before_pump()
        for address in shell.optional_inputs():
            while (delivery := bus.poll(address.topic)) is not None:
                shell.deliver(delivery)
        awaited = shell.pump()
        if awaited is not None:
            shell.deliver(bus.receive(awaited.topic))


class MemoryBus:
    """Bus of an in-memory run: delivers immediately, in order, by exact key or by `*` for a robot's id."""

    def __init__(self) -> None:
        self._listeners: list[tuple[Address, Callable[[Delivery], None]]] = []
        self._routes: dict[str, list[tuple[Topic[Message], Callable[[Delivery], None]]]] = {}

    def listen(self, address: Address, deliver: Callable[[Delivery], None]) -> None:
        """Call `deliver` for every message on `address` from now on."""
        self._listeners.append((address, deliver))
        self._routes.clear()

    def leave(self, deliver: Callable[[Delivery], None]) -> None:
        """Remove a subscriber."""
        self._listeners = [entry for entry in self._listeners if entry[1] != deliver]
        self._routes.clear()

    def publish(self, key: str, payload: bytes) -> None:
        """Deliver `payload` to all subscribers of `key`."""
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

    `shells` may grow meanwhile. Raises AcrcError, with the missing messages, if no shell can advance.
    """
    while True:
        advanced = False
        open_shells = 0
        for shell in tuple(shells):
            if shell.finished:
                continue
            open_shells += 1
            if shell.blocked_on is not None:
                continue
            before_pump(shell)
            while shell.pump() is None:
                advanced = True
                if shell.finished:
                    break
        if not open_shells:
            return
        if not advanced:
            raise AcrcError(_stall_sentence(shells))


def _stall_sentence(shells: Sequence[Shell]) -> str:
    waiting = deque(
        f"{shell.actor} (step {shell.core.step}) waits for {shell.awaited[0].key}"
        for shell in shells
        if not shell.finished and shell.awaited
    )
    return "no actor can continue: " + "; ".join(waiting)
