"""Host side of the link to a board: synchronisation, set-up, and the outcome of every packet.

Without I/O, clock and threads: `take` accepts bytes read (or none), `due` returns bytes to write, and `wake`
returns the time of the next call. One exchange synchronises a board from any state: filler that completes any
unfinished command, SYNC, and after its answer address, channel and power, each confirmed by an echo.

The board answers strictly in order. Hence each answer settles all earlier requests: those without an answer
will never get one. The answer to a SYNC settles all packets in flight, as their confirmations precede it. A
packet settled without confirmation is `FrameUnconfirmed`. If a command is overdue, a SYNC is sent early: the
answer of a busy board follows the others; lost bytes become visible.
"""

from collections import Counter, deque
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple

from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import AccessFailure, FrameOverflow, FrameRefused, FrameSent, FrameUnconfirmed, LinkState
from actors.radio.frame import size_fault
from firmware_bridge.beeclick.answer_decoder import (
    COUNTER_NAMES,
    AnswerReader,
    BoardEvent,
    BoardSettings,
    PacketOutcome,
    board_events,
)
from firmware_bridge.beeclick.board_messages import (
    MAX_COMMAND_BYTES,
    PACKET_NUMBERS,
    Answer,
    NoiseError,
    PacketConfirmation,
    SendPacket,
    Setting,
    SyncAnswer,
    SyncCommand,
    encode_command,
)

_FILLER: Final = b"\xff" * MAX_COMMAND_BYTES
"""Bytes before each SYNC, neither a command type nor 00, after which the board would miss the SYNC: enough to
complete any unfinished command on the board; 2.8 ms on the line."""
_SPREAD: Final = 0x9E3779B1
"""2^32 divided by the golden ratio: odd, so that 2^32 packet numbers differ, and unlike typical data."""
_MAX_IN_FLIGHT: Final = 4
"""Maximum number of unconfirmed packets on the board: as the original host library (AbstractComm.java); with
nine the firmware confirms one that it never sent."""
_TRANSMIT_QUEUE: Final = 7
"""Maximum number of packets waiting behind the one being sent, on the board and here: as in the simulated
radio (actors.radio.medium.state)."""
_ANSWER_TIMEOUT: Final = seconds(1.0)
"""Timeout of echoes and confirmations: the button blocks the board for 0.70 s, and four packets take 0.17 s
if each finds the channel busy until its last attempt."""
_DOUBT: Final = milliseconds(250)
"""Time without an answer after which a SYNC is sent; packets wait for its answer. Our choice, above the
0.17 s of four packets in a busy channel."""
_RING: Final = 6
"""Maximum number of unanswered commands, packets and SYNCs included, above `_MAX_IN_FLIGHT`: the board's ring
holds seven, but seven answers after INFO would overflow the ring of answers and hang the board."""
_SYNC_INTERVAL: Final = milliseconds(80)
"""Interval of SYNCs while bytes are received: recovery within 100 ms after noise; longer than the 22 ms of an
answer behind four packets."""
_QUICK_SYNCS: Final = 4
"""Number of SYNCs at that interval without received bytes: a board blocked by its button gets five in 0.70 s;
the seventh would overflow its ring of answers and hang it."""
_SLOW_SYNC_INTERVAL: Final = milliseconds(800)
"""Interval of later SYNCs: slightly longer than the button blocks a board."""
_NOISY_SYNC_INTERVAL: Final = milliseconds(320)
"""Interval of SYNCs if the ring may be full and noise is received; own choice."""
_DEAF_SYNC_INTERVAL: Final = seconds(10.0)
"""Interval of SYNCs to a board that sends although its ring is full; own choice: a reset board is found
within that time, and the ring of a hanging one overflows once per minute."""
_GIVE_UP: Final = seconds(1.0)
"""Time without an answer to SYNCs after which a board counts as silent and its packets as unconfirmed; as
`_ANSWER_TIMEOUT`."""
_PROBE_INTERVAL: Final = milliseconds(250)
"""Time without an answer after which the board is probed; own choice: a board that restarted or lost bytes is
set up again within that and `_DOUBT`."""
_STALL: Final = milliseconds(50)
"""Pause within a message after which it counts as truncated; own choice, above the 16 ms for which USB
adapters buffer bytes."""


