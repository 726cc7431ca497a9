"""What people have been told of a board: that it is up, that it is down, that it is silent."""

from typing import Final

from actors.board_readings import LinkState
from actors.instant import Instant
from firmware_bridge.beeclick.counters import LinkCounters
from firmware_bridge.beeclick.events import Event

_FRUITLESS: Final = 2
"""After so many packets in a row of which nothing has become the radio counts as silent, though the board is
not: one may be lost on the line."""


class LinkStanding:
    """Up and Down in turns, however often a board is found and lost; silent once, until it is up again."""

    def __init__(self, counters: LinkCounters, events: list[Event]) -> None:
        """`events`: where what is said goes."""
        self._counters = counters
        self._events = events
        self.is_up = False
        self._silent = False
        self._fruitless = 0

    def ready(self, now: Instant) -> None:
        """The board is set up; it is up unless its radio has to be heard of first."""
        if self._fruitless < _FRUITLESS:
            self._up(now)

    def confirmed(self, now: Instant, ready: bool) -> None:
        """Something has become of a packet."""
        self._fruitless = 0
        if ready and not self.is_up:
            self._up(now)

    def fruitless(self, now: Instant) -> None:
        """Nothing has become of a packet for too long."""
        self._fruitless += 1
        if self._fruitless >= _FRUITLESS:
            self.silent(now)

    def down(self, now: Instant, cause: str) -> None:
        """The board must be found again."""
        if self.is_up:
            self.is_up = False
            self._events.append(LinkState(now, False, cause))

    def silent(self, now: Instant) -> None:
        """It has not answered for long, or nothing becomes of its packets."""
        self.is_up = False
        if not self._silent:
            self._silent = True
            self._counters.add("silent")
            self._events.append(LinkState(now, False, "silent"))

    def connected(self) -> None:
        """Another board, perhaps."""
        self._fruitless = 0

    def _up(self, now: Instant) -> None:
        self.is_up, self._silent = True, False
        self._counters.add("ups")
        self._events.append(LinkState(now, True, ""))
