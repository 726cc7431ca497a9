"""Links, boards and the lines between them in virtual time: for tests and for measuring."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from actors.instant import Duration, Instant, milliseconds
from firmware_bridge.beeclick.air import EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.link import BoardLink
from firmware_bridge.beeclick.reception import Event
from firmware_bridge.device_lines import CLEAN, Disturbance

_KEPT: Final = 100_000
"""Events of a desk; older ones are forgotten."""
_POLL: Final = milliseconds(1)


@dataclass
class Desk:
    """A host with its board, and the line between them."""

    link: BoardLink
    board: EmulatedBoard
    to_board: Disturbance = CLEAN
    to_host: Disturbance = CLEAN
    plugged: bool = True
    events: deque[Event] = field(default_factory=lambda: deque(maxlen=_KEPT))
    written: int = 0
    """Bytes, by the host."""
    come: int = 0
    """Bytes, to the host."""

    def serve(self, now: Instant, rng: np.random.Generator) -> None:
        """What a host does once in a while: take what has come, write what is due."""
        come = self.to_host.apply(self.board.run(now), rng)
        if not self.plugged:
            return
        self.come += len(come)
        self.events.extend(self.link.take(now, come))
        if out := self.link.due(now):
            self.written += len(out)
            self.board.take(now, self.to_board.apply(out, rng))

    def send(self, now: Instant, tag: int, data: bytes) -> None:
        """Hand the link a packet."""
        self.events.extend(self.link.send(now, tag, data))

    def unplug(self, now: Instant) -> None:
        """Pull the cable on the host's side; the board goes on."""
        self.plugged = False
        self.events.extend(self.link.lost(now))

    def plug(self, now: Instant) -> None:
        """Put it in again."""
        self.plugged = True
        self.link.connect(now)

    def of(self, *kinds: type[Event]) -> list[Event]:
        """The events of these kinds."""
        return [event for event in self.events if isinstance(event, kinds)]


class Lab:
    """Desks in one room; hosts look after their lines at fixed times."""

    def __init__(
        self,
        air: EmulatedAir,
        desks: Sequence[Desk],
        rng: np.random.Generator,
        poll: Duration = _POLL,
    ) -> None:
        self.now = Instant(0)
        self.desks = desks
        self._air = air
        self._rng = rng
        self._poll = poll
        for desk in desks:
            desk.link.connect(self.now)

    def run(self, duration: Duration) -> None:
        """Let so much time pass."""
        until = self.now + duration
        while self.now < until:
            self.now = Instant(min(self.now + self._poll, until))
            self._air.advance(self.now)
            for desk in self.desks:
                desk.serve(self.now, self._rng)
