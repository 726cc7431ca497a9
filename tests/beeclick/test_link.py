"""Link to a radio board: set-up, packets, noise, silence, readings, and long runs on a noisy line."""

import itertools
from collections import Counter
from collections.abc import Callable
from enum import IntEnum

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.instant import START, Instant, milliseconds, seconds
from actors.messages import (
    AccessFailure,
    BoardText,
    FrameOverflow,
    FrameReceived,
    FrameRefused,
    FrameSent,
    FrameUnconfirmed,
    GpsFix,
    Humidity,
    LinkState,
    Temperature,
)
from actors.radio.frame import DataFrame, octets
from actors.radio.medium import Medium, SaturatedTraffic
from actors.radio.radio_model import RadioSetup, radio_model
from firmware_bridge.beeclick.answer_decoder import BoardEvent, BoardSettings
from firmware_bridge.beeclick.board_link import BoardLink, LinkPhase
from firmware_bridge.beeclick.board_messages import (
    SYNC_PATTERN,
    Answer,
    BoardInfo,
    GpsSentence,
    HumidityReading,
    PacketConfirmation,
    ReceivedPacket,
    SetAddress,
    SetChannel,
    SetPower,
    TemperatureReading,
    byte_time,
)
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulated_medium import DeviceMedium, EmulatedMedium
from firmware_bridge.device_lines import NO_NOISE, LineNoise
from tests.beeclick.lab import ECHOES, SYNC, BoardHost, Host, Lab, confirm, said


def packet(data: bytes, pan: int = 0xBABA, address: int = 7) -> ReceivedPacket:
    return ReceivedPacket(pan, address, 138, 200, DataFrame(pan, address, data).check, data)


def test_a_link_starts_with_sync_and_set_up_confirmed_by_echoes() -> None:
    host = Host()
    assert host.due() == SYNC
    assert host.due() == b""
    assert host.hear(SYNC_PATTERN, after=6_000) == []
    assert host.commands() == [SetAddress(0xBABA, 0x0103), SetChannel(15), SetPower(-100)]
    assert host.hear(*ECHOES[:2]) == []
    assert host.link.phase is LinkPhase.SETTING
    assert host.hear(ECHOES[2]) == [LinkState(host.now, True, "")]
    counted = {name: count for name, count in host.link.counters.items() if count}
    assert counted == {"answers": 4, "syncs": 1, "ups": 1}


def test_a_missing_echo_restarts_the_synchronisation() -> None:
    host = Host()
    host.due()
    host.hear(SYNC_PATTERN)
    host.due()
    host.hear(ECHOES[0], ECHOES[2])
    assert host.link.phase is LinkPhase.SYNCING
    host.hear(after=80_000)
    assert host.due() == SYNC


def test_at_most_four_packets_are_in_flight() -> None:
    host = Host().get_ready()
    numbers = host.send(0, 1, 2, 3, 4, 5)
    assert len(set(numbers)) == 4
    assert (host.link.in_flight, host.link.waiting) == (4, 2)
    assert host.hear(confirm(numbers[0])) == [FrameSent(host.now, 0)]
    (fifth,) = host.send()
    assert host.hear(*(confirm(n) for n in [*numbers[1:], fifth])) == [
        FrameSent(host.now, t) for t in (1, 2, 3, 4)
    ]


def test_a_packet_of_the_wrong_size_or_beyond_the_queue_is_dropped() -> None:
    host = Host().get_ready()
    (refused,) = host.link.send(host.now, 1, bytes(119))
    assert isinstance(refused, FrameRefused) and host.due() == b"" and host.link.counters["refused"] == 1
    events = [event for tag in range(10) for event in host.link.send(host.now, tag, b"x")]
    assert events == [FrameOverflow(host.now, 8), FrameOverflow(host.now, 9)]
    assert len(host.send()) == 4
    assert host.link.send(host.now, 10, b"x") == [FrameOverflow(host.now, 10)]
    assert host.link.counters["overflowed"] == 3


def test_a_later_confirmation_settles_the_earlier_packets() -> None:
    host = Host().get_ready()
    first, second = host.send(1, 2)
    assert host.hear(confirm(second)) == [FrameUnconfirmed(host.now, 1), FrameSent(host.now, 2)]
    assert host.hear(confirm(first), confirm(second)) == []  # never twice
    assert host.link.counters["late_confirmation"] == 2
    assert host.link.phase is LinkPhase.READY


