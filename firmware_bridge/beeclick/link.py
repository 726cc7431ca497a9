"""The host's end of the line to a board: keeps it in step and set up, and knows what became of every packet.

Without I/O, clock and threads: `take` gets what the port has given (also nothing), `due` gives what it is to
be given, `wake` says when to come again. One exchange brings a board into step, whatever state it and the
line are in: filler that ends any command which the board believes to be in, SYNC, and once that is answered
address, channel and power, each confirmed by its echo.

The board works strictly in order, and so are its answers. Hence each answer settles all that was asked
before: whatever of that has not been answered yet never will be. In particular the answer to a SYNC settles
the packets that were in flight, after their confirmations, which come first. A packet that is settled
without a confirmation is `UnconfirmedPacket`; nothing is ever guessed. A board that lets a command wait is
sent a SYNC ahead of time: if it is only held up the answer comes behind the others, and lost bytes show by
it.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Final

from actors.instant import Instant
from actors.messages import AccessFailure, Overflow, Refused, Sent
from actors.radio.frame import size_fault
from firmware_bridge.beeclick.answers import Answer, PacketSent, Synchronised
from firmware_bridge.beeclick.commands import SendPacket, Setting, Synchronise, encode
from firmware_bridge.beeclick.counters import LinkCounters
from firmware_bridge.beeclick.events import Event, UnconfirmedPacket
from firmware_bridge.beeclick.news import news
from firmware_bridge.beeclick.pace import SendingPace
from firmware_bridge.beeclick.parameters import DEFAULTS, BeeClickParameters, BoardSettings
from firmware_bridge.beeclick.reader import Reader
from firmware_bridge.beeclick.standing import LinkStanding
from firmware_bridge.beeclick.wire import NUMBER_END, NoiseError

_FILLER: Final = b"\xff"
"""No type of command; and not 00, after which the board would miss the SYNC."""
_SPREAD: Final = 0x9E3779B1
"""Odd, so that the numbers of 2^32 packets differ; 2^32 by the golden ratio, so that none looks like data."""


class LinkPhase(Enum):
    """How far the link is."""

    OFF = "off"
    """There is no port."""
    SYNCING = "syncing"
    SETTING = "setting"
    """In step; address, channel and power are not all confirmed."""
    READY = "ready"


@dataclass(frozen=True)
class _Packet:
    tag: int
    data: bytes


@dataclass(frozen=True)
class _Asked:
    """A command on its way, with the answer that it is to get."""

    answer: Answer | None
    """None: a packet, whose answer has a status."""
    since: int
    """When it was sent."""
    number: int = -1
    tag: int = -1


class BoardLink:
    """One board, as its host sees it."""

    def __init__(self, settings: BoardSettings, parameters: BeeClickParameters = DEFAULTS) -> None:
        self.settings = settings
        self.phase = LinkPhase.OFF
        self.counters = LinkCounters()
        self._p = parameters
        self._reader = Reader()
        self._setup = settings.commands()
        self._asked: deque[_Asked] = deque()
        self._waiting: deque[_Packet] = deque()
        self._to_set: deque[Setting] = deque()
        self._events: list[Event] = []
        self._packets = 0
        """How many numbers have been used."""
        self._pace = SendingPace(parameters)
        self._sync_began = self._heard_at = self._answered_at = 0
        self._given_up = False
        """No SYNC has been answered for so long that nothing of what the board has will be."""
        self._standing = LinkStanding(self.counters, self._events)

    @property
    def in_flight(self) -> int:
        """Packets that the board has and has not confirmed."""
        return sum(asked.answer is None for asked in self._asked)

    @property
    def waiting(self) -> int:
        """Packets that the board has not been given."""
        return len(self._waiting)

    def connect(self, now: Instant) -> None:
        """A port has been opened; whatever was known of the board is forgotten."""
        assert self.phase is LinkPhase.OFF, "lost() comes before another connect()"
        self._reader.reset()
        self._pace.connected(now)
        self._standing.connected()
        self._begin_sync(now)

    def lost(self, now: Instant) -> list[Event]:
        """The port has gone; packets in flight are unconfirmed, those that wait go on waiting."""
        self._standing.down(now, "lost")
        self.phase = LinkPhase.OFF
        self.counters.add("lost")
        self._settle(now, len(self._asked), "lost")
        return self._given()

    def send(self, now: Instant, tag: int, data: bytes) -> list[Event]:
        """Broadcast `data`, in its turn; `tag` comes back in exactly one PacketEnd, if not at once.

        Refused if it has more than 118 bytes, Overflow if too many wait; then it is out of it.
        """
        if fault := size_fault(len(data)):
            self._end(Refused(now, tag, fault), "refused")
        elif len(self._waiting) + self.in_flight > self._p.transmit_queue:
            self._end(Overflow(now, tag), "overflowed")
        else:
            self._waiting.append(_Packet(tag, data))
        return self._given()

    def forget(self) -> int:
        """Drop the packets that wait, without a PacketEnd: how many. What the board has, it keeps."""
        forgotten = len(self._waiting)
        self._waiting.clear()
        self.counters.add("forgotten", forgotten)
        return forgotten

    def take(self, now: Instant, data: bytes = b"") -> list[Event]:
        """What the port has given, and the passing of time: what follows from both, in order."""
        if self.phase is LinkPhase.OFF:
            return self._given()
        if data:
            self._heard_at = now
            self._pace.heard()
            self._reader.feed(data)
        self._read(now)
        if self._expire(now):
            self._read(now)
        self.counters["junk_bytes"] = self._reader.junk_bytes
        return self._given()

    def due(self, now: Instant) -> bytes:
        """What is to be written now; ask again once it is with the port, and after each `take`."""
        if self.phase is LinkPhase.OFF:
            return b""
        if self.phase is LinkPhase.SYNCING or self._doubted:
            return self._sync(now) if now >= self._sync_due() else b""
        out = bytearray()
        while self._to_set:
            out += self._ask(now, self._to_set.popleft())
        if self.phase is LinkPhase.READY:
            most = self._p.in_flight if self._standing.is_up else 1
            while self._waiting and self.in_flight < most and self._pace.has_room:
                out += self._ask_packet(now, self._waiting.popleft())
            if not self._asked and now >= self._answered_at + self._p.probe_interval:
                self.counters.add("probes")
                out += self._ask(now, self._setup[0])
            if now >= self._sync_due():
                out += self._sync(now)
        return bytes(out)

    def wake(self) -> Instant | None:
        """When something is due if nothing comes before; None: nothing is."""
        if self.phase is LinkPhase.OFF:
            return None
        if self.phase is LinkPhase.SYNCING:
            give_up = [] if self._given_up else [self._sync_began + self._p.give_up]
            return Instant(min([self._sync_due(), *give_up]))
        times = [self._deadline(), self._sync_due()] if self._asked else []
        times = times or [self._answered_at + self._p.probe_interval]
        if self._reader.partial:
            times.append(self._heard_at + self._p.stall)
        return Instant(min(times))

    # --- what the board says -----------------------------------------------------------------------------

    def _read(self, now: Instant) -> None:
        while True:
            in_flight = (asked.number for asked in self._asked if asked.answer is None)
            found = self._reader.next(self._sync_asked(), in_flight)
            if found is None:
                break
            if isinstance(found, NoiseError):
                self._noise(now, str(found))
            else:
                self._answer(now, found)

    def _answer(self, now: Instant, answer: Answer) -> None:
        if isinstance(answer, Synchronised | PacketSent | Setting):
            self.counters.add("answers")
            place = self._place(answer)
            if place is None:
                self._unasked(now, answer)
            else:
                self._answered(now, answer, place)
        else:
            self._pace.told()
            self._events += news(now, answer, self.settings, self.counters, self._p.drop_bad_fcs)

    def _place(self, answer: Answer) -> int | None:
        """Which of the commands on their way it answers."""
        for place, asked in enumerate(self._asked):
            if asked.answer == answer:
                return place
            if isinstance(answer, PacketSent) and answer.number == asked.number:
                return place
        return None

    def _answered(self, now: Instant, answer: Answer, place: int) -> None:
        skipped_setting = any(
            asked.answer not in (None, Synchronised()) for asked in list(self._asked)[:place]
        )
        self._settle(now, place, "answer_skipped")
        asked = self._asked.popleft()
        self._answered_at = now
        self._pace.answered(len(self._asked))
        if isinstance(answer, PacketSent):
            self._confirmed(now, asked.tag, answer.failed)
        elif isinstance(answer, Synchronised):
            self._synchronised(now, skipped=place > 0)
        elif skipped_setting:
            self._begin_sync(now, "echo_skipped")
        elif self.phase is LinkPhase.SETTING and not self._to_set and not self._asked:
            self.phase = LinkPhase.READY
            self._standing.ready(now)

    def _confirmed(self, now: Instant, tag: int, failed: bool) -> None:
        self._end(AccessFailure(now, tag) if failed else Sent(now, tag), "failed" if failed else "sent")
        self._standing.confirmed(now, self.phase is LinkPhase.READY)

    def _synchronised(self, now: Instant, skipped: bool) -> None:
        if self.phase is LinkPhase.READY:
            if not skipped:
                return  # it was held up, and no more
            self.counters.add("answer_skipped")
            self._standing.down(now, "answer_skipped")
        self.phase = LinkPhase.SETTING
        self._to_set.extend(self._setup)

    def _unasked(self, now: Instant, answer: Answer) -> None:
        """An answer to nothing that is on its way."""
        if isinstance(answer, Synchronised):
            self.counters.add("late_sync")  # to an earlier one of several
        elif isinstance(answer, PacketSent) and self._was_used(answer.number):
            self.counters.add("late_confirmation")
        elif self.phase is LinkPhase.SYNCING:
            self.counters.add("late_echo")
        else:
            cause = "strange_confirmation" if isinstance(answer, PacketSent) else "strange_echo"
            self._noise(now, cause)
            self._reader.search()

    def _noise(self, now: Instant, cause: str) -> None:
        self.counters.add(cause)
        self._begin_sync(now, cause)

    def _expire(self, now: Instant) -> bool:
        """See what has lasted too long; True if bytes are to be read in another way."""
        stalled = self._reader.partial and now >= self._heard_at + self._p.stall
        if stalled:
            self._reader.search()
            self._noise(now, "stalled")
        if self.phase is LinkPhase.SYNCING:
            if not self._given_up and now >= self._sync_began + self._p.give_up:
                self._given_up = True
                if self.in_flight:
                    self._standing.fruitless(now)
                self._standing.silent(now)
                self._settle(now, len(self._asked), "silent")
        elif self._asked and now >= self._deadline():
            if self._asked[0].answer is None:
                self._standing.fruitless(now)
                self._noise(now, "no_confirmation")
            else:
                self._noise(now, "no_echo")
        return stalled

    def _deadline(self) -> int:
        """When what was asked first has waited for too long; the set-up has no packets to wait for."""
        patience = self._p.doubt if self.phase is LinkPhase.SETTING else self._p.answer_timeout
        return self._asked[0].since + patience

    # --- what the board is told --------------------------------------------------------------------------

    def _begin_sync(self, now: Instant, cause: str = "") -> None:
        """Find the board again; its answers so far are still taken."""
        if self.phase is LinkPhase.SYNCING:
            return
        self._standing.down(now, cause)
        self.phase = LinkPhase.SYNCING
        self._to_set.clear()
        self._given_up = False
        self._sync_began = now

    @property
    def _doubted(self) -> bool:
        """True while a board that is ready has a SYNC to answer, ahead of time."""
        return self.phase is LinkPhase.READY and self._sync_asked()

    def _sync_due(self) -> int:
        """When the next SYNC may be sent; of a board that is ready, once it has let something wait."""
        due = self._pace.due(not self._reader.aligned)
        if self.phase is LinkPhase.SYNCING:
            return due
        if not self._asked or not self._pace.has_room or self.phase is LinkPhase.SETTING:
            return 2**62
        since = self._pace.last if self._doubted else self._asked[0].since
        return max(due, since + self._p.doubt)

    def _sync(self, now: Instant) -> bytes:
        if not self._sync_asked():
            self._asked.append(_Asked(Synchronised(), now))
        self.counters.add("syncs")
        self._pace.synchronising(now)
        return _FILLER * self._p.filler + encode(Synchronise())

    def _sync_asked(self) -> bool:
        return bool(self._asked) and self._asked[-1].answer == Synchronised()

    def _ask(self, now: Instant, command: Setting) -> bytes:
        self._asked.append(_Asked(command, now))
        self._pace.asked()
        return encode(command)

    def _ask_packet(self, now: Instant, packet: _Packet) -> bytes:
        number = (self._packets * _SPREAD + self.settings.address) % NUMBER_END
        self._packets += 1
        self._asked.append(_Asked(None, now, number, packet.tag))
        self._pace.asked()
        return encode(SendPacket(number, packet.data))

    def _was_used(self, number: int) -> bool:
        """Has a packet had that number? Those of 2^32 packets differ."""
        count = (number - self.settings.address) * pow(_SPREAD, -1, NUMBER_END) % NUMBER_END
        return count < self._packets

    # --- what becomes of packets -------------------------------------------------------------------------

    def _settle(self, now: Instant, count: int, cause: str) -> None:
        """The first `count` commands on their way will not be answered any more."""
        for _ in range(count):
            asked = self._asked.popleft()
            if asked.answer is None:
                self._end(UnconfirmedPacket(now, asked.tag, cause), "unconfirmed")

    def _end(self, end: Sent | AccessFailure | UnconfirmedPacket | Overflow | Refused, counter: str) -> None:
        self.counters.add(counter)
        self._events.append(end)

    def _given(self) -> list[Event]:
        events = self._events.copy()
        self._events.clear()
        return events
