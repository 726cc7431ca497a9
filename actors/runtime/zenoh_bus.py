"""The mesh: one Zenoh session per process; every put blocks rather than drops."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final

import zenoh

from actors.runtime.bus import Delivery
from actors.runtime.core import Address
from actors.runtime.errors import AcrcError
from actors.topic import Message, Topic

_ONE_THREAD: Final = (
    "(rx: (worker_threads: 1), tx: (handover: rx), app: (handover: rx), acc: (handover: rx), "
    "net: (handover: rx))"
)
"""All of Zenoh's work on one thread: with a process per robot, more of them only wake one another."""


class MeshError(AcrcError):
    """No session with the router."""


class ZenohBus:
    """Publishes and receives over one session; each listened topic has a queue of its own.

    A full queue holds the sender up (congestion control BLOCK); nothing is dropped.
    """

    QUEUE: Final = 4096

    def __init__(self, session: zenoh.Session, listens: Sequence[Address]) -> None:
        self._session = session
        self._subscribers: dict[Topic[Message], Any] = {
            address.topic: session.declare_subscriber(address.key, zenoh.handlers.FifoChannel(self.QUEUE))
            for address in listens
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
def open_mesh(config: zenoh.Config, listens: Sequence[Address], *, patience_s: float) -> Iterator[ZenohBus]:
    """A bus over a new session; tries again for `patience_s` while the router is not there yet."""
    with open_session(config, patience_s) as session:
        yield ZenohBus(session, listens)


@contextmanager
def open_session(config: zenoh.Config, patience_s: float) -> Iterator[zenoh.Session]:
    """A new session for a bus; tries again for `patience_s` while the router is not there yet."""
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)  # read when the process opens its first session
    # Zenoh logs to standard output, where a result may stand; what goes wrong is raised, or counted
    zenoh.init_log_from_env_or("off")
    deadline = time.monotonic() + patience_s
    while True:
        try:
            session = zenoh.open(config)
            break
        except zenoh.ZError as error:
            if time.monotonic() > deadline:
                raise MeshError(f"no session with the router within {patience_s:g} s: {error}") from None
            time.sleep(0.005)
    with session:
        yield session