def test_a_confirmation_of_an_unknown_packet_is_noise() -> None:
    host = Host().get_ready()
    host.send(1)
    events = host.hear(PacketConfirmation(0x12345678, failed=False))
    assert events == [LinkState(host.now, False, "strange_confirmation")]
    assert host.link.counters["strange_confirmation"] == 1
    assert host.link.phase is LinkPhase.SYNCING


HEAD = b"\x01\x70\xba\xba\x07\x00\x8a\xc8\x00\x00"
"""Header of a packet whose 112 bytes of data are missing."""


def test_an_answer_that_contains_the_sync_answer_is_discarded() -> None:
    host = Host().get_ready()
    numbers = host.send(1, 2, 3)
    assert host.hear(after=seconds(1)) == [LinkState(host.now, False, "no_confirmation")]
    assert host.due() == SYNC
    assert host.hear(confirm(numbers[0], failed=True), HEAD, confirm(numbers[1]), SYNC_PATTERN) == [
        AccessFailure(host.now, 1),
        FrameSent(host.now, 2),
        FrameUnconfirmed(host.now, 3),
    ]
    assert host.link.counters["swallowed_sync"] == 1
    assert len(host.commands()) == 3


def test_a_truncated_answer_is_discarded() -> None:
    host = Host().get_ready()
    (number,) = host.send(1)
    assert host.hear(HEAD, confirm(number), after=10) == []
    assert host.link.wake() == host.now + milliseconds(50)
    assert host.hear(after=milliseconds(50)) == [
        LinkState(host.now, False, "stalled"),
        FrameSent(host.now, 1),
    ]


def test_a_board_that_lost_synchronisation_is_found_by_probing() -> None:
    host = Host().get_ready()
    assert host.link.wake() == host.now + milliseconds(250)
    host.hear(
        packet(b"news"), after=milliseconds(250)
    )  # received packets do not prove that the board accepts commands
    assert host.commands() == [SetAddress(0xBABA, 0x0103)]
    assert host.hear(after=milliseconds(250)) == []
    assert host.due() == SYNC
    assert host.hear(SYNC_PATTERN, after=5_000) == [LinkState(host.now, False, "answer_skipped")]
    assert len(host.commands()) == 3
    assert host.hear(*ECHOES) == [LinkState(host.now, True, "")]
    assert host.link.counters["probes"] == 1


def test_a_slow_board_is_not_down_and_loses_no_packets() -> None:
    """A board blocked for 0.7 s, as by its button, gets two early SYNCs and no further packets."""
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4)
    syncs = []
    for _ in range(70):
        assert host.hear(after=10_000) == []
        host.link.send(host.now, 5, b"x") if host.now == 600_000 else None
        if host.due():
            syncs.append(host.now)
    assert syncs == [250_000, 500_000], "with four packets six commands, the limit of the board's ring"
    assert host.hear(*map(confirm, numbers), SYNC_PATTERN, SYNC_PATTERN) == [
        FrameSent(host.now, tag) for tag in (1, 2, 3, 4)
    ]
    assert host.link.phase is LinkPhase.READY and host.link.counters["late_sync"] == 1
    assert len(host.send()) == 1


def test_a_silent_board_is_reported_once_and_probed_further() -> None:
    host = Host().get_ready()
    host.send(1)
    host.link.send(host.now, 9, b"later")
    host.due()
    events, syncs = [], []
    for _ in range(80):
        events += host.hear(after=50_000)
        if host.due():
            syncs.append(host.now)
    assert events == [
        LinkState(Instant(1_000_000), False, "no_confirmation"),
        LinkState(Instant(2_000_000), False, "silent"),
        FrameUnconfirmed(Instant(2_000_000), 1),
        FrameUnconfirmed(Instant(2_000_000), 9),
    ]
    assert syncs == [250_000, 500_000, 750_000, 1_000_000, 1_800_000, 2_600_000, 3_400_000]
    host.hear(SYNC_PATTERN)
    assert len(host.commands()) == 3
    assert host.hear(*ECHOES) == [], "its radio is not confirmed yet"
    (number,) = host.send(10, 11)
    assert host.hear(confirm(number)) == [FrameSent(host.now, 10), LinkState(host.now, True, "")]


