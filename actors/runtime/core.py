"""Interface of an actor's core: messages in, messages out, no I/O.

A core opens no file, reads no clock, starts no thread, and draws random numbers only from its generator.
So the same core runs over Zenoh, in memory, and from a recording in a debugger.
"""

import functools
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import NamedTuple, Protocol, TypeVar

import msgspec

from actors.instant import Instant, in_seconds
from actors.topic import Message, Topic

M = TypeVar("M", bound=Message)


class Address(NamedTuple):
    """A key on the bus, with its topic; created by `at`."""

    topic: Topic[Message]
    robot: str
    """Robot id if the topic has one; "*": every robot."""
    key: str
    """Key as text."""


class Output(msgspec.Struct, frozen=True, gc=False):
    """A message with its destination."""

    address: Address
    message: Message


Inputs = Mapping[str, Message]
"""Inputs of a core: one message per key."""


class Core(Protocol):
    """An actor's logic, without I/O."""

    @property
    def step(self) -> int:
        """Current step: all messages that the core waits for or returns belong to it."""

    @property
    def finished(self) -> bool:
        """True once the core will take no further step."""

    def missing(self, have: Inputs) -> Sequence[Address]:
        """Return the messages still missing before `advance`, given the inputs so far.

        Called again when all of them have arrived: a message can announce others by its counts.
        """

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Process exactly the messages that `missing` returned; return the outputs in sending order."""


def to(topic: Topic[M], message: M, robot: str = "") -> Output:
    """Return `message` as an output on `topic`; mypy checks that their types match."""
    return Output(at(topic, robot), message)


@functools.cache
def at(topic: Topic[M], robot: str = "") -> Address:
    """Return the address of `topic` for `robot`."""
    return Address(topic, robot, topic.key(robot))  # type: ignore[arg-type]


def read(inputs: Inputs, topic: Topic[M], robot: str = "") -> M:
    """Return the input message of `topic`, which must be present."""
    return inputs[at(topic, robot).key]  # type: ignore[return-value]  # `decode` has made it of the topic's type


class Delivery(msgspec.Struct, frozen=True, gc=False):
    """An encoded message received on a key."""

    topic: Topic[Message]
    key: str
    payload: bytes


class Outlet(Protocol):
    """Sending half of a bus; messages of one sender on one key keep their order."""

    def publish(self, key: str, payload: bytes) -> None:
        """Publish `payload` to all subscribers of `key`; never drop it."""


class Bus(Outlet, Protocol):
    """Bus with a blocking receive: the mesh, or a recording.

    The in-memory bus cannot block: it delivers each message to the subscribed shells (`MemoryBus`).
    """

    def receive(self, topic: Topic[Message]) -> Delivery:
        """Wait for the next message on any key of `topic`, and return it."""

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """Return the next message on any key of `topic`; None: none has arrived."""


class Pace:
    """Limit of simulated time to `speed` times real time since the origin.

    A late run does not wait, and so runs faster until it has caught up.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._origin: float | None = None

    def wait_until(self, instant: Instant) -> None:
        """Wait until `instant` is due; the first call sets the origin."""
        now = time.monotonic()
        due = in_seconds(instant) / self._speed
        if self._origin is None:
            self._origin = now - due
        elif self._origin + due > now:
            time.sleep(self._origin + due - now)

    def restart(self) -> None:
        """Let the next instant set a new origin, after a pause."""
        self._origin = None


@contextmanager
def interval_timer(period_s: float, tick: Callable[[FrameType | None], None]) -> Iterator[None]:
    """Call `tick` in the main thread every `period_s`, between two Python instructions.

    `tick` gets the interrupted frame and may raise. Uses the process's only interval timer, so contexts
    cannot overlap; a process that was stopped meanwhile gets a single call.
    """

    def ring(number: int, frame: FrameType | None) -> None:
        tick(frame)

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, period_s, period_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
