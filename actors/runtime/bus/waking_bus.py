"""A bus for an actor that waits for more than the mesh: what arrives makes a file descriptor readable."""

import os
import threading
from collections import deque
from collections.abc import Sequence
from typing import Any, Final

import zenoh

from actors.runtime.bus_interface import Delivery
from actors.runtime.core import Address
from actors.topic import Message, Topic


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