def test_without_a_port_packets_in_flight_are_unconfirmed_and_the_others_stay_queued() -> None:
    host = Host().get_ready()
    numbers = host.send(1, 2, 3, 4, 5)
    assert host.link.lost(host.now) == [
        LinkState(host.now, False, "lost"),
        *(FrameUnconfirmed(host.now, tag) for tag in (1, 2, 3, 4)),
    ]
    assert host.hear(confirm(numbers[0])) == []
    assert (host.due(), host.link.wake(), host.link.waiting) == (b"", None, 1)
    host.link.connect(host.now)
    assert host.due() == SYNC
    assert host.hear(confirm(numbers[1]), SYNC_PATTERN) == [], "bytes from before the connection are dropped"
    host.due()
    host.hear(*ECHOES)
    (fifth,) = host.send()
    assert host.hear(confirm(fifth)) == [FrameSent(host.now, 5)]


def test_packets_with_signal_strength_and_info_are_passed_on() -> None:
    host = Host().get_ready()
    assert host.hear(packet(b"hello", address=0x0A0B)) == [
        FrameReceived(host.now, 0x0A0B, -60.0, 200, b"hello")
    ]
    assert host.link.counters["bad_fcs"] == 0
    assert host.hear(packet(b"hello", pan=1)) == []
    assert len(host.hear(packet(b"hello", address=0x0103))) == 1
    assert (host.link.counters["other_pan"], host.link.counters["own_address"]) == (1, 1)
    text = "txCount: 1\ntemperature: 21 °C\n"
    assert host.hear(BoardInfo(text.encode())) == [BoardText(host.now, text)]
    damaged = ReceivedPacket(0xBABA, 7, 138, 200, packet(b"hello").fcs, b"hellp")
    for drop in (False, True):
        host = Host(drop).get_ready()
        assert len(host.hear(damaged)) == (not drop)
        assert host.link.counters["bad_fcs"] == 1


def test_missing_sensors_are_detected() -> None:
    host = Host().get_ready()
    assert host.hear(
        TemperatureReading(-396),
        TemperatureReading(-397),
        TemperatureReading(6156),
        HumidityReading(0),
        HumidityReading(1000),
        HumidityReading(-20),
    ) == [
        Temperature(host.now, -39.6, valid=True),
        Temperature(host.now, -39.7, valid=False),
        Temperature(host.now, 615.6, valid=False),
        Humidity(host.now, 0.0, valid=True),
        Humidity(host.now, 100.0, valid=True),
        Humidity(host.now, -2.0, valid=False),
    ]
    assert host.link.counters["bad_sensor"] == 3


def test_damaged_positions_are_dropped() -> None:
    host = Host().get_ready()
    text = b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A"
    (fix,) = host.hear(GpsSentence(text))
    assert isinstance(fix, GpsFix)
    assert fix.valid
    assert fix.latitude == pytest.approx(48.1173)
    assert host.hear(GpsSentence(text.replace(b"4807", b"4808"))) == []
    assert host.link.counters["bad_sentence"] == 1
    assert host.link.phase is LinkPhase.READY


TEXT = b"hello " + SYNC_PATTERN
HELLO = ReceivedPacket(0xBABA, 7, 100, 100, DataFrame(0xBABA, 7, TEXT).check, TEXT)


def conversation(stages: list[list[bytes]]) -> tuple[list[BoardEvent], dict[str, int], list[bytes]]:
    """Return events, counters and the board's bytes of each stage, received in the given pieces."""
    host = Host()
    events: list[BoardEvent] = []
    whole: list[bytes] = []

    def stage(*parts: Answer | bytes) -> None:
        data = said(parts)
        whole.append(data)
        number = len(whole) - 1
        pieces = stages[number] if number < len(stages) else [data]
        assert b"".join(pieces) == data
        for piece in pieces:
            events.extend(host.hear(piece))
        host.hear(after=80_000)

    host.due()
    stage(b"\x00\x03Hel", TemperatureReading(215), b"\x02\x01\x00", SYNC_PATTERN, TemperatureReading(216))
    host.due()
    stage(*ECHOES, HELLO)
    numbers = host.send(1, 2, 3, 4)
    stage(confirm(numbers[0]), HELLO, b"\x0b", HELLO)
    host.due()
    half = said([confirm(numbers[1])])
    stage(
        half[:4], b"\x02" + half[1:5] + b"\x07", half, SYNC_PATTERN[:9], SYNC_PATTERN, TemperatureReading(217)
    )
    host.due()
    stage(*ECHOES)
    numbers = host.send(5, 6)
    events.extend(host.hear(after=1_000_000))
    host.due()
    stage(confirm(numbers[0]), HEAD, SYNC_PATTERN[:5], confirm(numbers[1]), SYNC_PATTERN)
    host.due()
    stage(*ECHOES, HELLO, TemperatureReading(218))
    return events, dict(host.link.counters), whole


