"""MAC frames byte by byte: vectors, round trips, and what is no frame of a BEE click."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.ieee802154 import PSDU_LIMIT
from actors.messages import FRAME_DATA_LIMIT
from actors.radio.frame import (
    DataFrame,
    FrameError,
    airtime_us,
    decode,
    encode,
    frame_check,
    octets,
    size_fault,
)
from tests.refusals import refused


def with_check(body: str | bytes) -> bytes:
    octets = bytes.fromhex(body) if isinstance(body, str) else body
    return octets + frame_check(octets).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("frame", "body"),
    [
        (DataFrame(0xBABA, 0x0103, b"x"), "01 80 00 ba ba 03 01 78"),
        (DataFrame(0x1234, 0xFFFD, b"hi", 0x2A), "01 80 2a 34 12 fd ff 6869"),
        (DataFrame(1, 2, b""), "01 80 00 0100 0200"),
    ],
)
def test_known_frames(frame: DataFrame, body: str) -> None:
    assert encode(frame) == with_check(body)
    assert decode(with_check(body)) == frame
    assert frame.check == int.from_bytes(encode(frame)[-2:], "little")


def test_the_frame_check_sequence_is_the_standards() -> None:
    # The catalogue's check value of CRC-16/KERMIT, which is the same sum.
    assert frame_check(b"123456789") == 0x2189
    # The example of IEEE 802.15.4-2006, 7.2.1.9: header and sum of an acknowledgement, first bit first.
    header = bytes(int(bits[::-1], 2) for bits in ("01000000", "00000000", "01010110"))
    assert f"{frame_check(header):016b}"[::-1] == "0010011110011110"


def test_a_frame_carries_118_bytes_and_no_more() -> None:
    assert len(encode(DataFrame(1, 2, bytes(118)))) == PSDU_LIMIT == octets(118)
    with refused("The frame has 128 octets; at most 127 fit.", FrameError):
        encode(DataFrame(1, 2, bytes(119)))
    assert size_fault(0) == size_fault(FRAME_DATA_LIMIT) == ""
    assert size_fault(119) == "The frame has 119 data bytes; it must have 0 to 118."


words = st.integers(0, 0xFFFF)
frames = st.builds(DataFrame, words, words, st.binary(max_size=118), st.integers(0, 255))


@settings(derandomize=True, max_examples=400)
@given(frame=frames)
def test_what_is_written_reads_back(frame: DataFrame) -> None:
    psdu = encode(frame)
    assert len(psdu) == octets(len(frame.data))
    assert decode(psdu) == frame


@settings(derandomize=True, max_examples=200)
@given(frame=frames, bit=st.integers(0, 127 * 8 - 1))
def test_a_flipped_bit_is_noticed(frame: DataFrame, bit: int) -> None:
    psdu = bytearray(encode(frame))
    psdu[bit // 8 % len(psdu)] ^= 1 << bit % 8
    with pytest.raises(FrameError, match="check sequence"):
        decode(bytes(psdu))


controls = st.builds(struct.pack, st.just("<H"), st.just(0x8001) | words)


@settings(derandomize=True, max_examples=400)
@given(
    noise=st.binary(max_size=140)
    | st.builds(bytes.__add__, controls, st.binary(max_size=140)).map(with_check)
)
def test_noise_is_a_frame_or_refused(noise: bytes) -> None:
    try:
        frame = decode(noise)
    except FrameError as error:
        assert str(error).endswith(".") and len(str(error)) < 120
    else:
        assert encode(frame) == noise


OF_A_BEE_CLICK = "that of a BEE click's frame is 0x8001."


@pytest.mark.parametrize(
    ("psdu", "sentence"),
    [
        (with_check("01 80 00 01 00 02"), "The frame has 8 octets; it must have 9 to 127."),
        (bytes(128), "The frame has 128 octets; it must have 9 to 127."),
        (
            bytes.fromhex("01 80 00 0100 0200 0000"),
            f"The frame's check sequence is 0x0000; that of its octets is "
            f"{frame_check(bytes.fromhex('01800001000200')):#06x}.",
        ),
        (
            with_check("41 88 2a 34 12 ff ff 01 00 6869"),
            f"The frame's control field is 0x8841; {OF_A_BEE_CLICK}",
        ),
    ],
    ids=["cut", "long", "check", "broadcast"],
)
def test_what_is_not_read_is_refused_in_a_sentence(psdu: bytes, sentence: str) -> None:
    with refused(sentence, FrameError):
        decode(psdu)


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (DataFrame(1, 2, b"x", 256), "The frame's sequence number is 256; it must be 0 to 255."),
        (DataFrame(0x10000, 1, b"x"), "The frame's PAN is 65536; it must be 0 to 65535."),
        (DataFrame(1, -1, b"x"), "The frame's short address is -1; it must be 0 to 65535."),
    ],
)
def test_what_no_frame_can_hold_is_refused_in_a_sentence(frame: DataFrame, sentence: str) -> None:
    with refused(sentence, FrameError):
        encode(frame)


@pytest.mark.parametrize(("data", "microseconds"), [(118, 4256), (0, 480), (1, 512), (11, 832), (51, 2112)])
def test_airtime_is_that_of_the_standard(data: int, microseconds: int) -> None:
    assert airtime_us(data) == microseconds