class LinkPhase(Enum):
    """State of the link."""

    OFF = "off"
    """No port."""
    SYNCING = "syncing"
    SETTING = "setting"
    """Synchronised; address, channel and power not all confirmed."""
    READY = "ready"


class _PendingCommand(NamedTuple):
    """An unanswered command, with the expected answer."""

    answer: Answer | None
    """Expected answer; None: confirmation of a packet."""
    since: int
    """Time of sending."""
    number: int = -1
    tag: int = -1


class BoardLink:
    """Link to one board."""

    def __init__(self, settings: BoardSettings, drop_bad_fcs: bool = True) -> None:
        """Create it, without a port.

        `drop_bad_fcs`: drop and count packets with a wrong frame check sequence, which were damaged on the
        line. Default: by the firmware's source, not tested with a board; if `bad_fcs` counts every packet of
        a real one, set it to False.
        """
        self.settings = settings
        self.phase = LinkPhase.OFF
        self.counters = Counter(dict.fromkeys(COUNTER_NAMES, 0))
        self._drop_bad_fcs = drop_bad_fcs
        self._reader = AnswerReader()
        self._setup = settings.commands()
        self._pending: deque[_PendingCommand] = deque()
        self._queued: deque[tuple[int, bytes]] = deque()
        self._unsent_settings: deque[Setting] = deque()
        self._events: list[BoardEvent] = []
        self._packets = 0
        """Number of packets sent."""
        self._pace = SyncPacing()
        self._sync_started = self._received_at = self._answered_at = 0
        self._has_timed_out = False
        """True if all SYNCs have timed out; pending commands can then no longer be answered."""
        self._status = LinkStatus(self.counters, self._events)

    @property
    def in_flight(self) -> int:
        """Number of packets sent to the board and not confirmed."""
        return sum(pending.answer is None for pending in self._pending)

    @property
    def waiting(self) -> int:
        """Number of packets not yet sent to the board."""
        return len(self._queued)

    def connect(self, now: Instant) -> None:
        """Start on a newly opened port, without assumptions about the board."""
        assert self.phase is LinkPhase.OFF, "lost() comes before another connect()"
        self._reader.reset()
        # It may be another board: allow a SYNC immediately.
        self._pace = SyncPacing(now - _SYNC_INTERVAL)
        self._status.unconfirmed_packets = 0
        self._begin_sync(now)

    def lost(self, now: Instant) -> list[BoardEvent]:
        """Handle the loss of the port: packets in flight are unconfirmed, others stay queued."""
        self._status.down(now, "lost")
        self.phase = LinkPhase.OFF
        self.counters["lost"] += 1
        self._settle(now, len(self._pending))
        return self._take_events()

    def send(self, now: Instant, tag: int, data: bytes) -> list[BoardEvent]:
        """Queue `data` for broadcast; exactly one PacketOutcome will return `tag`.

        Returned immediately: Refused for more than 118 bytes, Overflow for a full queue.
        """
        if fault := size_fault(len(data)):
            self._add_outcome(FrameRefused(now, tag, fault), "refused")
        elif len(self._queued) + self.in_flight > _TRANSMIT_QUEUE:
            self._add_outcome(FrameOverflow(now, tag), "overflowed")
        else:
            self._queued.append((tag, data))
        return self._take_events()

    def forget(self) -> int:
        """Drop queued packets without a PacketOutcome; return how many. Packets in flight stay."""
        forgotten = len(self._queued)
        self._queued.clear()
        self.counters["forgotten"] += forgotten
        return forgotten

    def take(self, now: Instant, data: bytes = b"") -> list[BoardEvent]:
        """Process bytes read and the passing of time; return the resulting events in order."""
        if self.phase is LinkPhase.OFF:
            return self._take_events()
        if data:
            self._received_at = now
            self._pace.syncs_unheard = 0
            self._reader.feed(data)
        self._read(now)
        if self._check_timeouts(now):
            self._read(now)
        self.counters["junk_bytes"] = self._reader.junk_bytes
        return self._take_events()

    def due(self, now: Instant) -> bytes:
        """Return the bytes to write now; call again after writing them and after each `take`."""
        if self.phase is LinkPhase.OFF:
            return b""
        if self.phase is LinkPhase.SYNCING or self._is_sync_early:
            return self._sync(now) if now >= self._sync_due() else b""
        out = bytearray()
        while self._unsent_settings:
            out += self._send_setting(now, self._unsent_settings.popleft())
        if self.phase is LinkPhase.READY:
            max_in_flight = _MAX_IN_FLIGHT if self._status.is_up else 1
            while self._queued and self.in_flight < max_in_flight and self._pace.has_room:
                out += self._send_packet(now, *self._queued.popleft())
            if not self._pending and now >= self._answered_at + _PROBE_INTERVAL:
                self.counters["probes"] += 1
                out += self._send_setting(now, self._setup[0])
            if now >= self._sync_due():
                out += self._sync(now)
        return bytes(out)

    def wake(self) -> Instant | None:
        """Return the time of the next action if nothing is received; None: none."""
        if self.phase is LinkPhase.OFF:
            return None
        if self.phase is LinkPhase.SYNCING:
            give_up = [] if self._has_timed_out else [self._sync_started + _GIVE_UP]
            return Instant(min([self._sync_due(), *give_up]))
        probe = self._answered_at + _PROBE_INTERVAL
        times = [self._deadline(), self._sync_due()] if self._pending else [probe]
        if self._reader.is_partial:
            times.append(self._received_at + _STALL)
        return Instant(min(times))

    # --- input from the board -----------------------------------------------------------------------------

    def _read(self, now: Instant) -> None:
        while True:
            in_flight = (pending.number for pending in self._pending if pending.answer is None)
            found = self._reader.next(self._is_sync_pending(), in_flight)
            if found is None:
                break
            if isinstance(found, NoiseError):
                self._handle_noise(now, str(found))
            else:
                self._process_answer(now, found)

    def _process_answer(self, now: Instant, answer: Answer) -> None:
        if isinstance(answer, SyncAnswer | PacketConfirmation | Setting):
            self.counters["answers"] += 1
            index = self._pending_index(answer)
            if index is None:
                self._handle_unexpected(now, answer)
            else:
                self._handle_answer(now, answer, index)
        else:
            self._pace.unsolicited += 1
            self._events += board_events(now, answer, self.settings, self.counters, self._drop_bad_fcs)

    def _pending_index(self, answer: Answer) -> int | None:
        """Return the index of the pending command that it answers."""
        number = answer.number if isinstance(answer, PacketConfirmation) else None
        for index, pending in enumerate(self._pending):
            if pending.answer == answer or pending.number == number:
                return index
        return None

    def _handle_answer(self, now: Instant, answer: Answer, index: int) -> None:
        skipped_setting = any(
            pending.answer not in (None, SyncAnswer()) for pending in list(self._pending)[:index]
        )
        self._settle(now, index)
        pending = self._pending.popleft()
        self._answered_at = now
        self._pace.unanswered, self._pace.unsolicited = len(self._pending), 0
        if isinstance(answer, PacketConfirmation):
            if answer.failed:
                self._add_outcome(AccessFailure(now, pending.tag), "failed")
            else:
                self._add_outcome(FrameSent(now, pending.tag), "sent")
            self._status.confirmed(now, self.phase is LinkPhase.READY)
        elif isinstance(answer, SyncAnswer):
            self._handle_sync_answer(now, skipped=index > 0)
        elif skipped_setting:
            self._begin_sync(now, "echo_skipped")
        elif self.phase is LinkPhase.SETTING and not self._unsent_settings and not self._pending:
            self.phase = LinkPhase.READY
            self._status.ready(now)

    def _handle_sync_answer(self, now: Instant, skipped: bool) -> None:
        if self.phase is LinkPhase.READY:
            if not skipped:
                return  # the answer was only delayed
            self.counters["answer_skipped"] += 1
            self._status.down(now, "answer_skipped")
        self.phase = LinkPhase.SETTING
        self._unsent_settings.extend(self._setup)

    def _handle_unexpected(self, now: Instant, answer: Answer) -> None:
        """Handle an answer to no pending command."""
        if isinstance(answer, SyncAnswer):
            self.counters["late_sync"] += 1  # answer to an earlier one of several SYNCs
        elif isinstance(answer, PacketConfirmation) and self._was_used(answer.number):
            self.counters["late_confirmation"] += 1
        elif self.phase is LinkPhase.SYNCING:
            self.counters["late_echo"] += 1
        else:
            cause = "strange_confirmation" if isinstance(answer, PacketConfirmation) else "strange_echo"
            self._handle_noise(now, cause)
            self._reader.aligned = False

    def _handle_noise(self, now: Instant, cause: str) -> None:
        self.counters[cause] += 1
        self._begin_sync(now, cause)

    def _check_timeouts(self, now: Instant) -> bool:
        """Handle timeouts; return True if the reader has to search the buffered bytes."""
        stalled = self._reader.is_partial and now >= self._received_at + _STALL
        if stalled:
            self._reader.aligned = False
            self._handle_noise(now, "stalled")
        if self.phase is LinkPhase.SYNCING:
            if not self._has_timed_out and now >= self._sync_started + _GIVE_UP:
                self._has_timed_out = True
                if self.in_flight:
                    self._status.packet_timed_out(now)
                self._status.silent(now)
                self._settle(now, len(self._pending))
        elif self._pending and now >= self._deadline():
            if self._pending[0].answer is None:
                self._status.packet_timed_out(now)
                self._handle_noise(now, "no_confirmation")
            else:
                self._handle_noise(now, "no_echo")
        return stalled

    def _deadline(self) -> int:
        """Return the deadline of the oldest pending command; shorter in set-up, without packets in flight."""
        timeout_us = _DOUBT if self.phase is LinkPhase.SETTING else _ANSWER_TIMEOUT
        return self._pending[0].since + timeout_us

    # --- output to the board --------------------------------------------------------------------------

    def _begin_sync(self, now: Instant, cause: str = "") -> None:
        """Start synchronising; pending answers are still accepted."""
        if self.phase is LinkPhase.SYNCING:
            return
        self._status.down(now, cause)
        self.phase = LinkPhase.SYNCING
        self._unsent_settings.clear()
        self._has_timed_out = False
        self._sync_started = now

    @property
    def _is_sync_early(self) -> bool:
        """True if a ready board has yet to answer an early SYNC."""
        return self.phase is LinkPhase.READY and self._is_sync_pending()

    def _sync_due(self) -> int:
        """Return when the next SYNC may be sent; for a ready board, after an overdue answer."""
        due = self._pace.last + self._pace.pause(searching=not self._reader.aligned)
        if self.phase is LinkPhase.SYNCING:
            return due
        if not self._pending or not self._pace.has_room or self.phase is LinkPhase.SETTING:
            return 2**62
        since = self._pace.last if self._is_sync_early else self._pending[0].since
        return max(due, since + _DOUBT)

    def _sync(self, now: Instant) -> bytes:
        if not self._is_sync_pending():
            self._pending.append(_PendingCommand(SyncAnswer(), now))
        self.counters["syncs"] += 1
        self._pace.last = now
        self._pace.syncs_unheard += 1
        self._pace.unanswered += 1
        return _FILLER + encode_command(SyncCommand())

    def _is_sync_pending(self) -> bool:
        return bool(self._pending) and self._pending[-1].answer == SyncAnswer()

    def _send_setting(self, now: Instant, command: Setting) -> bytes:
        self._pending.append(_PendingCommand(command, now))
        self._pace.unanswered += 1
        return encode_command(command)

    def _send_packet(self, now: Instant, tag: int, data: bytes) -> bytes:
        number = (self._packets * _SPREAD + self.settings.address) % PACKET_NUMBERS
        self._packets += 1
        self._pending.append(_PendingCommand(None, now, number, tag))
        self._pace.unanswered += 1
        return encode_command(SendPacket(number, data))

    def _was_used(self, number: int) -> bool:
        """Return whether a packet had that number; the numbers of 2^32 packets differ."""
        count = (number - self.settings.address) * pow(_SPREAD, -1, PACKET_NUMBERS) % PACKET_NUMBERS
        return count < self._packets

    # --- outcomes of packets -------------------------------------------------------------------------

    def _settle(self, now: Instant, count: int) -> None:
        """Remove the first `count` pending commands, which can no longer be answered."""
        for _ in range(count):
            pending = self._pending.popleft()
            if pending.answer is None:
                self._add_outcome(FrameUnconfirmed(now, pending.tag), "unconfirmed")

    def _add_outcome(self, outcome: PacketOutcome, counter: str) -> None:
        self.counters[counter] += 1
        self._events.append(outcome)

    def _take_events(self) -> list[BoardEvent]:
        events = self._events.copy()
        self._events.clear()
        return events