WHOLE = conversation([])


def test_each_packet_of_a_long_conversation_is_reported_once() -> None:
    events, counters, _ = WHOLE
    assert [e.tag for e in events if isinstance(e, FrameSent)] == [1, 2, 5, 6]
    assert [e.tag for e in events if isinstance(e, FrameUnconfirmed)] == [3, 4]
    assert len([e for e in events if isinstance(e, FrameReceived)]) == 3
    assert 21.5 not in [e.celsius for e in events if isinstance(e, Temperature)], "received before the SYNC"
    assert (counters["ups"], counters["unknown_type"], counters["swallowed_sync"]) == (3, 1, 1)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_boundaries_of_reads_do_not_matter(data: st.DataObject) -> None:
    pieces = []
    for whole in WHOLE[2]:
        cuts = sorted(data.draw(st.sets(st.integers(1, len(whole) - 1))))
        pieces.append([whole[a:b] for a, b in itertools.pairwise((0, *cuts, len(whole)))])
    assert conversation(pieces)[:2] == WHOLE[:2]


ENDS = (FrameSent, AccessFailure, FrameUnconfirmed, FrameOverflow, FrameRefused)
SET_UP = (0xBABA, 2, 15)
"""PAN, address and channel code set by a link with default settings."""


class Trouble(IntEnum):
    MILD = 0
    WILD = 1
    REBOOT = 2
    NOISE = 3
    """Additional random bytes."""


LINES = {
    Trouble.MILD: LineNoise(change=0.002, drop=0.002, insert=0.002),
    Trouble.WILD: LineNoise(change=0.9, drop=0.05, insert=0.05),
}


class CountingBoard(EmulatedBoard):
    """A board that counts its confirmations by packet number."""

    def __init__(self, radio: DeviceMedium, now: Instant) -> None:
        super().__init__(radio, now)
        self.reports: Counter[int] = Counter()

    def _say(self, now: Instant, answer: Answer) -> None:
        if isinstance(answer, PacketConfirmation):
            self.reports[answer.number] += 1
        super()._say(now, answer)


class CountingLink(BoardLink):
    """A link that stores the numbers of its packets by tag."""

    def __init__(self, settings: BoardSettings) -> None:
        super().__init__(settings)
        self.numbers: dict[int, int] = {}

    def take(self, now: Instant, data: bytes = b"") -> list[BoardEvent]:
        self.numbers |= {pending.tag: pending.number for pending in self._pending if pending.answer is None}
        return super().take(now, data)


def empty_air() -> EmulatedMedium:
    model = radio_model(RadioSetup(seed=1, step_us=10_000, robots=(), preset="beeclick"))
    return EmulatedMedium([2], lambda channel: model, 1)


