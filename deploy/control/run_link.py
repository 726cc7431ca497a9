"""The page's side of a run: what the run says, looked at now and then, and the orders that pages give."""

import secrets
import time
from collections.abc import Callable
from typing import Final, NamedTuple

from actors.messages import ANSWERED, CONTROL, DRIVE, PROGRESS, TRUTH, Answered, Control
from actors.runtime.bus_interface import Bus
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from deploy.control.scene import Scene
from deploy.control.server import OpenPage
from deploy.control.wire import Ask, OrderAnswer
from deploy.run import orders

LISTENS: Final = (at(DRIVE, "*"), at(TRUTH), at(CONTROL), at(ANSWERED), at(PROGRESS))
"""In this order they are looked at: an order comes before its answer."""
WAITING: Final = 256
"""Orders that may wait for an answer of the run."""
PATIENCE_S: Final = 10.0
"""After so long a page is told that the run has not said yet what becomes of its order."""


class _WaitingOrder(NamedTuple):
    page: OpenPage
    wish: Ask
    since_s: float


class RunLink:
    """Keeps a scene up with a run; `looks` rather loses messages than holds anybody up."""

    def __init__(
        self, scene: Scene, looks: Bus, speaks: Bus, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._scene = scene
        self._looks = looks
        self._speaks = speaks
        self._clock = clock
        self._waiting: dict[str, _WaitingOrder] = {}

    def give(self, page: OpenPage, wish: Ask) -> None:
        """Give the run an order; what becomes of it is told to the page."""
        words = wish.order.split()
        try:
            if not words:
                raise AcrcError("no order")
            order = orders.parse(words[0], words[1:])
        except AcrcError as error:
            page.tell(OrderAnswer(wish.id, wish.order, str(error)))
            return
        if len(self._waiting) >= WAITING or self._scene.over:
            reason = "the run is over" if self._scene.over else "too many orders wait already"
            page.tell(OrderAnswer(wish.id, wish.order, reason))
            return
        ticket = secrets.token_hex(8)
        self._waiting[ticket] = _WaitingOrder(page, wish, self._clock())
        self._speaks.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def look(self) -> None:
        """Take in all that has come."""
        for address in LISTENS:
            while (delivery := self._looks.poll(address.topic)) is not None:
                message = decode(delivery.topic, delivery.key, delivery.payload)
                self._scene.take(message)
                if isinstance(message, Answered):
                    self._answer(message.ticket, "; ".join(message.refusals))
        late = [t for t, one in self._waiting.items() if self._clock() - one.since_s > PATIENCE_S]
        for ticket in late:
            self._answer(ticket, "the run has not said yet; it heeds the order at its next step")

    def _answer(self, ticket: str, refusal: str) -> None:
        waiting = self._waiting.pop(ticket, None)
        if waiting is not None:
            waiting.page.tell(OrderAnswer(waiting.wish.id, waiting.wish.order, refusal))
