"""The page's side of a run: what the run says, looked at now and then, and the orders that pages give."""

import secrets
import time
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

import msgspec

from actors.messages import ANSWERED, CONTROL, DRIVE, PROGRESS, RECEIVED, TRUTH, Answered, Control
from actors.runtime.codec import decode, encode
from actors.runtime.core import Bus, Delivery, at
from actors.runtime.errors import AcrcError
from deploy.control.scene import Scene
from deploy.control.wire import Ask, OrderLine
from deploy.run import orders

KEPT: Final = 100
"""Lines; older ones are forgotten."""


class OrderLines:
    """The last lines, oldest first. Equal orders in a row are one line, and so are those of one series."""

    def __init__(self) -> None:
        self._lines: deque[OrderLine] = deque(maxlen=KEPT)
        self._series = 0
        """Of the newest line."""
        self._begun = 0
        self._fresh: dict[int, OrderLine] = {}

    def begin(self, wish: Ask) -> int:
        """Take in an order that waits for its answer; the number of its line."""
        last = self._lines[-1] if self._lines else None
        together = last is not None and (
            wish.order == last.order or (wish.series != 0 and wish.series == self._series)
        )
        self._series = wish.series
        if last is not None and together:
            line = msgspec.structs.replace(
                last, order=wish.order, times=last.times + 1, waiting=last.waiting + 1
            )
            self._lines[-1] = line
        else:
            self._begun += 1
            line = OrderLine(self._begun, wish.order, waiting=1)
            self._lines.append(line)
        self._fresh[line.number] = line
        return line.number

    def end(self, number: int, refusal: str) -> None:
        """Note what became of an order of this line; an empty refusal: it was carried out."""
        place = number - self._begun - 1
        if -place > len(self._lines):
            return
        line = self._lines[place]
        self._lines[place] = self._fresh[number] = msgspec.structs.replace(
            line,
            waiting=line.waiting - 1,
            refused=line.refused + bool(refusal),
            refusal=refusal or line.refusal,
        )

    def kept(self) -> tuple[OrderLine, ...]:
        """All lines, oldest first."""
        return tuple(self._lines)

    def fresh(self) -> tuple[OrderLine, ...]:
        """The lines that have changed since this was asked last."""
        fresh = tuple(self._fresh.values())
        self._fresh.clear()
        return fresh


LISTENS: Final = (at(DRIVE, "*"), at(TRUTH), at(CONTROL), at(ANSWERED), at(PROGRESS), at(RECEIVED, "*"))
"""In this order they are looked at: an order comes before its answer."""
WAITING: Final = 256
"""Orders that may wait for an answer of the run."""
PATIENCE_S: Final = 10.0
"""After so long pages are told that the run has not said yet what becomes of an order."""


class _WaitingOrder(NamedTuple):
    line: int
    since_s: float


class RunLink:
    """Keeps a scene up with a run; `looks` rather loses messages than holds anybody up."""

    def __init__(
        self,
        scene: Scene,
        lines: OrderLines,
        looks: Bus,
        speaks: Bus,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`lines`: told every order, and what becomes of it."""
        self._scene = scene
        self._lines = lines
        self._looks = looks
        self._speaks = speaks
        self._clock = clock
        self._waiting: dict[str, _WaitingOrder] = {}

    def give(self, wish: Ask) -> None:
        """Give the run an order."""
        line = self._lines.begin(wish)
        words = wish.order.split()
        try:
            if not words:
                raise AcrcError("no order")
            order = orders.parse(words[0], words[1:])
        except AcrcError as error:
            self._lines.end(line, str(error))
            return
        if len(self._waiting) >= WAITING or self._scene.over:
            reason = "the run is over" if self._scene.over else "too many orders wait already"
            self._lines.end(line, reason)
            return
        ticket = secrets.token_hex(8)
        self._waiting[ticket] = _WaitingOrder(line, self._clock())
        self._speaks.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def look(self) -> None:
        """Take in all that has come; of what transceivers said, the newest of each."""
        heard: dict[str, Delivery] = {}
        for address in LISTENS:
            while (delivery := self._looks.poll(address.topic)) is not None:
                if address.topic is RECEIVED:
                    heard[delivery.key] = delivery
                else:
                    self._take(delivery)
        for delivery in heard.values():
            self._take(delivery)
        late = [t for t, one in self._waiting.items() if self._clock() - one.since_s > PATIENCE_S]
        for ticket in late:
            self._answer(ticket, "the run has not said yet; it heeds the order at its next step")

    def _take(self, delivery: Delivery) -> None:
        message = decode(delivery.topic, delivery.key, delivery.payload)
        self._scene.take(message, delivery.key.split("/")[2])
        if isinstance(message, Answered):
            self._answer(message.ticket, "; ".join(message.refusals))

    def _answer(self, ticket: str, refusal: str) -> None:
        waiting = self._waiting.pop(ticket, None)
        if waiting is not None:
            self._lines.end(waiting.line, refusal)