class Soak:
    """Soak test of a link and a board on a line with faults; checks the reported outcomes."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        air = empty_air()
        self.board, self.link = CountingBoard(air, START), CountingLink(BoardSettings(2))
        air.add(self.board)
        self.host = BoardHost(self.link, self.board)
        self.lab = Lab(air, [self.host], self.rng)
        self.packets = self.false = 0
        self.back_ms = dict.fromkeys(Trouble, 0.0)
        self.reported: Counter[int] = Counter()
        self.ends: Counter[str] = Counter()

    def trouble(self) -> None:
        """Inject a fault for 5 to 60 ms, then run on a clean line until board and link are ready."""
        trouble = Trouble(int(self.rng.integers(0, len(Trouble))))
        self.host.to_host = self.host.to_board = LINES.get(trouble, NO_NOISE)
        if trouble is Trouble.REBOOT:
            self.board.reboot(self.lab.now)
        for _ in range(int(self.rng.integers(5, 60))):
            for _ in range(int(self.rng.integers(0, 3))):
                self.host.send(self.lab.now, self.packets, self.rng.bytes(int(self.rng.integers(1, 119))))
                self.packets += 1
            if trouble is Trouble.NOISE and self.rng.random() < 0.5:
                noise = self._noise(int(self.rng.integers(1, 400)))
                self.host.come += len(noise)
                self.host.events.extend(self.link.take(self.lab.now, noise))
            self.lab.run(milliseconds(1))
            self._enter()
        self.host.to_host = self.host.to_board = NO_NOISE
        if self.board.hung:
            self.board.reboot(self.lab.now)
        back_ms, back_bytes = self._recovery()
        assert trouble is not Trouble.NOISE or back_ms <= 100 or back_bytes <= 300
        self.back_ms[trouble] = max(self.back_ms[trouble], back_ms)
        self._enter()

    def end(self) -> None:
        self.host.unplug(self.lab.now)
        self._enter()

    def _noise(self, size: int) -> bytes:
        """Return random bytes, or bytes that resemble messages."""
        if self.rng.random() < 0.5:
            return self.rng.bytes(size)
        return self.rng.integers(0, 11, size, dtype=np.uint8).tobytes()

    def _recovery(self) -> tuple[float, int]:
        """Return time, ms, and bytes from the board until link and board agree; wait for an idle radio."""
        began, come, board = self.lab.now, self.host.come, self.board
        back: tuple[float, int] | None = None
        while self.lab.now < began + seconds(6):
            self.lab.run(milliseconds(1))
            set_up = (board.pan, board.address, board.channel) == SET_UP
            if self.link.phase is not LinkPhase.READY or not board.commands.in_step or not set_up:
                back = None
            elif back is None:
                back = (self.lab.now - began) / 1e3, self.host.come - come
            if back is not None and self.lab.now > began + milliseconds(200) and not self.link.in_flight:
                return back
        raise AssertionError("board and link are not ready after 6 s")

    def _enter(self) -> None:
        for event in self.host.events:
            if isinstance(event, ENDS):
                self.reported[event.tag] += 1
                self.ends[type(event).__name__] += 1
                if isinstance(event, FrameSent | AccessFailure):
                    self.false += not self.board.reports[self.link.numbers[event.tag]]
        self.host.events.clear()
        assert len(self.link._reader._bytes) < 300


@pytest.mark.claim("boards")
def test_each_packet_is_reported_once_with_the_boards_outcome(
    full: bool, record_property: Callable[[str, object], None]
) -> None:
    soak = Soak(seed=3)
    while soak.host.come < (10_000_000 if full else 100_000):
        soak.trouble()
    soak.end()
    record_property("packets", {"all": soak.packets, **soak.ends})
    record_property("ready again at most after, ms", {one.name: ms for one, ms in soak.back_ms.items()})
    assert soak.ends["FrameSent"] > 250 and soak.ends["FrameUnconfirmed"] > 50
    assert max(soak.reported.values()) == 1
    assert soak.packets == len(soak.reported) + soak.link.waiting
    assert soak.false == 0


@pytest.mark.claim("boards")
@pytest.mark.parametrize("data_bytes", [1, 20, 60, 118])
def test_the_link_uses_the_capacity_of_line_and_medium(
    data_bytes: int, full: bool, record_property: Callable[[str, object], None]
) -> None:
    """Compare with the line rate and with a saturated simulated transceiver alone on the medium."""
    duration, air = seconds(10.0 if full else 1.0), empty_air()
    link = BoardLink(BoardSettings(2))
    host = BoardHost(link, EmulatedBoard(air, START))
    air.add(host.board)
    lab = Lab(air, [host], np.random.default_rng(1))
    lab.run(milliseconds(20))
    before, began = host.link.counters["sent"], lab.now
    while lab.now < began + duration:
        while link.waiting + link.in_flight < 8:
            host.send(lab.now, 0, bytes(data_bytes))
        lab.run(milliseconds(1))
        host.events.clear()
    rate = (host.link.counters["sent"] - before) / (duration / 1e6)
    model = radio_model(RadioSetup(seed=1, step_us=10_000, robots=(), preset="beeclick"))
    medium = Medium([model.parameters.transceiver], model.propagation, model.parameters.phy, seed=1)
    medium.offer(0, SaturatedTraffic(octets(data_bytes)))
    medium.run(duration * 1000)
    most = min(int(medium.counters()["sent"][0]) / (duration / 1e6), 1e6 / byte_time(6 + data_bytes))
    record_property(f"{data_bytes} bytes: packets per s, share", (rate, rate / most))
    assert rate >= 0.95 * most
