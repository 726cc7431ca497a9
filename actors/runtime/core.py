"""The contract of an actor's core: messages in, messages out, and nothing else.

A core opens no file, reads no clock, starts no thread and draws no number that its generator did not give it.
So the same core runs behind Zenoh, in one process over memory, and under a debugger from a recording.
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
    """One key on the bus; made by `at`."""

    topic: Topic[Message]
    robot: str
    """Where the topic has one, the robot's id; "*" = every robot."""
    key: str
    """The key as text."""


class Output(msgspec.Struct, frozen=True, gc=False):
    """A message and where it goes."""

    address: Address
    message: Message


Inputs = Mapping[str, Message]
"""What a core is given: one message per key."""


class Core(Protocol):
    """One actor without I/O."""

    @property
    def step(self) -> int:
        """The step that the core is in: every message it awaits or gives belongs to it."""

    @property
    def finished(self) -> bool:
        """True once the core will take no further step."""

    def missing(self, have: Inputs) -> Sequence[Address]:
        """What must still arrive before `advance`, given what is at hand.

        Called again whenever all it named has arrived, so that a message can name others by its counts.
        """

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take in exactly what `missing` asked for and give what follows, in the order it is to be sent."""


def to(topic: Topic[M], message: M, robot: str = "") -> Output:
    """`message` on `topic`; mypy checks that the two fit."""
    return Output(at(topic, robot), message)


@functools.cache
def at(topic: Topic[M], robot: str = "") -> Address:
    """The address of `topic` for `robot`."""
    return Address(topic, robot, topic.key(robot))  # type: ignore[arg-type]


def read(inputs: Inputs, topic: Topic[M], robot: str = "") -> M:
    """The message of `topic` among the inputs; it must be there."""
    return inputs[at(topic, robot).key]  # type: ignore[return-value]  # `decode` has made it of the topic's type


class Delivery(msgspec.Struct, frozen=True, gc=False):
    """Encoded bytes that arrived on a key."""

    topic: Topic[Message]
    key: str
    payload: bytes


class Outlet(Protocol):
    """The sending half of a bus; keeps the order of one sender's messages on one key."""

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`; never drops."""


class Bus(Outlet, Protocol):
    """A bus from which an actor fetches what it waits for: the mesh, or a recording.

    In memory nobody can wait: there the bus hands each message to the shells that listen (`MemoryBus`).
    """

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next message on any key of `topic`; waits for it."""

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next message on any key of `topic` if one is there."""


class Pace:
    """Since the origin simulated time has never passed more than `speed` times as fast as real time.

    A run that is late does not wait, and so goes faster than that until it has caught up.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._origin: float | None = None

    def hold(self, instant: Instant) -> None:
        """Return when `instant` is due; the first call sets the origin."""
        now = time.monotonic()
        due = in_seconds(instant) / self._speed
        if self._origin is None:
            self._origin = now - due
        elif self._origin + due > now:
            time.sleep(self._origin + due - now)

    def restart(self) -> None:
        """After a pause: the next instant sets the origin anew."""
        self._origin = None


@contextmanager
def ticking(period_s: float, tick: Callable[[FrameType | None], None]) -> Iterator[None]:
    """Call `tick` in the main thread every `period_s`, between two instructions of whatever runs there.

    It is given the frame that it comes between, and may raise. Uses the interval timer, so there can
    be one of these at a time; a process that was stopped meanwhile gets one call, however long that lasted.
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
