"""Encoding of board messages, emulated boards with and without links, and the port of a board."""

import os
import pty
import tty
from contextlib import closing
from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from actors.ieee802154 import TURNAROUND_NS
from actors.instant import START, Instant, milliseconds, seconds
from actors.radio.frame import DataFrame, airtime_us, link_qualities, rssi_codes, rssi_dbm, strengths_dbm
from actors.radio.medium.state import Cca
from actors.radio.radio_model import RadioSetup, radio_model
from actors.settings import ParameterError
from firmware_bridge.beeclick import board_messages
from firmware_bridge.beeclick.answer_decoder import BoardSettings, actual_power, parse_rmc, power_setting
from firmware_bridge.beeclick.board_link import BoardLink, LinkPhase
from firmware_bridge.beeclick.board_messages import (
    SYNC_PATTERN,
    Answer,
    BoardInfo,
    Command,
    GpsSentence,
    HumidityReading,
    NoiseError,
    PacketConfirmation,
    ReceivedPacket,
    SendPacket,
    SetAddress,
    SetChannel,
    SetPower,
    SyncAnswer,
    SyncCommand,
    TemperatureReading,
    byte_time,
    bytes_in,
)
from firmware_bridge.beeclick.emulated_board import EmulatedBoard
from firmware_bridge.beeclick.emulated_medium import EmulatedMedium
from firmware_bridge.serial_port import BoardPort, PortError
from tests.beeclick.lab import BoardHost, Lab, command_size, standing
from tests.beeclick.lab import boards as row_of_boards

COMMANDS: list[tuple[str, Command]] = [
    ("00 48 65 6c 6c 6f 20 74 68 65 72 65 21", SyncCommand()),
    ("01 02 04 03 02 01 aa bb", SendPacket(0x01020304, b"\xaa\xbb")),
    ("01 00 ff ff ff ff", SendPacket(0xFFFFFFFF, b"")),
    ("02 0f", SetChannel(15)),
    ("03 9c ff", SetPower(-100)),
    ("03 95 fe", SetPower(-363)),
    ("04 ba ba 03 01", SetAddress(0xBABA, 0x0103)),
]
ANSWERS: list[tuple[str, Answer]] = [
    ("00 48 65 6c 6c 6f 20 74 68 65 72 65 21", SyncAnswer()),
    (
        "01 02 ba ba 02 01 90 ff 12 34 68 69",
        ReceivedPacket(0xBABA, 0x0102, rssi_code=0x90, lqi=0xFF, fcs=0x3412, data=b"hi"),
    ),
    ("02 04 03 02 01 00", PacketConfirmation(0x01020304, failed=False)),
    ("03 00", SetChannel(0)),
    ("04 95 fe", SetPower(-363)),
    ("05 ba ba 03 01", SetAddress(0xBABA, 0x0103)),
    ("06 08 24 47 50 52 4d 43 2c 56", GpsSentence(b"$GPRMC,V")),
    ("07 04 c2 b0 43 0a", BoardInfo("°C\n".encode())),
    ("08 d7 00", TemperatureReading(215)),
    ("09 ec ff", HumidityReading(-20)),
]


@pytest.mark.parametrize(("text", "command"), COMMANDS)
def test_commands_are_encoded(text: str, command: Command) -> None:
    data = bytes.fromhex(text)
    assert board_messages.encode_command(command) == data
    assert command_size(data) == len(data)


