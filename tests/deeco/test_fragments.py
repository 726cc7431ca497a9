"""L1, the sender's side: what stands in the frames, and how packets share them."""

import zlib
from dataclasses import dataclass

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco.errors import ExecutionError
from deeco.instant import START, Instant, milliseconds, seconds
from deeco.link import LinkParameters
from deeco.replication.fragments import CHECKSUM, HEADER, Fragmenter, Reassembly

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
    (frame,) = Fragmenter(0x120C).frames([b"abcde"])
    assert zlib.crc32(b"abcde") == 0x8587D865
    assert frame.hex(" ") == "09 00 09 00 00 00 00 00 0c 61 62 63 64 65 65 d8 87 85"


def test_the_bytes_of_a_packet_in_two_frames() -> None:
    fragmenter = Fragmenter(0x0C, LinkParameters(frame_data=16))
    fragmenter.frames([b"x"] * 0x0102)
    first, second = fragmenter.frames([b"abcde"])
    assert first.hex(" ") == "09 00 07 00 00 00 02 01 0c 61 62 63 64 65 65 d8"
    assert second.hex(" ") == "09 00 02 00 07 00 02 01 0c 87 85"


def test_small_packets_share_a_frame() -> None:
    assert Fragmenter(1).frames([]) == []
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


SMALL = LinkParameters(frame_data=20)
"""Eleven bytes of payload in a frame."""
PACKET = b"a packet of twenty-seven by"
"""In three frames of SMALL, with its checksum."""


def fragment(whole: bytes, start: int, size: int, *, number: int = 0, total: int | None = None) -> bytes:
    """A fragment of a whole packet."""
    header = HEADER.pack(len(whole) if total is None else total, size, start, number, 7)
    return header + whole[start : start + size]


def whole(packet: bytes) -> bytes:
    """A packet with its checksum."""
    return packet + CHECKSUM.pack(zlib.crc32(packet))


def counted(reassembly: Reassembly) -> dict[str, int]:
    """The counters that are not zero."""
    return {name: count for name, count in reassembly.counters().items() if count}


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0), (0, 0, 2, 2, 1)])
def test_fragments_come_in_any_order_and_more_than_once(order: tuple[int, ...]) -> None:
    frames = Fragmenter(7, SMALL).frames([PACKET])
    assert len(frames) == 3
    reassembly = Reassembly(SMALL)
    got = [packet for index in order for packet in reassembly.take(START, 1, frames[index])]
    assert got == [PACKET]
    assert reassembly.open_packets == 0


def test_a_frame_with_fragments_of_two_packets() -> None:
    first, second = Fragmenter(7, LinkParameters(frame_data=60)).frames([PACKET, b"x" * 50])
    reassembly = Reassembly()
    assert reassembly.take(START, 1, first) == [PACKET]
    assert reassembly.open_packets == 1
    assert reassembly.take(START, 1, second) == [b"x" * 50]


def test_senders_and_sources_are_kept_apart() -> None:
    reassembly = Reassembly(SMALL)
    one, other = (Fragmenter(7, SMALL).frames([packet]) for packet in (PACKET, PACKET[::-1]))
    third = Fragmenter(8, SMALL).frames([PACKET.upper()])
    got = []
    for index in range(3):
        got += reassembly.take(START, 1, one[index])
        got += reassembly.take(START, 2, other[index])
        got += reassembly.take(START, 1, third[index])
    assert got == [PACKET, PACKET[::-1], PACKET.upper()]


def test_overlapping_fragments() -> None:
    data = whole(PACKET)
    reassembly = Reassembly()
    assert reassembly.take(START, 1, fragment(data, 0, 20)) == []
    assert reassembly.take(START, 1, fragment(data, 5, 9)) == []
    assert reassembly.take(START, 1, fragment(data, 19, 12)) == [PACKET]
    assert counted(reassembly) == {"complete": 1}


def test_overlapping_fragments_that_contradict_one_another_do_not_hold() -> None:
    data = whole(PACKET)
    reassembly = Reassembly()
    reassembly.take(START, 1, fragment(data, 0, 20))
    reassembly.take(START, 1, fragment(data.upper(), 5, 9))
    assert reassembly.take(START, 1, fragment(data, 19, 12)) == []
    assert counted(reassembly) == {"bad_checksum": 1}
    assert reassembly.open_packets == 0


