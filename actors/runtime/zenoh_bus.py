"""The mesh: one Zenoh session per process; every put blocks rather than drops."""

import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Final

import zenoh

from actors.messages import READY
from actors.runtime.core import Address, Delivery
from actors.runtime.errors import AcrcError
from actors.topic import Message, Topic

_ONE_THREAD: Final = (
    "(rx: (worker_threads: 1), tx: (handover: rx), app: (handover: rx), acc: (handover: rx), "
    "net: (handover: rx))"
)
"""All of Zenoh's work on one thread: with a process per robot, more of them only wake one another."""
_FAREWELL_S: Final = 2.0
"""How long a session may take to close: own choice, less than a supervisor grants to a process."""


class ZenohBus:
    """Publishes and receives over one session; each listened topic has a queue of its own.

    A full queue holds the sender up (congestion control BLOCK); nothing is dropped. With `onlooker` it holds
    nobody up, and the newest messages are kept.
    """

    QUEUE: Final = 4096

    def __init__(self, session: zenoh.Session, listens: Sequence[Address], *, onlooker: bool = False) -> None:
        self._session = session
        channel = zenoh.handlers.RingChannel if onlooker else zenoh.handlers.FifoChannel
        self._subscribers: dict[Topic[Message], Any] = {
            address.topic: session.declare_subscriber(address.key, channel(self.QUEUE)) for address in listens
        }

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`; waits while a queue is full."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next message on any key of `topic`; waits for it, and lets signal handlers run."""
        return _delivery(topic, self._subscribers[topic].recv())

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next message on any key of `topic` if one is there."""
        sample = self._subscribers[topic].try_recv()
        return None if sample is None else _delivery(topic, sample)


def _delivery(topic: Topic[Message], sample: zenoh.Sample) -> Delivery:
    return Delivery(topic, str(sample.key_expr), sample.payload.to_bytes())


@contextmanager
def open_mesh(
    config: zenoh.Config,
    listens: Sequence[Address],
    *,
    patience_s: float = math.inf,
    between: Callable[[], None] = lambda: None,
    onlooker: bool = False,
) -> Iterator[ZenohBus]:
    """A bus over a new session; see `open_session`."""
    with open_session(config, patience_s, between) as session:
        yield ZenohBus(session, listens, onlooker=onlooker)


@contextmanager
def open_session(
    config: zenoh.Config, patience_s: float = math.inf, between: Callable[[], None] = lambda: None
) -> Iterator[zenoh.Session]:
    """A new session for a bus; tries again for `patience_s` while the router is not there yet.

    `between` is called between two attempts, and may raise; without limit is for whoever is looked after.
    """
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)  # read when the process opens its first session
    # Zenoh logs to standard output, where a result may stand; what goes wrong is raised, or counted
    zenoh.init_log_from_env_or("off")
    deadline = time.monotonic() + patience_s
    while True:
        try:
            session = zenoh.open(config)
            break
        except zenoh.ZError as error:
            between()
            if time.monotonic() > deadline:
                raise AcrcError(f"no session with the router within {patience_s:g} s: {error}") from None
            time.sleep(0.005)
    try:
        yield session
    finally:
        _take_leave(session)


def _take_leave(session: zenoh.Session) -> None:
    """Close it, or leave that to the end of the process where it takes long.

    Whoever has been stopped for good takes no farewell, and where a router waits to tell it that somebody
    else has left, it waits for ever (Zenoh 1.10.2; eclipse-zenoh/zenoh#1267 is open). What all others were
    sent has been written by then, and each side counts what it sent and received.
    """
    closing = threading.Thread(target=_close, args=(session,), daemon=True)
    try:
        closing.start()
    except RuntimeError:  # of threads there may be no more
        _close(session)
    else:
        closing.join(_FAREWELL_S)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]


class HostRouter:
    """What a host knows of its link to the world's router."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        """`robot`: any of its robots."""
        self._session = session
        self._publisher: Any = session.declare_publisher(READY.key(robot))

    @property
    def joined(self) -> bool:
        """True once the world hears what robots say here; before, it would be lost without a word."""
        return bool(self._publisher.matching_status.matching)

    @property
    def linked(self) -> bool:
        """True while there is a link to the world's router."""
        return bool(self._session.info.routers_zid())


@contextmanager
def open_host_router(
    config: zenoh.Config, robot: str, between: Callable[[], None] = lambda: None
) -> Iterator[HostRouter]:
    """The router of a host; see `open_session`."""
    with open_session(config, between=between) as session:
        yield HostRouter(session, robot)


class WakingBus:
    """Publishes and receives over one session. For Linux.

    What arrives beyond QUEUE messages that nobody has taken is dropped and counted: the sender of a flood
    must not hold up an actor that has a robot to stop.
    """

    QUEUE: Final = 4096

    def __init__(self, session: zenoh.Session, listens: Sequence[Address]) -> None:
        self._session = session
        self._arrived: deque[Delivery] = deque()
        self._lock = threading.Lock()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.dropped = 0
        self._subscribers: list[Any] = [
            session.declare_subscriber(address.key, self._listener(address.topic)) for address in listens
        ]

    def fileno(self) -> int:
        """Readable while something has arrived; for `select`."""
        return self._wake

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def take(self) -> list[Delivery]:
        """Everything that has arrived, in its order."""
        with self._lock:
            try:
                os.eventfd_read(self._wake)
            except BlockingIOError:
                return []
            arrived = list(self._arrived)
            self._arrived.clear()
        return arrived

    def _listener(self, topic: Topic[Message]) -> Any:
        def arrive(sample: zenoh.Sample) -> None:
            delivery = Delivery(topic, str(sample.key_expr), sample.payload.to_bytes())
            with self._lock:
                if len(self._arrived) >= self.QUEUE:
                    self.dropped += 1
                    return
                self._arrived.append(delivery)
                os.eventfd_write(self._wake, 1)

        return arrive