@pytest.mark.parametrize(("text", "answer"), ANSWERS)
def test_answers_are_encoded_and_decoded(text: str, answer: Answer) -> None:
    data = bytes.fromhex(text)
    assert board_messages.encode_answer(answer) == data
    assert board_messages.read_answer(data, 0, len(data)) == (answer, len(data))
    assert board_messages.read_answer(b"\xff" + data + b"\xff", 1, len(data) + 1) == (answer, len(data) + 1)
    for end in range(len(data)):
        assert board_messages.read_answer(data, 0, end) is None


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (SendPacket(0, bytes(119)), "the length of SendPacket.data is 119, but must be from 0 to 118"),
        (SendPacket(1 << 32, b""), "SendPacket.number is 4294967296, but must be from 0 to 4294967295"),
        (SetChannel(16), "SetChannel.code is 16, but must be from 0 to 15"),
        (SetPower(1), "SetPower.tenths_db is 1, but must be from -363 to 0"),
        (SetAddress(0x10000, 0), "SetAddress.pan is 65536, but must be from 0 to 65535"),
    ],
)
def test_values_out_of_range_are_refused(command: Command, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        board_messages.encode_command(command)
    assert str(caught.value) == sentence
    with pytest.raises(ParameterError, match=r"^the length of BoardInfo\.text is 256, but must be from 0"):
        board_messages.encode_answer(BoardInfo(b"x" * 256))


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("0a", "unknown_type"),
        ("00 49", "bad_pattern"),
        ("01 77", "bad_length"),
        ("02 00 00 00 00 02", "bad_status"),
        ("03 10", "bad_channel"),
        ("04 01 00", "bad_power"),
        ("06 08 24 47 50 47", "bad_text"),
        ("07 01 c2", "bad_text"),
        ("08 72 fe", "bad_temperature"),
        ("08 0d 18", "bad_temperature"),
    ],
)
def test_noise_is_recognised_by_its_last_byte(text: str, cause: str) -> None:
    data = bytes.fromhex(text)
    with pytest.raises(NoiseError, match=f"^{cause}$"):
        board_messages.read_answer(data, 0, len(data))
    assert board_messages.read_answer(data, 0, len(data) - 1) is None


@given(st.binary(max_size=300))
def test_any_bytes_are_an_answer_noise_or_incomplete(data: bytes) -> None:
    try:
        one = board_messages.read_answer(data, 0, len(data))
    except NoiseError:
        return
    if one is not None:
        answer, end = one
        assert board_messages.encode_answer(answer) == data[:end]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"address": 0xFFFE}, "BoardSettings.address is 65534, but must be a whole number from 0 to 65533"),
        ({"address": 1, "pan": 0xFFFF}, "BoardSettings.pan is 65535, but must be a whole number from 0 to"),
        ({"address": 1, "channel": 10}, "BoardSettings.channel is 10, but must be a whole number from 11 to"),
        ({"address": 1, "power_dbm": -12}, "board.power_dbm is -12, but must be 0, -0.5 or -6.3 dBm, or"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, float], sentence: str) -> None:
    with pytest.raises(ParameterError, match=f"^{sentence}"):
        BoardSettings(**settings)  # type: ignore[arg-type]


def test_the_line_transmits_ten_bits_per_byte() -> None:
    assert byte_time(0) == 0
    assert byte_time(921_600) == 10_000_000
    assert byte_time(1) == 11  # 10.85
    for count in range(500):
        assert bytes_in(byte_time(count)) == count
        assert bytes_in(byte_time(count) - 1) == max(count - 1, 0)


def sentence(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}".encode()


FIX = "GPRMC,123519.50,A,5005.2460,N,01425.1230,E,000.0,084.4,230614,,"


def test_positions_are_in_degrees_with_south_and_west_negative() -> None:
    position = parse_rmc(START, sentence(FIX))
    assert position is not None
    assert position.valid
    assert position.latitude == pytest.approx(50.087433333333334)
    assert position.longitude == pytest.approx(14.418716666666667)
    south = parse_rmc(START, sentence("GPRMC,000000,A,3351.0000,S,15112.0000,W,0,0,010100"))
    none = parse_rmc(START, sentence("GPRMC,,V,,,,,,,,,,N"))
    assert none is not None and (none.valid, none.latitude, none.longitude) == (False, None, None)
    assert south is not None and (south.latitude, south.longitude) == (-33.85, -151.2)


@pytest.mark.parametrize(
    ("part", "wrong"),
    [
        ("GPRMC", "GPGGA"), (",A,", ",B,"), ("5005.2460", ""), ("5005.2460", "50052460"),
        ("5005.2460", "5060.0000"), ("5005.2460", "9000.0001"), (",N,", ",X,"), ("01425.1230", "1425.1230"),
        ("01425.1230", "18000.1000"), (FIX, "GPRMC,123519,A"),
    ],
)  # fmt: skip
def test_invalid_sentences_give_no_position(part: str, wrong: str) -> None:
    assert parse_rmc(START, sentence(FIX.replace(part, wrong))) is None
    assert parse_rmc(START, sentence(FIX)[:-2] + b"00") is None


