"""The bridge to a radio board as an actor: the simulated radio's twin, for one robot.

Frames of the robot go to the board at their instants. What the board has said since the last step is handed
over when the base opens the next one with Truth: Received to the robot, and to the base how many events that
carries.
"""

import heapq
from collections.abc import Sequence
from typing import Final

from actors.board import BoardNote, Fix, Humidity, Info, LinkState, Temperature
from actors.instant import Instant
from actors.messages import (
    AIRED,
    BOARD,
    RECEIVED,
    TRANSMIT,
    TRUTH,
    AccessFailure,
    Aired,
    Board,
    EventCount,
    Heard,
    Overflow,
    RadioEvent,
    Received,
    Refused,
    Sent,
    Transmit,
    Truth,
    Unconfirmed,
)
from actors.runtime.core import Address, Inputs, Output, at, to
from firmware_bridge.beeclick import events
from firmware_bridge.beeclick.link import Link

MOST_EVENTS: Final = 256
"""Events held for a robot that takes none; about what a busy channel brings in a second."""
MOST_PLANNED: Final = 256
"""Frames that may wait for their instants."""


class BridgeCore:
    """One robot's board; `expect` announces each message, bytes come by `hear`, and go by `due`."""

    def __init__(self, robot: str, link: Link) -> None:
        self.now = Instant(0)
        self.finished = False
        self.step = 0
        self._robot = robot
        self._link = link
        self._planned: list[tuple[int, int, int, bytes]] = []
        self._added = 0
        self._held: list[RadioEvent] = []
        self._notes: list[BoardNote] = []
        self._expected: Address | None = None
        self.dropped_events = self.dropped_frames = 0

    @property
    def wake(self) -> Instant | None:
        """When something is due if nothing comes before; None: nothing is."""
        due = [self._planned[0][0]] if self._planned else []
        link = self._link.wake()
        due += [] if link is None else [link]
        return Instant(min(due)) if due else None

    def listens(self) -> Sequence[Address]:
        """Every address that a message may come in on."""
        return (at(TRUTH), at(TRANSMIT, self._robot))

    def expect(self, key: str) -> None:
        """The next advance takes the message that has come on that key."""
        self._expected = next(address for address in self.listens() if address.key == key)

    def missing(self, have: Inputs) -> Sequence[Address]:
        """What was announced by `expect`."""
        expected = self._expected
        return () if expected is None or expected.key in have else (expected,)

    def advance(self, inputs: Inputs) -> Sequence[Output]:
        """Take in one message; without one, give the news for people."""
        self._expected = None
        for message in inputs.values():
            if isinstance(message, Transmit):
                self._plan(message)
            elif isinstance(message, Truth):
                return self._truth(message)
        notes, self._notes = tuple(self._notes), []
        return (to(BOARD, Board(self.step, notes)),) if notes else ()

    @property
    def has_news(self) -> bool:
        """True if an advance without a message has something to give."""
        return bool(self._notes)

    def hear(self, data: bytes) -> None:
        """Take in what the port has given, also nothing, and the passing of time."""
        self._note(self._link.take(self.now, data))

    def lost(self) -> None:
        """The port has gone."""
        self._note(self._link.lost(self.now))

    def due(self) -> bytes:
        """What is to be written to the port now."""
        while self._planned and self._planned[0][0] <= self.now:
            _, _, tag, data = heapq.heappop(self._planned)
            self._note(self._link.send(self.now, tag, data))
        return self._link.due(self.now)

    def outcome(self) -> dict[str, object]:
        """What has been counted."""
        return {
            "board": self._link.counters.as_dict(),
            "frames": {"events_dropped": self.dropped_events, "frames_dropped": self.dropped_frames},
        }

    def _plan(self, transmit: Transmit) -> None:
        for frame in transmit.frames:
            if len(self._planned) >= MOST_PLANNED:
                self.dropped_frames += 1
                self._hold(Overflow(self.now, frame.tag))
                continue
            self._added += 1
            heapq.heappush(self._planned, (frame.instant, self._added, frame.tag, frame.data))

    def _truth(self, truth: Truth) -> Sequence[Output]:
        if truth.halt:
            self.finished = True
            return ()
        self.step = truth.step + 1
        held, self._held = tuple(self._held), []
        if not held:
            return (to(AIRED, Aired(truth.step, ())),)
        received = to(RECEIVED, Received(truth.step + 1, held), self._robot)
        return (received, to(AIRED, Aired(truth.step, (EventCount(self._robot, len(held)),))))

    def _note(self, told: Sequence[events.Event]) -> None:
        for event in told:
            match event:
                case Heard() | Sent() | AccessFailure() | Overflow() | Refused():
                    self._hold(event)
                case events.Unconfirmed(instant, tag):
                    self._hold(Unconfirmed(instant, tag))
                case _:
                    self._notes.append(_news(event))

    def _hold(self, event: RadioEvent) -> None:
        if len(self._held) >= MOST_EVENTS:
            self.dropped_events += 1
        else:
            self._held.append(event)


_News = events.Up | events.Down | events.Fix | events.Temperature | events.Humidity | events.Info


def _news(event: _News) -> BoardNote:
    match event:
        case events.Up(instant):
            return LinkState(instant, True, "")
        case events.Down(instant, cause):
            return LinkState(instant, False, cause)
        case events.Fix(instant, valid, latitude, longitude):
            return Fix(instant, valid, latitude, longitude)
        case events.Temperature(instant, celsius, valid):
            return Temperature(instant, celsius, valid)
        case events.Humidity(instant, percent, valid):
            return Humidity(instant, percent, valid)
        case events.Info(instant, text):
            return Info(instant, text)
