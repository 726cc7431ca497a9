"""The mesh: one Zenoh session per process; publishing blocks instead of dropping messages."""

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
"""One thread for all of Zenoh: with a process per robot, more threads only wake each other."""
_BLOCK: Final = zenoh.CongestionControl.BLOCK
_CLOSE_TIMEOUT_S: Final = 2.0
"""Timeout for closing a session; own choice, less than a supervisor grants to a process."""


class ZenohBus:
    """Bus over one session, with a queue per subscribed topic.

    A full queue blocks the sender (congestion control BLOCK), so nothing is dropped. A `lossy` bus blocks no
    sender: only the newest messages are kept.
    """

    QUEUE: Final = 4096

    def __init__(self, session: zenoh.Session, listens: Sequence[Address], *, lossy: bool = False) -> None:
        self._put = session.put
        self._keys = _DeclaredKeys(session)
        channel = zenoh.handlers.RingChannel if lossy else zenoh.handlers.FifoChannel
        self._subscribers: dict[Topic[Message], Any] = {
            address.topic: session.declare_subscriber(address.key, channel(self.QUEUE)) for address in listens
        }

    def publish(self, key: str, payload: bytes) -> None:
        """Publish `payload` to all subscribers of `key`; block while a queue is full."""
        self._put(self._keys[key], payload, congestion_control=_BLOCK)

    def receive(self, topic: Topic[Message]) -> Delivery:
        """Wait for the next message on any key of `topic`; signal handlers run meanwhile."""
        sample = self._subscribers[topic].recv()
        return Delivery(topic, str(sample.key_expr), sample.payload.to_bytes())

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """Return the next message on any key of `topic`; None: none has arrived."""
        sample = self._subscribers[topic].try_recv()
        return None if sample is None else Delivery(topic, str(sample.key_expr), sample.payload.to_bytes())


class _DeclaredKeys(dict[str, zenoh.KeyExpr]):
    """Keys declared to the router on first use: it routes their numbers without parsing and matching text."""

    def __init__(self, session: zenoh.Session) -> None:
        super().__init__()
        self._session = session

    def __missing__(self, key: str) -> zenoh.KeyExpr:
        declared: zenoh.KeyExpr = self._session.declare_keyexpr(key)
        self[key] = declared
        return declared


@contextmanager
def open_mesh(
    config: zenoh.Config,
    listens: Sequence[Address],
    *,
    patience_s: float = math.inf,
    between: Callable[[], None] = lambda: None,
    lossy: bool = False,
) -> Iterator[ZenohBus]:
    """Open a bus over a new session; see `open_session`."""
    with open_session(config, patience_s, between) as session:
        yield ZenohBus(session, listens, lossy=lossy)


@contextmanager
def open_session(
    config: zenoh.Config, patience_s: float = math.inf, between: Callable[[], None] = lambda: None
) -> Iterator[zenoh.Session]:
    """Open a session; retry for `patience_s` while the router does not listen yet.

    `between` is called between attempts and may raise. No limit is for processes with a supervisor.
    """
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)  # read at the process's first session
    # Zenoh would log to standard output, which may carry results; its errors are raised or counted
    zenoh.init_log_from_env_or("off")
    deadline = time.monotonic() + patience_s
    while True:
        try:
            session = zenoh.open(config)
            break
        except zenoh.ZError as error:
            between()
            if time.monotonic() > deadline:
                raise AcrcError(f"cannot connect to the router within {patience_s:g} s: {error}") from None
            time.sleep(0.005)
    try:
        yield session
    finally:
        _close_session(session)


def _close_session(session: zenoh.Session) -> None:
    """Close a session; leave it to the end of the process if that takes long.

    Closing blocks forever if the router waits to notify a stopped process (Zenoh 1.10.2;
    eclipse-zenoh/zenoh#1267 is open). By then all messages to others have been written, and both sides count
    what they sent and received.
    """
    closing = threading.Thread(target=_close, args=(session,), daemon=True)
    try:
        closing.start()
    except RuntimeError:  # no more threads available
        _close(session)
    else:
        closing.join(_CLOSE_TIMEOUT_S)


def _close(session: zenoh.Session) -> None:
    with suppress(zenoh.ZError):
        session.close()  # type: ignore[no-untyped-call]


class HostRouter:
    """A host's router and its link to the world's router."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        """`robot`: any of the host's robots."""
        self._session = session
        self._publisher: Any = session.declare_publisher(READY.key(robot))

    @property
    def joined(self) -> bool:
        """True once the world has subscribed to this host's robots; earlier messages would be lost."""
        return bool(self._publisher.matching_status.matching)

    @property
    def linked(self) -> bool:
        """True while linked to the world's router."""
        return bool(self._session.info.routers_zid())


@contextmanager
def open_host_router(
    config: zenoh.Config, robot: str, between: Callable[[], None] = lambda: None
) -> Iterator[HostRouter]:
    """Open the router of a host; see `open_session`."""
    with open_session(config, between=between) as session:
        yield HostRouter(session, robot)


class SelectableBus:
    """Bus with a file descriptor for `select`. Linux only.

    It keeps QUEUE unread messages, and drops and counts more: a flood must not block an actor that has a
    robot to stop.
    """

    QUEUE = 4096

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
        """Descriptor that is readable while messages wait; for `select`."""
        return self._wake

    def publish(self, key: str, payload: bytes) -> None:
        """Publish `payload` to all subscribers of `key`."""
        self._session.put(key, payload, congestion_control=_BLOCK)

    def take(self) -> list[Delivery]:
        """Return all waiting messages, in order."""
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