def test_codes_and_dbm_agree_within_half_a_code() -> None:
    table = {0: -90, 5: -87, 37: -80, 89: -70, 138: -60, 193: -50, 239: -40, 255: -35}
    assert {code: rssi_dbm(code) for code in table} == table
    dbm = np.arange(-900, -350) / 10
    codes = rssi_codes(dbm)
    assert np.abs(strengths_dbm(codes) - dbm).max() <= 0.51
    assert strengths_dbm(codes).tolist() == [rssi_dbm(code) for code in codes.tolist()]
    values = [rssi_dbm(code) for code in range(256)]
    assert values == sorted(set(values)) and values[41] == pytest.approx(-80 + 4 / 6)
    assert rssi_codes(np.array(values)).tolist() == list(range(256))
    assert rssi_codes(np.array([-np.inf, -120.0, 10.0])).tolist() == [0, 0, 255]


def test_only_powers_that_the_firmware_sets_correctly_are_requested() -> None:
    made = {-4: 0, -6: -5, -7: -63, -12: -63, -99: -63, -100: -100, -120: -163, -300: -300}
    assert {asked: actual_power(asked) for asked in made} == made
    right = [asked for asked in range(-363, 1) if actual_power(asked) == asked]
    assert right == sorted(-10 * large - small for large in (0, 10, 20, 30) for small in (0, 5, 63))
    assert [power_setting(asked / 10) for asked in right] == right


def test_link_quality_covers_twenty_decibels_above_sensitivity() -> None:
    dbm = np.array([-120.0, -96.0, -86.0, -76.0, -30.0])
    assert link_qualities(dbm, -96.0).tolist() == [0, 0, 128, 255, 255]


class Bench:
    """Boards on a medium, with the test as host."""

    def __init__(self, boards: int = 1, distance: float = 2.0) -> None:
        self.now = START
        model = radio_model(RadioSetup(seed=1, step_us=10_000, robots=(), preset="beeclick"))
        # frames start immediately after the turnaround
        at_once = replace(model.parameters.transceiver, min_be=0, max_be=0, cca=Cca.NEVER)
        model = replace(model, parameters=replace(model.parameters, transceiver=at_once))
        self.air = EmulatedMedium(range(1, boards + 1), lambda channel: model, 1)
        self.boards = [EmulatedBoard(self.air, START) for _ in range(boards)]
        for board in self.boards:
            self.air.add(board)
        self.air.set_states(START, [standing(number * distance, 0.0) for number in range(boards)])
        self.board = self.boards[0]
        self.log = bytearray()

    def tell(self, *parts: Command | bytes, board: int = 0) -> None:
        data = b"".join(
            part if isinstance(part, bytes) else board_messages.encode_command(part) for part in parts
        )
        self.boards[board].take(self.now, data)

    def wait(self, duration: int) -> bytes:
        """Advance by `duration`; return the bytes sent by the first board."""
        self.now = Instant(self.now + duration)
        self.air.advance(self.now)
        return self.board.run(self.now)

    def said(self, duration: int = 20_000) -> list[Answer]:
        data, at, found = self.wait(duration), 0, []
        while (one := board_messages.read_answer(data, at, len(data))) is not None:
            answer, at = one
            found.append(answer)
        assert at == len(data)
        return found

    def sync(self, board: int = 0) -> None:
        self.tell(b"\xff", SyncCommand(), board=board)
        self.wait(2_000)
        self.boards[board].run(self.now)


def test_an_unsynchronised_board_ignores_commands_but_sends_readings() -> None:
    bench = Bench()
    bench.tell(SetAddress(1, 2), SetChannel(3))
    assert bench.said(seconds(1.3)) == []
    assert bench.said(seconds(0.1)) == [TemperatureReading(215)]
    assert bench.board.address == 0


def test_filler_completes_a_stray_zero_and_any_unfinished_command() -> None:
    bench = Bench()
    bench.tell(b"\x00", SyncCommand())
    assert bench.said() == []
    bench.tell(b"\x00\xff", SyncCommand())
    assert bench.said() == [SyncAnswer()]
    for begun in (b"\x01\xff", b"\x01\x76" + bytes(50), b"\x02", b"\x03\x00", b"\x04\x01", b"\x00He"):
        bench.sync()
        bench.tell(begun, b"\xff" * 261, SyncCommand())
        assert bench.wait(60_000).endswith(SYNC_PATTERN), begun


def test_a_full_ring_of_answers_hangs_the_board_until_a_reset() -> None:
    bench = Bench()
    bench.sync()
    bench.board.press(bench.now)
    bench.tell(*(SetPower(-10 * code) for code in range(7)))
    assert bench.wait(seconds(1)) == b"" and bench.board.hung, (
        "seven commands while the button blocks the board"
    )
    bench = Bench()
    for heard in range(8):
        assert not bench.board.hung, heard
        bench.board.receive_frame(bench.now, DataFrame(1, 2, bytes(118)), 0, 0)
    assert bench.board.hung
    bench.tell(SyncCommand())
    assert bench.wait(seconds(1)) == b""
    bench.board.reboot(bench.now)
    bench.tell(SyncCommand())
    assert bench.said() == [SyncAnswer()]


