"""MAC frames byte by byte: vectors, round trips, and what is no frame."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from actors.ieee802154 import PSDU_LIMIT
from actors.radio.frame import octets
from actors.radio.frame_check import frame_check
from actors.radio.frame_codec import (
    BROADCAST,
    Acknowledgement,
    DataFrame,
    Endpoint,
    Frame,
    FrameError,
    beeclick,
    broadcast,
    decode,
    encode,
    unicast,
)
from firmware_bridge.beeclick.signal import mac_header


def with_check(body: str | bytes) -> bytes:
    octets = bytes.fromhex(body) if isinstance(body, str) else body
    return octets + frame_check(octets).to_bytes(2, "little")


@pytest.mark.parametrize(
    ("frame", "header"),
    [
        (broadcast(0x1234, 0x0001, 0x2A, b"hi"), "41 88 2a 34 12 ff ff 01 00 6869"),
        (unicast(0xBEEF, 0x0001, 0x0102, 7, b""), "61 88 07 ef be 02 01 01 00"),
        (beeclick(0xBABA, 0x0103, b"x"), "01 80 00 ba ba 03 01 78"),
        (Acknowledgement(0x56), "02 00 56"),
        (Acknowledgement(9, pending=True, version=1), "12 10 09"),
        (
            DataFrame(1, Endpoint(1, 0x1122334455667788, True), Endpoint(2, 3), b"\xff", version=1),
            "01 9c 01 0100 8877665544332211 0200 0300 ff",
        ),
        (DataFrame(0, Endpoint(0xFFFF, BROADCAST), None, b"\0", pending=True), "11 08 00 ffff ffff 00"),
    ],
    ids=["broadcast", "unicast", "BEE click", "acknowledgement", "pending", "extended", "no source"],
)
def test_known_frames(frame: Frame, header: str) -> None:
    assert encode(frame) == with_check(header)
    assert decode(with_check(header)) == frame


def test_the_acknowledgement_of_the_standards_example() -> None:
    # IEEE 802.15.4-2006, 7.2.1.9: 0100 0000 0000 0000 0101 0110, FCS 0010 0111 1001 1110, first bit first.
    bits = "0100000000000000010101100010011110011110"
    octets = bytes(int(bits[k : k + 8][::-1], 2) for k in range(0, 40, 8))
    assert decode(octets) == Acknowledgement(0b01101010)
    assert encode(Acknowledgement(0b01101010)) == octets


def test_a_beeclick_frame_carries_118_bytes_and_no_more() -> None:
    frame = beeclick(1, 2, bytes(118))
    assert len(encode(frame)) == PSDU_LIMIT == octets(118)
    with pytest.raises(FrameError) as error:
        encode(beeclick(1, 2, bytes(119)))
    assert str(error.value) == "The frame has 128 octets; at most 127 fit."


@settings(derandomize=True)
@given(pan=st.integers(0, 0xFFFF), address=st.integers(0, 0xFFFF), data=st.binary(max_size=118))
def test_a_beeclick_frame_is_what_the_emulated_board_sends(pan: int, address: int, data: bytes) -> None:
    assert encode(beeclick(pan, address, data)) == with_check(mac_header(pan, address) + data)


endpoints = st.one_of(
    st.builds(Endpoint, st.integers(0, 0xFFFF), st.integers(0, 0xFFFF)),
    st.builds(Endpoint, st.integers(0, 0xFFFF), st.integers(0, 2**64 - 1), st.just(True)),
)
octet = st.integers(0, 255)


@st.composite
def data_frames(draw: st.DrawFn) -> DataFrame:
    destination, source = draw(
        st.tuples(st.none() | endpoints, st.none() | endpoints).filter(lambda ends: ends != (None, None))
    )
    compressed = destination is not None and source is not None and draw(st.booleans())
    if compressed and destination is not None and source is not None:
        source = Endpoint(destination.pan, source.address, source.extended)
    flags = [draw(st.booleans()) for _ in range(2)]
    return DataFrame(
        draw(octet), destination, source, draw(st.binary(max_size=102)), flags[0], compressed, flags[1],
        draw(st.integers(0, 1)),
    )  # fmt: skip


frames = data_frames() | st.builds(Acknowledgement, octet, st.booleans(), st.integers(0, 1))


@settings(derandomize=True, max_examples=400)
@given(frame=frames)
def test_what_is_written_reads_back(frame: Frame) -> None:
    octets = encode(frame)
    assert 5 <= len(octets) <= PSDU_LIMIT
    assert decode(octets) == frame


@settings(derandomize=True, max_examples=200)
@given(frame=frames, bit=st.integers(0, 127 * 8 - 1))
def test_a_flipped_bit_is_noticed(frame: Frame, bit: int) -> None:
    octets = bytearray(encode(frame))
    octets[bit // 8 % len(octets)] ^= 1 << bit % 8
    with pytest.raises(FrameError, match="check sequence"):
        decode(bytes(octets))


controls = st.builds(struct.pack, st.just("<H"), st.integers(0, 0xFFFF))


@settings(derandomize=True, max_examples=1000)
@given(
    noise=st.binary(max_size=140) | st.builds(bytes.__add__, controls, st.binary(max_size=40)).map(with_check)
)
def test_noise_is_a_frame_or_refused(noise: bytes) -> None:
    try:
        frame = decode(noise)
    except FrameError as error:
        assert str(error).endswith(".") and len(str(error)) < 120
    else:
        assert encode(frame) == noise


@pytest.mark.parametrize(
    ("octets", "sentence"),
    [
        (b"", "The frame has 0 octets; it must have 5 to 127."),
        (bytes(128), "The frame has 128 octets; it must have 5 to 127."),
        (b"\x02\0\0\0\0", "The frame's check sequence is 0x0000; that of its octets is 0xb5b8."),
        (
            with_check("00 80 00 0100 0200"),
            "The frame is a beacon; data frames and acknowledgements are read.",
        ),
        (
            with_check("03 80 00 0100 0200"),
            "The frame is a command; data frames and acknowledgements are read.",
        ),
        (
            with_check("07 80 00"),
            "The frame is of the reserved type 7; data frames and acknowledgements are read.",
        ),
        (with_check("09 80 00 0100 0200"), "The frame is secured; only those in the clear are read."),
        (with_check("01 a0 00"), "The frame is of version 2; those of 2003 and 2006, 0 and 1, are read."),
        (with_check("01 81 00"), "The frame sets reserved bits of its control field; they must be 0."),
        (with_check("01 40 00"), "The frame has an address of the reserved mode 1; modes are 0, 2 and 3."),
        (
            with_check("01 00 00"),
            "The data frame has neither destination nor source; it must have one of them.",
        ),
        (
            with_check("41 80 00 0100 0200"),
            "The frame leaves its source's PAN out; both ends must be given, and of one PAN.",
        ),
        (with_check("01 80 00 01 00"), "The frame ends within its addresses, which need 9 octets."),
        (with_check("02 00 00 00"), "The acknowledgement has 6 octets; it must have 5."),
        (
            with_check("22 00 00"),
            "The acknowledgement's control field promises addresses or asks for an answer.",
        ),
    ],
)
def test_what_is_not_read_is_refused_in_a_sentence(octets: bytes, sentence: str) -> None:
    with pytest.raises(FrameError) as error:
        decode(octets)
    assert str(error.value) == sentence


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (Acknowledgement(256), "The frame's sequence number is 256; it must be 0 to 255."),
        (Acknowledgement(0, version=2), "The frame's version is 2; it must be 0 to 1."),
        (beeclick(0x10000, 1, b"x"), "The frame's PAN is 65536; it must be 0 to 65535."),
        (beeclick(1, -1, b"x"), "The frame's short address is -1; it must be 0 to 65535."),
        (
            DataFrame(0, None, None, b""),
            "The data frame has neither destination nor source; it must have one of them.",
        ),
        (
            DataFrame(0, Endpoint(1, 1), Endpoint(2, 2), b"", compressed=True),
            "The frame leaves its source's PAN out; both ends must be given, and of one PAN.",
        ),
    ],
)
def test_what_no_frame_can_hold_is_refused_in_a_sentence(frame: Frame, sentence: str) -> None:
    with pytest.raises(FrameError) as error:
        encode(frame)
    assert str(error.value) == sentence