@dataclass
class SyncPacing:
    """Timing of SYNCs, by the commands and bytes since the last answer."""

    last: int = 0
    """Time of the last SYNC."""
    syncs_unheard: int = 0
    """SYNCs since the last received byte."""
    unsolicited: int = 0
    """Valid unsolicited messages since the last answer."""
    unanswered: int = 0
    """Commands since the last answer."""

    @property
    def has_room(self) -> bool:
        """True if the board's ring has room for another command."""
        return self.unanswered < _RING

    def pause(self, searching: bool) -> Duration:
        """Return the minimum time between SYNCs; `searching`: received bytes are invalid."""
        if self.has_room:
            return _SYNC_INTERVAL if self.syncs_unheard < _QUICK_SYNCS else _SLOW_SYNC_INTERVAL
        if self.unanswered == _RING:  # one slot is left for a SYNC
            return _SLOW_SYNC_INTERVAL
        if self.unsolicited > 1 and not searching:
            return _DEAF_SYNC_INTERVAL
        if self.syncs_unheard:
            return _SLOW_SYNC_INTERVAL
        return _NOISY_SYNC_INTERVAL if searching else _SYNC_INTERVAL


_MAX_UNCONFIRMED: Final = 2
"""Consecutive packets without outcome after which the radio counts as silent; a single one may be lost on the
line."""


