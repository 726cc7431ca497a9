"""Bytes of the board's messages, GPS sentences, signal strengths and transmit powers."""

from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.bounds import ParameterError
from actors.radio.frame import link_qualities, rssi_codes, rssi_dbm, strengths_dbm
from firmware_bridge.beeclick import wire
from firmware_bridge.beeclick.parameters import BoardSettings, power_setting, radiated
from firmware_bridge.beeclick.reception import parse_rmc
from firmware_bridge.beeclick.wire import (
    Answer,
    Command,
    Moisture,
    NoiseError,
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
    bytes_in,
)

COMMANDS: list[tuple[str, Command]] = [
    ("00 48 65 6c 6c 6f 20 74 68 65 72 65 21", Synchronise()),
    ("01 02 04 03 02 01 aa bb", SendPacket(0x01020304, b"\xaa\xbb")),
    ("01 00 ff ff ff ff", SendPacket(0xFFFFFFFF, b"")),
    ("02 0f", SetChannel(15)),
    ("03 9c ff", SetPower(-100)),
    ("03 95 fe", SetPower(-363)),
    ("04 ba ba 03 01", SetAddress(0xBABA, 0x0103)),
]
ANSWERS: list[tuple[str, Answer]] = [
    ("00 48 65 6c 6c 6f 20 74 68 65 72 65 21", Synchronised()),
    (
        "01 02 ba ba 02 01 90 ff 12 34 68 69",
        ReceivedPacket(0xBABA, 0x0102, rssi_code=0x90, lqi=0xFF, fcs=0x3412, data=b"hi"),
    ),
    ("02 04 03 02 01 00", PacketSent(0x01020304, failed=False)),
    ("03 00", SetChannel(0)),
    ("04 95 fe", SetPower(-363)),
    ("05 ba ba 03 01", SetAddress(0xBABA, 0x0103)),
    ("06 08 24 47 50 52 4d 43 2c 56", Sentence(b"$GPRMC,V")),
    ("07 04 c2 b0 43 0a", Notes("°C\n".encode())),
    ("08 d7 00", Warmth(215)),
    ("09 ec ff", Moisture(-20)),
]


@pytest.mark.parametrize(("text", "command"), COMMANDS)
def test_a_command_is_these_bytes(text: str, command: Command) -> None:
    data = bytes.fromhex(text)
    assert wire.encode_command(command) == data
    assert wire.command_size(data) == len(data)


@pytest.mark.parametrize(("text", "answer"), ANSWERS)
def test_an_answer_is_these_bytes(text: str, answer: Answer) -> None:
    data = bytes.fromhex(text)
    assert wire.encode_answer(answer) == data
    assert wire.read_answer(data, 0, len(data)) == (answer, len(data))
    assert wire.read_answer(b"\xff" + data + b"\xff", 1, len(data) + 1) == (answer, len(data) + 1)
    for end in range(len(data)):
        assert wire.read_answer(data, 0, end) is None


@pytest.mark.parametrize(
    ("command", "sentence"),
    [
        (
            SendPacket(0, bytes(119)),
            "the length of SendPacket.data is 119, but must be from 0 to 118",
        ),
        (SendPacket(1 << 32, b""), "SendPacket.number is 4294967296, but must be from 0 to 4294967295"),
        (SetChannel(16), "SetChannel.code is 16, but must be from 0 to 15"),
        (SetPower(1), "SetPower.tenths_db is 1, but must be from -363 to 0"),
        (SetAddress(0x10000, 0), "SetAddress.pan is 65536, but must be from 0 to 65535"),
    ],
)
def test_a_value_that_the_board_cannot_take_is_refused(command: Command, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        wire.encode_command(command)
    assert str(caught.value) == sentence
    with pytest.raises(ParameterError, match=r"the length of Notes\.text is 256, but must be from 0 to 255"):
        wire.encode_answer(Notes(b"x" * 256))


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("0a", "unknown_type"),
        ("00 49", "bad_pattern"),
        ("00 48 65 6c 6c 6f 20 74 68 65 72 65 20", "bad_pattern"),
        ("01 77", "bad_length"),
        ("02 00 00 00 00 02", "bad_status"),
        ("03 10", "bad_channel"),
        ("04 01 00", "bad_power"),
        ("06 05", "bad_length"),
        ("06 08 24 47 50 47", "bad_text"),
        ("07 00", "bad_length"),
        ("07 01 07", "bad_text"),
        ("07 01 c2", "bad_text"),
        ("08 72 fe", "bad_temperature"),
        ("08 0d 18", "bad_temperature"),
    ],
)
def test_what_no_board_says_is_noise_by_its_last_byte(text: str, cause: str) -> None:
    data = bytes.fromhex(text)
    with pytest.raises(NoiseError) as caught:
        wire.read_answer(data, 0, len(data))
    assert str(caught.value) == cause
    assert wire.read_answer(data, 0, len(data) - 1) is None


