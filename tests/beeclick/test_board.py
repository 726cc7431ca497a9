"""The emulated board: synchronisation, its two rings, packets, settings, sensors."""

from dataclasses import replace

import pytest

from actors.ieee802154 import TURNAROUND_NS
from actors.instant import START, Instant, milliseconds, seconds
from actors.radio.frame import DataFrame, airtime_us
from actors.radio.medium.state import Cca
from actors.radio.radio_model import RadioSetup, radio_model
from firmware_bridge.beeclick import wire
from firmware_bridge.beeclick.air import EmulatedAir
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.wire import (
    SYNC_PATTERN,
    Answer,
    Command,
    Moisture,
    Notes,
    PacketSent,
    ReceivedPacket,
    SendPacket,
    Sentence,
    SetAddress,
    SetChannel,
    SetPower,
    Synchronise,
    Synchronised,
    Warmth,
    byte_time,
)
from tests.beeclick.hosts import standing


class Bench:
    """A board whose host the test plays, alone on the medium unless others are put there."""

    def __init__(self, boards: int = 1, csma: bool = False, distance: float = 2.0) -> None:
        self.now = START
        model = radio_model(RadioSetup(1, 10_000, (), "beeclick"))
        if not csma:  # a frame begins when the chip has it, but for the turnaround
            at_once = replace(model.parameters.transceiver, min_be=0, max_be=0, cca=Cca.NEVER)
            model = replace(model, parameters=replace(model.parameters, transceiver=at_once))
        self.air = EmulatedAir(range(1, boards + 1), lambda channel: model, 1)
        self.boards = [EmulatedBoard(self.air, START) for _ in range(boards)]
        for board in self.boards:
            self.air.add(board)
        self.air.place(START, [standing(number * distance, 0.0) for number in range(boards)])
        self.board = self.boards[0]
        self.log = bytearray()

    def tell(self, *parts: Command | bytes, board: int = 0) -> None:
        data = b"".join(part if isinstance(part, bytes) else wire.encode_command(part) for part in parts)
        self.boards[board].take(self.now, data)

    def wait(self, duration: int) -> bytes:
        """What the first board says meanwhile."""
        self.now = Instant(self.now + duration)
        self.air.advance(self.now)
        return self.board.run(self.now)

    def said(self, duration: int = 20_000) -> list[Answer]:
        data, at, found = self.wait(duration), 0, []
        while (one := wire.read_answer(data, at, len(data))) is not None:
            answer, at = one
            found.append(answer)
        assert at == len(data)
        return found

    def sync(self, board: int = 0) -> None:
        self.tell(b"\xff", Synchronise(), board=board)
        self.wait(2_000)
        self.boards[board].run(self.now)


def packets(count: int, size: int = 10) -> list[Command]:
    return [SendPacket(number, bytes([number]) * size) for number in range(count)]


# --- in and out of step ----------------------------------------------------------------------------------


def test_a_board_out_of_step_obeys_nothing_and_yet_is_not_silent() -> None:
    bench = Bench()
    bench.tell(SetAddress(1, 2), SetChannel(3))
    assert bench.said(seconds(1.3)) == []
    assert bench.said(seconds(0.1)) == [Warmth(215)]
    assert bench.board.address == 0


def test_a_stray_zero_makes_it_miss_a_sync_and_filler_helps() -> None:
    bench = Bench()
    bench.tell(b"\x00", Synchronise())
    assert bench.said() == []
    bench.tell(b"\x00\xff", Synchronise())
    assert bench.said() == [Synchronised()]


def test_filler_ends_any_command_that_it_believes_to_be_in() -> None:
    bench = Bench()
    for begun in (
        b"\x01",
        b"\x01\xff",
        b"\x01\x76" + bytes(50),
        b"\x02",
        b"\x03\x00",
        b"\x04\x01",
        b"\x00He",
    ):
        bench.sync()
        bench.tell(begun, b"\xff" * 261, Synchronise())
        assert bench.wait(60_000).endswith(SYNC_PATTERN), begun


# --- the rings -------------------------------------------------------------------------------------------


def test_a_seventh_hangs_it_as_the_answers_fill_their_ring() -> None:
    bench = Bench()
    bench.sync()
    bench.board.press(bench.now)
    bench.tell(*(SetPower(-10 * code) for code in range(7)))
    assert bench.wait(seconds(1)) == b""
    assert bench.board.hung