class LinkStatus:
    """Alternating up and down events of a link; `silent` is reported once per outage."""

    def __init__(self, counters: Counter[str], events: list[BoardEvent]) -> None:
        """Create a link that is down; `events`: output list."""
        self._counters = counters
        self._events = events
        self.is_up = False
        self._silent = False
        self.unconfirmed_packets = 0
        """Consecutive packets without outcome."""

    def ready(self, now: Instant) -> None:
        """Report a link that is set up, unless it is up or the radio is suspected to be silent."""
        if not self.is_up and self.unconfirmed_packets < _MAX_UNCONFIRMED:
            self.is_up, self._silent = True, False
            self._counters["ups"] += 1
            self._events.append(LinkState(now, True, ""))

    def confirmed(self, now: Instant, ready: bool) -> None:
        """Handle the outcome of a packet."""
        self.unconfirmed_packets = 0
        if ready:
            self.ready(now)

    def packet_timed_out(self, now: Instant) -> None:
        """Handle the timeout of a packet."""
        self.unconfirmed_packets += 1
        if self.unconfirmed_packets >= _MAX_UNCONFIRMED:
            self.silent(now)

    def down(self, now: Instant, cause: str) -> None:
        """Report a lost board, if the link was up."""
        if self.is_up:
            self.is_up = False
            self._events.append(LinkState(now, False, cause))

    def silent(self, now: Instant) -> None:
        """Report a silent board or radio, once."""
        self.is_up = False
        if not self._silent:
            self._silent = True
            self._counters["silent"] += 1
            self._events.append(LinkState(now, False, "silent"))