@given(st.binary(max_size=300))
def test_any_bytes_are_an_answer_or_noise_or_too_few(data: bytes) -> None:
    try:
        one = wire.read_answer(data, 0, len(data))
    except NoiseError:
        return
    if one is not None:
        answer, end = one
        assert wire.encode_answer(answer) == data[:end]


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"address": 0xFFFE}, "board.address is 65534, but must be from 0 to 65533"),
        ({"address": 1, "pan": 0xFFFF}, "board.pan is 65535, but must be from 0 to 65534"),
        ({"address": 1, "channel": 10}, "board.channel is 10, but must be from 11 to 26"),
        (
            {"address": 1, "power_dbm": -12},
            "board.power_dbm is -12, but must be 0, -0.5 or -6.3 dBm, or one of them less 10, 20 or 30, "
            "which is what the firmware can set",
        ),
    ],
)
def test_a_board_is_not_set_up_with_nonsense(settings: dict[str, float], sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        BoardSettings(**settings)  # type: ignore[arg-type]
    assert str(caught.value) == sentence


def test_the_line_takes_ten_bits_a_byte() -> None:
    assert byte_time(0) == 0
    assert byte_time(921_600) == 10_000_000
    assert byte_time(1) == 11  # 10.85
    for count in range(500):
        assert bytes_in(byte_time(count)) == count
        assert bytes_in(byte_time(count) - 1) == max(count - 1, 0)


def sentence(body: str) -> bytes:
    return f"${body}*{reduce(xor, body.encode()):02X}".encode()


FIX = "GPRMC,123519.50,A,5005.2460,N,01425.1230,E,000.0,084.4,230614,,"


def test_a_fix_is_in_degrees_south_and_west_negative() -> None:
    position = parse_rmc(sentence(FIX))
    assert position is not None
    assert position.valid
    assert position.latitude == pytest.approx(50.087433333333334)
    assert position.longitude == pytest.approx(14.418716666666667)
    south = parse_rmc(sentence("GPRMC,000000,A,3351.0000,S,15112.0000,W,0,0,010100"))
    none = parse_rmc(sentence("GPRMC,,V,,,,,,,,,,N"))
    assert none is not None and (none.valid, none.latitude, none.longitude) == (False, None, None)
    assert south is not None and (south.latitude, south.longitude) == (-33.85, -151.2)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"$GPRMC",
        sentence(FIX)[:-2] + b"00",
        sentence(FIX.replace("GPRMC", "GPGGA")),
        sentence(FIX.replace(",A,", ",B,")),
        sentence(FIX.replace("5005.2460", "")),
        sentence(FIX.replace("5005.2460", "50052460")),
        sentence(FIX.replace("5005.2460", "5060.0000")),
        sentence(FIX.replace("5005.2460", "9000.0001")),
        sentence(FIX.replace(",N,", ",X,")),
        sentence(FIX.replace("01425.1230", "1425.1230")),
        sentence(FIX.replace("01425.1230", "18000.1000")),
        sentence("GPRMC,123519,A"),
        sentence(FIX).replace(b"A", b"\xc1"),
    ],
)
def test_anything_else_is_no_sentence(text: bytes) -> None:
    assert parse_rmc(text) is None


@given(st.binary(max_size=100))
def test_any_bytes_are_borne(text: bytes) -> None:
    assert parse_rmc(b"$GPRMC," + text) is None


@pytest.mark.parametrize(
    ("code", "dbm"),
    [(0, -90), (5, -87), (37, -80), (89, -70), (138, -60), (193, -50), (239, -40), (255, -35)],
)
def test_a_signal_strength_code_is_so_many_dbm(code: int, dbm: float) -> None:
    assert rssi_dbm(code) == dbm
    assert rssi_codes(np.array([dbm])).tolist() == [code]


def test_code_and_dbm_agree_to_half_a_code() -> None:
    dbm = np.arange(-900, -350) / 10
    codes = rssi_codes(dbm)
    assert np.abs(strengths_dbm(codes) - dbm).max() <= 0.51
    assert strengths_dbm(codes).tolist() == [rssi_dbm(code) for code in codes.tolist()]
    values = [rssi_dbm(code) for code in range(256)]
    assert values == sorted(set(values)) and values[41] == pytest.approx(-80 + 4 / 6)
    assert rssi_codes(np.array(values)).tolist() == list(range(256))
    assert rssi_codes(np.array([-np.inf, -120.0, 10.0])).tolist() == [0, 0, 255]


@pytest.mark.parametrize(
    ("asked", "made"),
    [
        *((0, 0), (-4, 0), (-5, -5), (-6, -5), (-7, -63), (-12, -63), (-63, -63), (-99, -63)),
        *((-100, -100), (-105, -105), (-120, -163), (-300, -300), (-363, -363), (-305, -305)),
    ],
)
def test_the_firmware_makes_another_power_of_most(asked: int, made: int) -> None:
    assert radiated(asked) == made


def test_only_powers_that_the_firmware_gets_right_are_asked_for() -> None:
    right = [asked for asked in range(-363, 1) if radiated(asked) == asked]
    assert right == sorted(-10 * large - small for large in (0, 10, 20, 30) for small in (0, 5, 63))
    assert [power_setting(asked / 10) for asked in right] == right


def test_link_quality_grows_from_the_weakest_frame_over_twenty_decibels() -> None:
    dbm = np.array([-120.0, -96.0, -86.0, -76.0, -30.0])
    assert link_qualities(dbm, -96.0).tolist() == [0, 0, 128, 255, 255]
