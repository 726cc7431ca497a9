"""Bytes of commands and feedback, computed by hand, both ways; and what strange bytes do."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_bridge.kobuki.wire import (
    BaseControl,
    Basic,
    Command,
    Feedback,
    FrameReader,
    GeneralOutput,
    Inertial,
    MalformedError,
    SoundSequence,
    Unknown,
    WireMisuseError,
    decode_commands,
    decode_feedback,
    encode_command,
    encode_feedback,
    encode_frame,
)

COMMANDS = [
    # 06^01^04^64 = 67
    (BaseControl(100, 0), "aa 55 06 01 04 64 00 00 00 67"),
    # -100 = ff9c, 1: 06^01^04^9c^ff^01 = 61
    (BaseControl(-100, 1), "aa 55 06 01 04 9c ff 01 00 61"),
    (SoundSequence(4), "aa 55 03 04 01 04 02"),
    # rails and LED 1 green: 02f0: 04^0c^02^f0^02 = f8
    (GeneralOutput(0x02F0), "aa 55 04 0c 02 f0 02 f8"),
]
FEEDBACK = [
    (
        Basic(0x1234, 1, 2, 4, 0xFFFE, 3, -5, 6, 1, 6, 164, 2),
        "01 0f 34 12 01 02 04 fe ff 03 00 fb 06 01 06 a4 02",
    ),
    (Unknown(3, b"\x01\x02\x10"), "03 03 01 02 10"),
    (Inertial(-9000, 250), "04 07 d8 dc fa 00 00 00 00"),
    (Unknown(5, bytes.fromhex("d0 07 d1 07 ff 0f")), "05 06 d0 07 d1 07 ff 0f"),
    (Unknown(6, b"\x07\xff"), "06 02 07 ff"),
    (Unknown(10, b"\x04\x00\x01\x00"), "0a 04 04 00 01 00"),
    (Unknown(99, b"\x07"), "63 01 07"),
]


@pytest.mark.parametrize(("command", "wire"), COMMANDS)
def test_a_command_has_these_bytes(command: Command, wire: str) -> None:
    assert encode_frame(encode_command(command)) == bytes.fromhex(wire)
    assert FrameReader(decode_commands).take(bytes.fromhex(wire)) == [[command]]


@pytest.mark.parametrize(("feedback", "wire"), FEEDBACK)
def test_a_feedback_packet_has_these_bytes(feedback: Feedback, wire: str) -> None:
    assert encode_feedback(feedback) == bytes.fromhex(wire)
    assert decode_feedback(bytes.fromhex(wire)) == [feedback]


@pytest.mark.parametrize(
    "command",
    [BaseControl(0x8000, 0), BaseControl(0, -0x8001), SoundSequence(256)],
)
def test_numbers_that_do_not_fit_are_our_own_misuse(command: Command) -> None:
    with pytest.raises(WireMisuseError):
        encode_command(command)
    with pytest.raises(WireMisuseError, match=r"^a payload of 161 bytes; it should have 3 to 160$"):
        encode_frame(bytes(161))


INT16 = st.integers(-0x8000, 0x7FFF)
UINT16 = st.integers(0, 0xFFFF)
UINT8 = st.integers(0, 0xFF)
ANY_FEEDBACK: st.SearchStrategy[Feedback] = st.one_of(
    st.builds(
        Basic, UINT16, UINT8, UINT8, UINT8, UINT16, UINT16, *[st.integers(-128, 127)] * 2, *[UINT8] * 4
    ),
    st.builds(Inertial, INT16, INT16),
    st.builds(Unknown, st.integers(30, 255), st.binary(min_size=1, max_size=20)),
)
ANY_COMMAND: st.SearchStrategy[Command] = st.one_of(
    st.builds(BaseControl, INT16, INT16),
    st.builds(SoundSequence, UINT8),
    st.builds(GeneralOutput, UINT16),
)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(st.lists(ANY_FEEDBACK, min_size=1, max_size=6), max_size=4),
    st.lists(ANY_COMMAND, min_size=1, max_size=5),
    st.integers(1, 40),
)
def test_whatever_is_said_is_heard_however_it_is_cut(
    feedbacks: list[list[Feedback]], commands: list[Command], chunk: int
) -> None:
    wire = b"".join(encode_frame(b"".join(map(encode_feedback, packets))) for packets in feedbacks)
    reader = FrameReader(decode_feedback)
    heard = [p for at in range(0, len(wire), chunk) for p in reader.take(wire[at : at + chunk])]
    assert heard == feedbacks
    assert reader.reception.skipped == 0
    payload = b"".join(map(encode_command, commands))
    assert FrameReader(decode_commands).take(encode_frame(payload)) == [commands]


RIGHT = bytes.fromhex("aa 55 06 01 04 64 00 00 00 67")


def counts_of(wire: str | bytes) -> tuple[int, int, int, int, int]:
    reader = FrameReader(decode_commands)
    reader.take(bytes.fromhex(wire) if isinstance(wire, str) else wire)
    r = reader.reception
    return r.frames, r.noise, r.bad_length, r.bad_checksum, r.malformed


def test_noise_is_skipped_and_counted_by_its_cause() -> None:
    assert counts_of(b"\x00\xaa\x11" + RIGHT) == (1, 3, 0, 0, 0)
    # the header's first byte is skipped for its cause, what follows until the next header is noise
    assert counts_of(b"\xaa\x55\x00" + RIGHT) == (1, 2, 1, 0, 0)
    assert counts_of(b"\xaa\x55\xff" + RIGHT) == (1, 2, 1, 0, 0)
    assert counts_of(RIGHT[:-1] + b"\x66" + RIGHT) == (1, 9, 0, 1, 0)
    assert counts_of("aa 55 03 63 01 00 61" + RIGHT.hex()) == (1, 6, 0, 0, 1)  # there is no command 99
    with pytest.raises(MalformedError, match=r"^packet 3 has 4 bytes of data, not 3$"):
        decode_feedback(bytes((3, 4, 0, 0, 0, 0)))
    assert counts_of(b"\xaa\x55\x09" + RIGHT) == (1, 2, 0, 1, 0), "a frame within what looked like one"
    assert counts_of("aa 55 03 01 04 00 06" + RIGHT.hex()) == (1, 6, 0, 0, 1)  # longer than its payload


def test_an_unfinished_frame_waits_and_no_more_than_one_is_kept() -> None:
    reader = FrameReader(decode_commands)
    assert reader.take(RIGHT[:-1]) == []
    assert reader.pending == 9
    assert reader.take(RIGHT[-1:]) == [[BaseControl(100, 0)]]
    reader.take(b"\xaa\x55\xa0" + bytes(150))
    assert reader.pending == 153
    reader.take(bytes(10_000))
    assert reader.pending == 0
