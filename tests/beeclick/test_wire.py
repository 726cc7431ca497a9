import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.bounds import ParameterError
from firmware_bridge.beeclick import wire
from firmware_bridge.beeclick.parameters import BeeClickParameters, BoardSettings
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
    ("03 00 00", SetPower(0)),
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
    ("01 00 01 00 02 00 00 00 00 00", ReceivedPacket(1, 2, 0, 0, 0, b"")),
    ("02 04 03 02 01 00", PacketSent(0x01020304, failed=False)),
    ("02 04 03 02 01 01", PacketSent(0x01020304, failed=True)),
    ("03 00", SetChannel(0)),
    ("04 95 fe", SetPower(-363)),
    ("05 ba ba 03 01", SetAddress(0xBABA, 0x0103)),
    ("06 08 24 47 50 52 4d 43 2c 56", Sentence(b"$GPRMC,V")),
    ("07 04 c2 b0 43 0a", Notes("°C\n".encode())),
    ("08 d7 00", Warmth(215)),
    ("08 73 fe", Warmth(-397)),
    ("09 ec ff", Moisture(-20)),
]


@pytest.mark.parametrize(("text", "command"), COMMANDS)
def test_a_command_is_these_bytes(text: str, command: Command) -> None:
    data = bytes.fromhex(text)
    assert wire.encode_command(command) == data
    assert wire.command_size(data) == len(data)
    assert wire.decode_command(data) == command


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
        (SendPacket(-1, b""), "SendPacket.number is -1, but must be from 0 to 4294967295"),
        (SetChannel(16), "SetChannel.code is 16, but must be from 0 to 15"),
        (SetPower(1), "SetPower.tenths_db is 1, but must be from -363 to 0"),
        (SetPower(-364), "SetPower.tenths_db is -364, but must be from -363 to 0"),
        (SetAddress(0x10000, 0), "SetAddress.pan is 65536, but must be from 0 to 65535"),
        (SetAddress(0, -1), "SetAddress.address is -1, but must be from 0 to 65535"),
    ],
)
def test_a_value_that_the_board_cannot_take_is_refused(command: Command, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        wire.encode_command(command)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        (
            ReceivedPacket(0, 0, 0, 0, 0, bytes(119)),
            "the length of ReceivedPacket.data is 119, but must be from 0 to 118",
        ),
        (Notes(b"x" * 256), "the length of Notes.text is 256, but must be from 0 to 255"),
    ],
)
def test_an_answer_that_does_not_fit_is_refused(answer: Answer, sentence: str) -> None:
    with pytest.raises(ParameterError) as caught:
        wire.encode_answer(answer)
    assert str(caught.value) == sentence


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("0a", "unknown_type"),
        ("ff", "unknown_type"),
        ("00 49", "bad_pattern"),
        ("00 48 65 6c 6c 6f 20 74 68 65 72 65 20", "bad_pattern"),
        ("01 77", "bad_length"),
        ("02 00 00 00 00 02", "bad_status"),
        ("03 10", "bad_channel"),
        ("04 01 00", "bad_power"),
        ("04 94 fe", "bad_power"),
        ("06 05", "bad_length"),
        ("06 ff", "bad_length"),
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


@pytest.mark.parametrize(
    ("text", "cause"), [("05", "unknown_type"), ("02 00 00", "bad_length"), ("00" * 13, "bad_pattern")]
)
def test_what_no_host_says_is_noise(text: str, cause: str) -> None:
    with pytest.raises(NoiseError) as caught:
        wire.decode_command(bytes.fromhex(text))
    assert str(caught.value) == cause


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
        ({"address": 1, "channel": 27}, "board.channel is 27, but must be from 11 to 26"),
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


def test_a_link_is_not_made_with_nonsense() -> None:
    with pytest.raises(ParameterError) as caught:
        BeeClickParameters(in_flight=8)
    assert str(caught.value) == "beeclick.in_flight is 8, but must be from 1 to 6"
    with pytest.raises(ParameterError) as caught:
        BeeClickParameters(ring=8)
    assert str(caught.value) == "beeclick.ring is 8, but must be from 5 to 7"


def test_the_set_up_is_address_channel_and_power() -> None:
    assert BoardSettings(0x0103, channel=11, power_dbm=-36.3).commands() == (
        SetAddress(0xBABA, 0x0103),
        SetChannel(0),
        SetPower(-363),
    )


def test_the_line_takes_ten_bits_a_byte() -> None:
    assert byte_time(0) == 0
    assert byte_time(921_600) == 10_000_000
    assert byte_time(1) == 11  # 10.85
    for count in range(500):
        assert bytes_in(byte_time(count)) == count
        assert bytes_in(byte_time(count) - 1) == max(count - 1, 0)