def test_a_packet_being_sent_blocks_later_commands() -> None:
    bench = Bench()
    bench.sync()
    bench.tell(SendPacket(5, bytes(118)), SetPower(-100))
    through = byte_time(124) + TURNAROUND_NS // 1000 + airtime_us(118)
    assert bench.said(through) == []
    assert bench.said(200) == [PacketConfirmation(5, failed=False), SetPower(-100)]


def test_packets_are_received_in_range_and_on_the_same_channel() -> None:
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


def test_temperature_and_humidity_alternate() -> None:
    bench = Bench()
    times: list[tuple[int, Answer]] = []
    for _ in range(500):
        times += [(bench.now, answer) for answer in bench.said(10_000)]
    assert times == [
        (1_380_000, TemperatureReading(215)),
        (1_730_000, HumidityReading(400)),
        (3_090_000, TemperatureReading(215)),
        (3_440_000, HumidityReading(400)),
        (4_800_000, TemperatureReading(215)),
    ]


def test_the_button_blocks_the_board_and_then_sends_info() -> None:
    bench = Bench()
    bench.sync()
    bench.tell(SetAddress(0xBABA, 0x0103))
    bench.said()
    bench.board.press(bench.now)
    bench.tell(*(SetChannel(code) for code in range(6)))
    assert bench.said(milliseconds(699)) == []
    notes, *channels = bench.said(milliseconds(30))
    assert isinstance(notes, BoardInfo)
    assert "panId: baba\nsAddr: 0103\n" in notes.text.decode()
    assert channels == [SetChannel(code) for code in range(6)]
    bench.board.gps(bench.now, b"$GPGGA,1")
    bench.board.gps(bench.now, b"$GPRMC,1,V")
    assert bench.said() == [GpsSentence(b"$GPRMC,1,V")]


def test_a_restarted_board_loses_settings_and_synchronisation_but_sends_readings() -> None:
    bench = Bench(boards=2)
    bench.sync()
    bench.tell(SetAddress(0xBABA, 5), SetChannel(0), SetPower(-7))
    assert bench.said()[-1] == SetPower(-7) and bench.board.power_dbm == -6.3, "the echo repeats the request"
    bench.tell(*(SendPacket(number, bytes(118)) for number in range(3)))
    bench.wait(3_000)
    bench.board.reboot(bench.now)
    assert (bench.board.pan, bench.board.address, bench.board.channel) == (0, 0, 0)
    bench.tell(SetChannel(4))
    assert bench.said(seconds(1.3)) == []
    assert bench.boards[1].counters["heard"] == 0  # the frame being sent was aborted
    assert bench.said(seconds(0.1)) == [TemperatureReading(215)]


def test_the_button_does_not_disturb_synchronisation() -> None:
    for delay in range(0, 400, 80):
        air = row_of_boards(1)
        (board,) = air.devices
        assert isinstance(board, EmulatedBoard)
        link = BoardLink(BoardSettings(1))
        room = Lab(air, [BoardHost(link, board)], np.random.default_rng(1))
        room.run(milliseconds(50))
        board.reboot(room.now)
        room.run(milliseconds(1_700 + delay))
        board.press(room.now)
        room.run(seconds(3))
        assert not board.hung
        assert link.phase is LinkPhase.READY


def test_writes_do_not_block_and_lose_no_bytes_until_the_port_is_unplugged() -> None:
    board, host = pty.openpty()
    tty.setraw(host)
    path, data = os.ttyname(host), os.urandom(200_000)
    os.close(host)
    with closing(BoardPort(path)) as port:
        assert port.read() == b""
        os.write(board, bytes(range(256)))
        assert port.read() == bytes(range(256))
        port.write(data)
        assert not port.is_idle
        got = bytearray()
        while len(got) < len(data):
            got += os.read(board, 65_536)
            port.write(b"")
        assert port.is_idle and bytes(got) == data
        os.close(board)
        gone = f"{path}: connection to the BEE-click board lost"
        with pytest.raises(PortError, match=rf"^{gone} \(end of file\); check its USB cable$"):
            port.read()
        with pytest.raises(PortError, match=rf"^{gone} \(EIO\); check its USB cable$"):
            port.write(b"x")