def test_an_answer_ring_that_is_full_hangs_the_board() -> None:
    bench = Bench()
    whole = DataFrame(1, 2, bytes(118))
    for _ in range(7):
        bench.board.heard(bench.now, whole, 0, 0)
    assert not bench.board.hung
    bench.board.heard(bench.now, whole, 0, 0)
    assert bench.board.hung
    bench.tell(Synchronise())
    assert bench.wait(seconds(1)) == b""
    bench.board.reboot(bench.now)
    bench.tell(Synchronise())
    assert bench.said() == [Synchronised()]


# --- packets ---------------------------------------------------------------------------------------------


def test_nothing_behind_a_packet_is_done_while_it_is_in_the_air() -> None:
    bench = Bench()
    bench.sync()
    bench.tell(SendPacket(5, bytes(118)), SetPower(-100))
    through = byte_time(124) + TURNAROUND_NS // 1000 + airtime_us(118)
    assert bench.said(through) == []
    assert bench.said(200) == [PacketSent(5, failed=False), SetPower(-100)]


def test_a_packet_is_heard_by_those_in_range_and_on_the_channel() -> None:
    bench = Bench(boards=4, distance=50.0)
    for number in (1, 2, 3):
        bench.sync(number)
        bench.tell(SetChannel(3 if number == 2 else 0), SetAddress(0xBABA, number), board=number)
    bench.said()
    bench.tell(SendPacket(1, b"hello"), board=1)
    (packet,) = (a for a in bench.said() if isinstance(a, ReceivedPacket))
    assert (packet.pan, packet.address, packet.data) == (0xBABA, 1, b"hello")
    assert packet.fcs == DataFrame(0xBABA, 1, b"hello").check
    assert [b.counters["heard"] for b in bench.boards] == [1, 0, 0, 0]  # 2: channel, 3: 100 m


@pytest.mark.parametrize(("asked", "dbm"), [(-100, -10.0), (-120, -16.3), (-7, -6.3), (-4, 0.0)])
def test_the_power_echo_is_what_was_asked_for_not_what_is_sent(asked: int, dbm: float) -> None:
    bench = Bench()
    bench.sync()
    bench.tell(SetPower(asked))
    assert bench.said() == [SetPower(asked)]
    assert bench.board.power_dbm == dbm


# --- the rest --------------------------------------------------------------------------------------------


def test_sensors_speak_in_pairs() -> None:
    bench = Bench()
    times: list[tuple[int, Answer]] = []
    for _ in range(500):
        times += [(bench.now, answer) for answer in bench.said(10_000)]
    assert times == [
        (1_380_000, Warmth(215)),
        (1_730_000, Moisture(400)),
        (3_090_000, Warmth(215)),
        (3_440_000, Moisture(400)),
        (4_800_000, Warmth(215)),
    ]


def test_the_button_holds_everything_up_and_then_notes_come() -> None:
    bench = Bench()
    bench.sync()
    bench.tell(SetAddress(0xBABA, 0x0103))
    bench.said()
    bench.board.press(bench.now)
    bench.tell(*(SetChannel(code) for code in range(6)))
    assert bench.said(milliseconds(699)) == []
    notes, *channels = bench.said(milliseconds(30))
    assert isinstance(notes, Notes)
    assert "panId: baba\nsAddr: 0103\n" in notes.text.decode()
    assert channels == [SetChannel(code) for code in range(6)]
    bench.board.gps(bench.now, b"$GPGGA,1")
    bench.board.gps(bench.now, b"$GPRMC,1,V")
    assert bench.said() == [Sentence(b"$GPRMC,1,V")]


def test_a_restart_loses_the_settings_and_the_sync_but_not_the_voice() -> None:
    bench = Bench(boards=2)
    bench.sync()
    bench.tell(SetAddress(0xBABA, 5), SetChannel(0))
    bench.said()
    bench.tell(*packets(3, size=118))
    bench.wait(3_000)
    bench.board.reboot(bench.now)
    assert (bench.board.pan, bench.board.address, bench.board.channel) == (0, 0, 0)
    bench.tell(SetChannel(4))
    assert bench.said(seconds(1.3)) == []
    assert bench.boards[1].counters["heard"] == 0  # what was in the air was cut off
    assert bench.said(seconds(0.1)) == [Warmth(215)]
