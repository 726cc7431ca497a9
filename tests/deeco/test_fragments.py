"""L1, the sender's side: what stands in the frames, and how packets share them."""

import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco.errors import ExecutionError
from deeco.link import LinkParameters
from deeco.replication.fragments import CHECKSUM, HEADER, Fragmenter

ROOM = 118 - 9


def pieces(frame: bytes) -> list[tuple[int, int, int, int, int]]:
    """The headers in a frame."""
    found, position = [], 0
    while position < len(frame):
        header = HEADER.unpack_from(frame, position)
        found.append(header)
        position += HEADER.size + header[1]
    assert position == len(frame)
    return found


def lengths(sizes: list[int], limits: LinkParameters | None = None) -> list[list[int]]:
    """Bytes of each fragment of each frame, for packets that take so many with their checksums."""
    frames = Fragmenter(1, limits or LinkParameters()).frames([bytes(size - 4) for size in sizes])
    return [[size for _, size, *_ in pieces(frame)] for frame in frames]


def test_the_bytes_of_a_frame() -> None:
    """totalSize, payloadSize, startPos, dataId: two bytes, little-endian; srcNode: one (JDEECo, L1Packet)."""
    (frame,) = Fragmenter(0x0C).frames([b"abcde"])
    assert zlib.crc32(b"abcde") == 0x8587D865
    assert frame.hex(" ") == "09 00 09 00 00 00 00 00 0c 61 62 63 64 65 65 d8 87 85"


def test_the_bytes_of_a_packet_in_two_frames() -> None:
    fragmenter = Fragmenter(0x0C, LinkParameters(frame_data=16))
    fragmenter.frames([b"x"] * 0x0102)
    first, second = fragmenter.frames([b"abcde"])
    assert first.hex(" ") == "09 00 07 00 00 00 02 01 0c 61 62 63 64 65 65 d8"
    assert second.hex(" ") == "09 00 02 00 07 00 02 01 0c 87 85"


def test_the_source_is_the_lowest_byte_of_the_node() -> None:
    (frame,) = Fragmenter(0x1234).frames([b"x"])
    assert frame[8] == 0x34


def test_no_packets_no_frames() -> None:
    assert Fragmenter(1).frames([]) == []


def test_small_packets_share_a_frame() -> None:
    assert lengths([30, 30, 30]) == [[30, 30, 30]]
    assert lengths([30, 30, 32]) == [[30, 30], [32]]
    assert lengths([50, 50]) == [[50, 50]]


def test_a_packet_is_split_only_if_that_saves_a_frame() -> None:
    assert lengths([60, 60]) == [[60], [60]]
    assert lengths([70, 70, 50]) == [[70, 30], [40, 50]]


def test_a_long_packet_takes_the_room_that_another_left() -> None:
    assert lengths([30, 70 + 109]) == [[30, 70], [109]]
    assert lengths([30, 70 + 110]) == [[30], [109], [71]]  # three frames either way, of which it needs two


def test_no_fragment_is_begun_in_too_little_room() -> None:
    assert lengths([93, 110]) == [[93], [109], [1]]
    assert lengths([92, 110]) == [[92, 8], [102]]
    assert lengths([93, 110], LinkParameters(least_fragment=7)) == [[93, 7], [103]]


def test_numbers_wrap_around() -> None:
    fragmenter = Fragmenter(1)
    fragmenter.frames([b"x"] * 65_535)
    (frame,) = fragmenter.frames([b"x", b"y"])
    assert [number for *_, number, _ in pieces(frame)] == [65_535, 0]


@pytest.mark.parametrize("size", [0, 1025])
def test_a_packet_beyond_the_limit_is_refused_and_uses_no_number(size: int) -> None:
    fragmenter = Fragmenter(1)
    with pytest.raises(ExecutionError) as error:
        fragmenter.frames([b"x", bytes(size)])
    assert str(error.value) == (
        f"a packet for the link has {size} bytes; it should have 1 to 1024 (LinkParameters.most_packet)"
    )
    (frame,) = fragmenter.frames([b"x"])
    assert pieces(frame) == [(5, 5, 0, 0, 1)]


def test_the_largest_packet_that_the_header_can_say() -> None:
    frames = Fragmenter(1, LinkParameters(most_packet=65_531)).frames([bytes(65_531)])
    assert len(frames) == -(-65_535 // ROOM)


@given(st.lists(st.binary(min_size=1, max_size=400), max_size=12), st.integers(10, 200), st.integers(1, 60))
@settings(derandomize=True, max_examples=300, deadline=None)
def test_every_byte_goes_once_in_frames_that_the_link_takes(
    packets: list[bytes], frame_data: int, least: int
) -> None:
    limits = LinkParameters(frame_data=frame_data, least_fragment=least)
    frames = Fragmenter(7, limits).frames(packets)
    whole = [bytearray() for _ in packets]
    for frame in frames:
        assert len(frame) <= frame_data
        position = 0
        for total, size, start, number, source in pieces(frame):
            assert source == 7
            assert total == len(packets[number]) + 4
            assert start == len(whole[number])
            position += HEADER.size
            whole[number] += frame[position : position + size]
            position += size
    assert whole == [packet + CHECKSUM.pack(zlib.crc32(packet)) for packet in packets]


@given(st.lists(st.integers(5, 400), min_size=1, max_size=12))
@settings(derandomize=True, max_examples=300, deadline=None)
def test_never_more_frames_than_without_sharing(sizes: list[int]) -> None:
    assert len(lengths(sizes)) <= sum(-(-size // ROOM) for size in sizes)