def test_another_size_for_the_same_number_begins_a_new_packet() -> None:
    """As after 65 536 packets, or when a node was restarted."""
    old, new = whole(PACKET), whole(PACKET + b"tes")
    reassembly = Reassembly()
    reassembly.take(START, 1, fragment(old, 0, 20))
    assert reassembly.take(START, 1, fragment(new, 0, 20)) == []
    assert reassembly.open_packets == 1
    assert reassembly.take(START, 1, fragment(new, 20, 14)) == [PACKET + b"tes"]
    assert counted(reassembly) == {"complete": 1, "contradicted": 1}


def test_a_whole_packet_takes_the_place_of_an_open_one() -> None:
    data = whole(PACKET)
    reassembly = Reassembly()
    reassembly.take(START, 1, fragment(data, 0, 20))
    assert reassembly.take(START, 1, fragment(data, 0, 31)) == [PACKET]
    assert reassembly.open_packets == 0
    reassembly.take(START, 1, fragment(data, 0, 20))
    assert reassembly.take(START, 1, fragment(whole(b"x"), 0, 5)) == [b"x"]
    assert counted(reassembly) == {"complete": 2, "contradicted": 1}


def test_what_is_not_complete_in_time_is_given_up() -> None:
    first, second, third = Fragmenter(7, SMALL).frames([PACKET])
    reassembly = Reassembly(SMALL)
    reassembly.take(START, 1, first)
    assert reassembly.take(Instant(seconds(2) - 1), 1, second) == []
    assert counted(reassembly) == {}
    assert reassembly.take(Instant(seconds(2)), 1, third) == []
    assert counted(reassembly) == {"timed_out": 1}
    assert reassembly.open_packets == 1  # the third alone, since now
    reassembly.give_up(Instant(seconds(4)))
    assert (reassembly.open_packets, reassembly.open_bytes) == (0, 0)
    assert counted(reassembly) == {"timed_out": 2}


def test_one_too_many_drives_out_the_oldest() -> None:
    limits = LinkParameters(frame_data=20, most_open=2)
    frames = [Fragmenter(7, limits).frames([PACKET]) for _ in range(3)]
    reassembly = Reassembly(limits)
    for sender in range(3):
        reassembly.take(Instant(milliseconds(sender)), sender, frames[sender][0])
    assert reassembly.open_packets == 2
    got = [
        (sender, packet)
        for sender in (2, 1)
        for frame in frames[sender][1:]
        for packet in reassembly.take(Instant(milliseconds(9)), sender, frame)
    ]
    assert got == [(2, PACKET), (1, PACKET)]
    assert counted(reassembly) == {"complete": 2, "evicted": 1}


def test_a_packet_above_the_limit_is_not_kept() -> None:
    reassembly = Reassembly()
    largest = whole(bytes(1024))
    assert reassembly.take(START, 1, fragment(largest, 0, 600)) == []
    assert reassembly.open_bytes == 1028
    larger = fragment(whole(bytes(1025)), 0, 600, number=1)
    assert reassembly.take(START, 1, larger + fragment(whole(b"x"), 0, 5, number=2)) == [b"x"]
    assert reassembly.open_bytes == 1028
    assert counted(reassembly) == {"complete": 1, "oversized": 1}


GOOD = fragment(whole(b"good"), 0, 8, number=1)


@pytest.mark.parametrize(
    "rest",
    [
        b"\0",  # trailing garbage
        HEADER.pack(9, 5, 0, 0, 7)[:8],  # a truncated header
        HEADER.pack(9, 5, 0, 0, 7),  # nothing behind the header
        HEADER.pack(9, 5, 0, 0, 7) + b"four",  # less behind the header than it says
        HEADER.pack(9, 0, 0, 0, 7) + GOOD,  # nothing in the fragment
        HEADER.pack(4, 4, 0, 0, 7) + bytes(4),  # a checksum of nothing, and it holds
        HEADER.pack(9, 5, 5, 0, 7) + b"bytes",  # beyond the whole
        HEADER.pack(9, 5, 65_535, 0, 7) + b"bytes",
        HEADER.pack(0, 0, 0, 0, 0),
    ],
)
def test_the_rest_of_a_frame_that_makes_no_sense_is_dropped(rest: bytes) -> None:
    reassembly = Reassembly()
    assert reassembly.take(START, 1, GOOD + rest) == [b"good"]
    assert counted(reassembly) == {"complete": 1, "junk_frames": 1}
    assert reassembly.open_packets == 0


