"""The page's side of a run: what the run says, looked at now and then, and the orders that pages give."""

import secrets
import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from actors.messages import ANSWERED, CONTROL, DRIVE, FLOOR_NEWS, PROGRESS, RECEIVED, TRUTH, Answered, Control
from actors.runtime.codec import decode, encode
from actors.runtime.core import Bus, at
from actors.runtime.errors import AcrcError
from deploy.control.scene import Scene
from deploy.run import orders

KEPT: Final = 100
"""Lines; older ones are forgotten."""
TOPICS: Final = (DRIVE, RECEIVED, FLOOR_NEWS, TRUTH, CONTROL, ANSWERED, PROGRESS)
"""In this order they are looked at: an order comes before its answer."""
LISTENS: Final = tuple(at(topic, "*" if "{id}" in topic.pattern else "") for topic in TOPICS)
WAITING: Final = 256
"""Orders that may wait for an answer of the run."""
PATIENCE_S: Final = 10.0
"""After so long pages are told that the run has not said yet what becomes of an order."""


class OrderLine(msgspec.Struct, tag_field="kind", tag="said"):
    """One line of the list of orders: equal ones in a row, or those of one series; it shows the last one."""

    number: int
    order: str
    times: int = 0
    """How many orders it stands for; of them, how many wait for an answer, and how many were refused."""
    waiting: int = 0
    refused: int = 0
    refusal: str = ""
    version: int = 0
    """Grows with each change of any line."""


class RunLink:
    """Keeps a scene up with a run; `looks` rather loses messages than holds anybody up."""

    def __init__(
        self, scene: Scene, looks: Bus, speaks: Bus, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._scene, self._looks, self._speaks, self._clock = scene, looks, speaks, clock
        self.lines: deque[OrderLine] = deque(maxlen=KEPT)
        self.version = self._begun = self._series = 0
        self._waiting: dict[str, tuple[OrderLine, float]] = {}
        """By ticket: the line, and since when."""

    def give(self, words: str, series: int = 0) -> None:
        """Give the run an order, as typed behind `acrc order RUN`; those of a series, not 0, are one line."""
        line = self.lines[-1] if self.lines else None
        if line is None or not (words == line.order or (series and series == self._series)):
            self._begun += 1
            line = OrderLine(self._begun, words)
            self.lines.append(line)
        self._series, line.order, line.times = series, words, line.times + 1
        self._change(line, waiting=1)
        try:
            verb, *rest = words.split() or [""]
            order = orders.parse(verb, rest)
            if self._scene.over or len(self._waiting) >= WAITING:
                raise AcrcError("the run is over" if self._scene.over else "too many orders wait already")
        except AcrcError as error:
            self._change(line, waiting=-1, refusal=str(error))
            return
        ticket = secrets.token_hex(8)
        self._waiting[ticket] = line, self._clock()
        self._speaks.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def look(self) -> None:
        """Take in all that has come; of what transceivers received, the newest message of each."""
        for address in LISTENS:
            come = []
            while (delivery := self._looks.poll(address.topic)) is not None:
                come.append(delivery)
            for one in {one.key: one for one in come}.values() if address.topic is RECEIVED else come:
                message = decode(one.topic, one.key, one.payload)
                self._scene.take(one.key, message)
                if isinstance(message, Answered):
                    self._answer(message.ticket, "; ".join(message.refusals))
        late = [one for one, (_, since) in self._waiting.items() if self._clock() - since > PATIENCE_S]
        for ticket in late:
            self._answer(ticket, "the run has not said yet; it heeds the order at its next step")

    def _answer(self, ticket: str, refusal: str) -> None:
        if ticket in self._waiting:
            self._change(self._waiting.pop(ticket)[0], waiting=-1, refusal=refusal)

    def _change(self, line: OrderLine, *, waiting: int, refusal: str = "") -> None:
        self.version += 1
        line.version, line.waiting = self.version, line.waiting + waiting
        line.refused, line.refusal = line.refused + bool(refusal), refusal or line.refusal
