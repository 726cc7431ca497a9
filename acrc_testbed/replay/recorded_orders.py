"""The orders that a run was given; and those from outside given again, in time for their boundaries."""

from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from actors.messages import AIRED, CONTROL, RADIO_READY, TRUTH, Truth
from actors.orders import Order
from actors.runtime.bus.memory_bus import MemoryBus
from actors.runtime.codec import decode
from actors.runtime.core import Delivery, at
from actors.runtime.recording import Note, read_recording


class TimedControl(NamedTuple):
    """The bytes of a Control."""

    step: int
    """At whose boundary it is to be taken."""
    payload: bytes


class GivenOrder(NamedTuple):
    """An order, whoever gave it."""

    step: int
    """At whose boundary it was taken."""
    order: Order


class OrderBus(MemoryBus):
    """Gives the world these orders, each in time for its boundary; they must be in order."""

    def __init__(self, orders: Iterable[TimedControl]) -> None:
        super().__init__()
        self.given = 0
        self._left = deque(orders)
        self.listen(at(RADIO_READY), lambda _: self._give(0))
        self.listen(at(TRUTH), self._after)

    def _after(self, delivery: Delivery) -> None:
        """The world has closed a step, and will open the next."""
        truth = decode(delivery.topic, delivery.key, delivery.payload)
        assert isinstance(truth, Truth)
        self._give(truth.step + 1)

    def _give(self, step: int) -> None:
        while self._left and self._left[0].step <= step:
            self.publish(CONTROL.pattern, self._left.popleft().payload)
            self.given += 1


def recorded_orders(world: Path) -> Iterator[TimedControl]:
    """Every order from outside in the world's recording: its boundary comes after what was aired last."""
    boundary = 0
    for item in read_recording(world):
        if isinstance(item, Note) or item.direction != "in":
            continue
        if item.key == AIRED.pattern:
            boundary = item.step + 1
        elif item.key == CONTROL.pattern:
            assert item.payload is not None, "the receiver of a message keeps it in full"
            yield TimedControl(boundary, item.payload)
