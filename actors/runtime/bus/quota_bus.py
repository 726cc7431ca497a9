"""The mesh for those whom every robot may write to: nobody can fill it up for the others.

The queues of `ZenohBus` hold a sender up when they are full, and with him, as a session has one thread,
whoever else sends to it: a flood on a key that the core does not read would stop the run. Here each robot has
a quota, over all keys that it may write to; who goes beyond it ends the run, and is named.
"""

from collections.abc import Sequence
from queue import SimpleQueue
from typing import Any, Final

import zenoh

from actors.runtime.bus_interface import Delivery
from actors.runtime.core import Address
from actors.runtime.errors import AcrcError
from actors.topic import Message, Topic, sender


class QuotaBus:
    """Publishes and receives over one session; each listened topic has a queue, each sender a quota."""

    MESSAGES: Final = 1000
    """Of one sender that may wait; whoever keeps to the protocol has one or two there, a person some more."""
    BYTES: Final = 1 << 26
    """In them."""

    def __init__(self, session: zenoh.Session, listens: Sequence[Address]) -> None:
        self._session = session
        self._put: dict[str, list[int]] = {}
        self._taken: dict[str, list[int]] = {}
        self._flood: AcrcError | None = None
        self._queues: dict[Topic[Message], SimpleQueue[Delivery | AcrcError]] = {
            address.topic: SimpleQueue() for address in listens
        }
        self._subscribers: list[Any] = [
            session.declare_subscriber(address.key, self._listener(address.topic)) for address in listens
        ]

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`; waits while a queue is full."""
        self._session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next message on any key of `topic`; waits for it. Raises AcrcError, whichever key is meant."""
        return self._count(self._queues[topic].get())

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next message on any key of `topic` if one is there. Raises AcrcError."""
        queue = self._queues[topic]
        return None if queue.empty() else self._count(queue.get())

    def _count(self, taken: Delivery | AcrcError) -> Delivery:
        if self._flood is not None:
            raise self._flood
        assert isinstance(taken, Delivery)
        counts = self._taken.setdefault(_account(taken.key), [0, 0])
        counts[0] += 1
        counts[1] += len(taken.payload)
        return taken

    def _listener(self, topic: Topic[Message]) -> Any:
        """Called by the session's thread, which alone counts what was put, and only reads what was taken."""
        queue, put, taken = self._queues[topic], self._put, self._taken

        def arrive(sample: zenoh.Sample) -> None:
            if self._flood is not None:
                return
            key, payload = str(sample.key_expr), sample.payload.to_bytes()
            account = _account(key)
            counts = put.setdefault(account, [0, 0])
            counts[0] += 1
            counts[1] += len(payload)
            done = taken.get(account, (0, 0))
            if counts[0] - done[0] > self.MESSAGES or counts[1] - done[1] > self.BYTES:
                self._give_up(key, counts[0] - done[0], counts[1] - done[1])
            else:
                queue.put(Delivery(topic, key, payload))

        return arrive

    def _give_up(self, key: str, messages: int, size: int) -> None:
        """Wake whoever waits, on whichever topic."""
        who = sender(key) or "somebody"
        self._flood = AcrcError(
            f"{who} floods {key}: {messages} messages of together {size} bytes wait and nobody has asked "
            f"for them; at most {self.MESSAGES} of together {self.BYTES} may wait"
        )
        for queue in self._queues.values():
            queue.put(self._flood)


def _account(key: str) -> str:
    """Whose quota a message counts towards: the robot's that alone may write there, else the key's own."""
    return sender(key) or key