def test_numbers_wrap_around_in_the_middle_of_a_packet_s_neighbours() -> None:
    fragmenter, reassembly = Fragmenter(7, SMALL), Reassembly(SMALL)
    fragmenter.frames([b"x"] * 65_535)
    frames = fragmenter.frames([PACKET, PACKET.upper()])
    got = [packet for frame in reversed(frames) for packet in reassembly.take(START, 1, frame)]
    assert sorted(got) == sorted([PACKET, PACKET.upper()])


def bounded(reassembly: Reassembly, limits: LinkParameters) -> bool:
    """Is what is kept within its limits?"""
    most = limits.most_open * (limits.most_packet + CHECKSUM.size)
    return reassembly.open_packets <= limits.most_open and reassembly.open_bytes <= most


TIGHT = LinkParameters(frame_data=40, most_packet=200, most_open=3)
_HEADERS = st.builds(
    HEADER.pack,
    st.integers(0, 250) | st.integers(0, 65_535),
    st.integers(0, 30) | st.integers(0, 65_535),
    st.integers(0, 250) | st.integers(0, 65_535),
    st.integers(0, 9),
    st.integers(0, 3),
)
_FRAMES = st.lists(_HEADERS | st.binary(max_size=30), max_size=6).map(b"".join)


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 2), _FRAMES), max_size=60))
@settings(derandomize=True, max_examples=200, deadline=None)
def test_no_frames_raise_or_fill_the_memory(heard: list[tuple[int, int, bytes]]) -> None:
    reassembly, now = Reassembly(TIGHT), 0
    for later, sender, frame in heard:
        now += later
        for packet in reassembly.take(Instant(now), sender, frame):
            assert 0 < len(packet) <= TIGHT.most_packet
        assert bounded(reassembly, TIGHT)


@dataclass
class Sender:
    address: int
    packets: list[bytes]
    frames: list[bytes]


@st.composite
def _swarms(draw: st.DrawFn) -> list[Sender]:
    """Senders, some of which number their packets alike, and share a source byte."""
    packets = st.lists(st.binary(min_size=1, max_size=200), min_size=1, max_size=5)
    senders = [Sender(address, draw(packets), []) for address in range(draw(st.integers(1, 4)))]
    for sender in senders:
        sender.frames = Fragmenter(draw(st.integers(0, 1)), TIGHT).frames(sender.packets)
    return senders


@given(_swarms(), st.data())
@settings(derandomize=True, max_examples=100, deadline=None)
def test_nothing_is_lost_but_what_the_air_loses(swarm: list[Sender], data: st.DataObject) -> None:
    """All frames once, in any order: every packet comes out once."""
    aired = [(sender.address, frame) for sender in swarm for frame in sender.frames]
    got: list[tuple[int, bytes]] = []
    reassembly = Reassembly(LinkParameters(frame_data=40, most_packet=200))
    for address, frame in data.draw(st.permutations(aired)):
        got += [(address, packet) for packet in reassembly.take(START, address, frame)]
    assert sorted(got) == sorted((sender.address, packet) for sender in swarm for packet in sender.packets)
    assert reassembly.open_packets == 0


@given(_swarms(), st.data())
@settings(derandomize=True, max_examples=200, deadline=None)
def test_whatever_comes_out_was_put_in_by_that_sender(swarm: list[Sender], data: st.DataObject) -> None:
    """Frames are lost, doubled, put in another order and interleaved, and one in five arrives changed."""
    aired = [(sender.address, frame) for sender in swarm for frame in sender.frames]
    heard = data.draw(st.lists(st.sampled_from(aired), max_size=2 * len(aired)))
    reassembly = Reassembly(TIGHT)
    for now, (address, frame) in enumerate(heard):
        at = data.draw(st.integers(0, 5 * len(frame)))
        broken = bytearray(frame)
        if at < len(frame):
            broken[at] ^= data.draw(st.integers(1, 255))
        for packet in reassembly.take(Instant(now), address, bytes(broken)):
            assert packet in swarm[address].packets
        assert bounded(reassembly, TIGHT)
