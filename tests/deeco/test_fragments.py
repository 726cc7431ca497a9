"""Packets and frames: bytes, limits, and robustness against any input."""

import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from deeco.errors import ExecutionError
from deeco.fragments import CHECKSUM, HEADER, Fragmenter, Reassembly
from deeco.instant import START, Instant, milliseconds, seconds
from deeco.link import LinkParameters
from deeco.packet import KnowledgePacket, Unpacker, Version, increment_hops, pack
from tests.deeco.refusals import refused
from tests.deeco.sweepers import REGISTRY, Sweeper, published, robot


def pieces(frame: bytes) -> list[tuple[int, int, int, int, int]]:
    found, position = [], 0
    while position < len(frame):
        header = HEADER.unpack_from(frame, position)
        found.append(header)
        position += HEADER.size + header[1]
    assert position == len(frame)
    return found


def unpack(data: bytes) -> KnowledgePacket | None:
    return Unpacker().unpack(data)


def test_the_bytes_of_frames() -> None:
    """totalSize, payloadSize, startPos, dataId: two bytes, little-endian; srcNode: one (JDEECo, L1Packet)."""
    (frame,) = Fragmenter(0x120C).frames([b"abcde"])
    assert zlib.crc32(b"abcde") == 0x8587D865
    assert frame.hex(" ") == "09 00 09 00 00 00 00 00 0c 61 62 63 64 65 65 d8 87 85"
    fragmenter = Fragmenter(0x0C, LinkParameters(frame_data=16))
    fragmenter.frames([b"x"] * 0x0102)
    first, second = fragmenter.frames([b"abcde"])
    assert first.hex(" ") == "09 00 07 00 00 00 02 01 0c 61 62 63 64 65 65 d8"
    assert second.hex(" ") == "09 00 02 00 07 00 02 01 0c 87 85"


@pytest.mark.parametrize(
    ("sizes", "least", "frames"),
    [
        ([], None, []),
        ([30, 30, 30], None, [[30, 30, 30]]),
        ([30, 30, 32], None, [[30, 30], [32]]),
        ([50, 50], None, [[50, 50]]),
        ([60, 60], None, [[60], [60]]),  # a split would not save a frame
        ([70, 70, 50], None, [[70, 30], [40, 50]]),
        ([30, 70 + 109], None, [[30, 70], [109]]),
        ([30, 70 + 110], None, [[30], [109], [71]]),
        ([93, 110], None, [[93], [109], [1]]),  # too little room to begin a fragment
        ([92, 110], None, [[92, 8], [102]]),
        ([93, 110], 7, [[93, 7], [103]]),
    ],
)
def test_packets_share_frames(sizes: list[int], least: int | None, frames: list[list[int]]) -> None:
    limits = LinkParameters(min_fragment=least) if least else LinkParameters()
    made = Fragmenter(1, limits).frames([bytes(size - 4) for size in sizes])
    assert [[size for _, size, *_ in pieces(frame)] for frame in made] == frames


@pytest.mark.parametrize("size", [0, 1025])
def test_a_packet_beyond_the_limit_is_refused_and_uses_no_number(size: int) -> None:
    fragmenter = Fragmenter(1)
    with refused(
        f"a packet for the link has {size} bytes; must have 1 to 1024 (LinkParameters.max_packet)",
        ExecutionError,
    ):
        fragmenter.frames([b"x", bytes(size)])
    (frame,) = fragmenter.frames([b"x"])
    assert pieces(frame) == [(5, 5, 0, 0, 1)]


@given(st.lists(st.binary(min_size=1, max_size=400), max_size=12), st.integers(10, 200), st.integers(1, 60))
@settings(derandomize=True, max_examples=300, deadline=None)
def test_every_byte_is_sent_once_in_no_more_frames_than_without_sharing(
    packets: list[bytes], frame_data: int, least: int
) -> None:
    frames = Fragmenter(7, LinkParameters(frame_data=frame_data, min_fragment=least)).frames(packets)
    sent = [bytearray() for _ in packets]
    for frame in frames:
        assert len(frame) <= frame_data
        position = 0
        for total, size, start, number, source in pieces(frame):
            assert (source, total, start) == (7, len(packets[number]) + 4, len(sent[number]))
            position += HEADER.size
            sent[number] += frame[position : position + size]
            position += size
    assert sent == [whole(packet) for packet in packets]
    assert len(frames) <= sum(-(-(len(packet) + 4) // (frame_data - HEADER.size)) for packet in packets)


SMALL = LinkParameters(frame_data=20)
"""Eleven bytes of payload in a frame."""
PACKET = b"a packet of twenty-seven by"
"""In three frames of SMALL, with its checksum."""


def fragment(whole: bytes, start: int, size: int, number: int = 0) -> bytes:
    return HEADER.pack(len(whole), size, start, number, 7) + whole[start : start + size]


def whole(packet: bytes) -> bytes:
    return packet + CHECKSUM.pack(zlib.crc32(packet))


def open_packets(reassembly: Reassembly) -> int:
    return len(reassembly.open)


def open_bytes(reassembly: Reassembly) -> int:
    return sum(len(one.data) for one in reassembly.open.values())


def counted(reassembly: Reassembly) -> dict[str, int]:
    return {name: count for name, count in asdict(reassembly.counters).items() if count}


@pytest.mark.parametrize("contradicting", [False, True])
def test_overlapping_fragments(contradicting: bool) -> None:
    data = whole(PACKET)
    reassembly = Reassembly()
    assert reassembly.take(START, 1, fragment(data, 0, 20)) == []
    assert reassembly.take(START, 1, fragment(data.upper() if contradicting else data, 5, 9)) == []
    assert reassembly.take(START, 1, fragment(data, 19, 12)) == ([] if contradicting else [PACKET])
    assert counted(reassembly) == ({"bad_checksum": 1} if contradicting else {"complete": 1})
    assert open_packets(reassembly) == 0


def test_another_size_for_the_same_number_begins_a_new_packet() -> None:
    """As after 65 536 packets, or after a restart of a node."""
    old, new = whole(PACKET), whole(PACKET + b"tes")
    reassembly = Reassembly()
    reassembly.take(START, 1, fragment(old, 0, 20))
    assert reassembly.take(START, 1, fragment(new, 0, 20)) == []
    assert open_packets(reassembly) == 1
    assert reassembly.take(START, 1, fragment(new, 20, 14)) == [PACKET + b"tes"]
    assert counted(reassembly) == {"complete": 1, "contradicted": 1}
    reassembly.take(START, 1, fragment(old, 0, 20))
    assert reassembly.take(START, 1, fragment(old, 0, 31)) == [PACKET]
    assert open_packets(reassembly) == 0
    reassembly.take(START, 1, fragment(old, 0, 20))
    assert reassembly.take(START, 1, fragment(whole(b"x"), 0, 5)) == [b"x"]
    assert counted(reassembly) == {"complete": 3, "contradicted": 2}


def test_incomplete_packets_time_out() -> None:
    first, second, third = Fragmenter(7, SMALL).frames([PACKET])
    reassembly = Reassembly(SMALL)
    reassembly.take(START, 1, first)
    assert reassembly.take(Instant(seconds(2) - 1), 1, second) == []
    assert counted(reassembly) == {}
    assert reassembly.take(Instant(seconds(2)), 1, third) == []
    assert counted(reassembly) == {"timed_out": 1}
    assert open_packets(reassembly) == 1  # the third fragment alone
    reassembly.drop_expired(Instant(seconds(4)))
    assert (open_packets(reassembly), open_bytes(reassembly)) == (0, 0)
    assert counted(reassembly) == {"timed_out": 2}


def test_the_oldest_open_packet_is_evicted() -> None:
    limits = LinkParameters(frame_data=20, max_open=2)
    frames = Fragmenter(7, limits).frames([PACKET])
    reassembly = Reassembly(limits)
    for sender in range(3):
        reassembly.take(Instant(milliseconds(sender)), sender, frames[0])
    assert open_packets(reassembly) == 2
    for sender in (2, 1):
        late = [reassembly.take(Instant(milliseconds(9)), sender, frame) for frame in frames[1:]]
        assert late == [[], [PACKET]]
    assert counted(reassembly) == {"complete": 2, "evicted": 1}


def test_a_packet_above_the_limit_is_not_kept() -> None:
    reassembly = Reassembly()
    assert reassembly.take(START, 1, fragment(whole(bytes(1024)), 0, 600)) == []
    assert open_bytes(reassembly) == 1028
    larger = fragment(whole(bytes(1025)), 0, 600, number=1)
    assert reassembly.take(START, 1, larger + fragment(whole(b"x"), 0, 5, number=2)) == [b"x"]
    assert open_bytes(reassembly) == 1028
    assert counted(reassembly) == {"complete": 1, "oversized": 1}


GOOD = fragment(whole(b"good"), 0, 8, number=1)


@pytest.mark.parametrize(
    "rest",
    [
        HEADER.pack(9, 5, 0, 0, 7)[:8],
        HEADER.pack(9, 5, 0, 0, 7) + b"four",  # shorter than its header says
        HEADER.pack(9, 0, 0, 0, 7) + GOOD,  # an empty fragment
        HEADER.pack(4, 4, 0, 0, 7) + bytes(4),  # the valid checksum of an empty packet
        HEADER.pack(9, 5, 5, 0, 7) + b"bytes",  # beyond the packet
        HEADER.pack(9, 5, 65_535, 0, 7) + b"bytes",
        HEADER.pack(0, 0, 0, 0, 0),
    ],
)
def test_an_invalid_rest_of_a_frame_is_dropped(rest: bytes) -> None:
    reassembly = Reassembly()
    assert reassembly.take(START, 1, GOOD + rest) == [b"good"]
    assert counted(reassembly) == {"complete": 1, "junk_frames": 1}
    assert open_packets(reassembly) == 0


def test_packet_numbers_wrap_around() -> None:
    fragmenter, reassembly = Fragmenter(7, SMALL), Reassembly(SMALL)
    fragmenter.frames([b"x"] * 65_535)
    frames = fragmenter.frames([PACKET, PACKET.upper()])
    got = [packet for frame in reversed(frames) for packet in reassembly.take(START, 1, frame)]
    assert sorted(got) == sorted([PACKET, PACKET.upper()])


TIGHT = LinkParameters(frame_data=40, max_packet=200, max_open=3)


def take_bounded(reassembly: Reassembly, now: int, sender: int, frame: bytes) -> list[bytes]:
    """Return the completed packets; check that open packets stay within the limits of TIGHT."""
    packets = reassembly.take(Instant(now), sender, frame)
    assert open_packets(reassembly) <= TIGHT.max_open
    assert open_bytes(reassembly) <= TIGHT.max_open * (TIGHT.max_packet + CHECKSUM.size)
    return packets


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
        for packet in take_bounded(reassembly, now, sender, frame):
            assert 0 < len(packet) <= TIGHT.max_packet


@dataclass
class Sender:
    address: int
    packets: list[bytes]
    frames: list[bytes]


@st.composite
def _swarms(draw: st.DrawFn) -> list[Sender]:
    """Return senders with equal packet numbers and a common address or source byte."""
    packets = st.lists(st.binary(min_size=1, max_size=200), min_size=1, max_size=5)
    senders = [Sender(number // 2, draw(packets), []) for number in range(draw(st.integers(1, 4)))]
    for number, sender in enumerate(senders):
        sender.frames = Fragmenter(number % 2, TIGHT).frames(sender.packets)
    return senders


@given(_swarms(), st.data())
@settings(derandomize=True, max_examples=100, deadline=None)
def test_all_frames_in_any_order_give_every_packet_once(swarm: list[Sender], data: st.DataObject) -> None:
    aired = [(sender.address, frame) for sender in swarm for frame in sender.frames]
    got: list[tuple[int, bytes]] = []
    reassembly = Reassembly(LinkParameters(frame_data=40, max_packet=200))
    for address, frame in data.draw(st.permutations(aired)):
        got += [(address, packet) for packet in reassembly.take(START, address, frame)]
    assert sorted(got) == sorted((sender.address, packet) for sender in swarm for packet in sender.packets)
    assert open_packets(reassembly) == 0


@given(_swarms(), st.data())
@settings(derandomize=True, max_examples=200, deadline=None)
def test_only_sent_packets_come_out_of_a_bad_channel(swarm: list[Sender], data: st.DataObject) -> None:
    """Frames are lost, duplicated, reordered and interleaved; one in five is corrupted."""
    aired = [(sender.address, frame) for sender in swarm for frame in sender.frames]
    sent = {(sender.address, packet) for sender in swarm for packet in sender.packets}
    heard = data.draw(st.lists(st.sampled_from(aired), max_size=2 * len(aired)))
    reassembly = Reassembly(TIGHT)
    for now, (address, frame) in enumerate(heard):
        at = data.draw(st.integers(0, 5 * len(frame)))
        broken = bytearray(frame)
        if at < len(frame):
            broken[at] ^= data.draw(st.integers(1, 255))
        assert {(address, packet) for packet in take_bounded(reassembly, now, address, bytes(broken))} <= sent


KNOWLEDGE = KnowledgePacket("r1", Version(2, 300), 1, ((0x01020304, (True, None, "x")),))
WIRE = bytes.fromhex("1095a2723102cd012cce0102030493c3c0a178")
"""Knowledge, relayed once; five items: id, epoch, counter, fingerprint, three fields."""


def test_the_bytes_of_a_packet() -> None:
    assert pack(KNOWLEDGE) == WIRE
    assert unpack(WIRE) == KNOWLEDGE
    deepest = b"\0\x95\xa1r\0\1\1" + b"\x91" * 16 + b"\x90"
    assert unpack(deepest) is not None


@pytest.mark.parametrize(("claims", "size", "frames"), [(0, 39, [52]), (10, 179, [118, 83])])
def test_the_knowledge_of_a_robot_fits_few_frames(claims: int, size: int, frames: list[int]) -> None:
    data, here = published(claims), robot(claims)
    assert len(data) == size
    assert [len(frame) for frame in Fragmenter(12).frames([data])] == frames
    packet = unpack(data)
    assert packet is not None
    assert (packet.component, packet.version, packet.hops) == ("r12", Version(3, 40_000), 0)
    got = REGISTRY.unpack(packet.component, packet.roles)
    assert got is not None
    role = Sweeper(id="r12", position=here.position, mode=here.mode, goal=here.goal, claims=here.claims)
    assert got.roles == (role,)


def test_relaying_changes_the_hops_only() -> None:
    data = published(claims=1)
    seen = []
    for _ in range(17):
        packet = unpack(data)
        assert packet is not None
        seen.append(packet.hops)
        assert packet.roles == REGISTRY.pack(robot(1))
        data = increment_hops(data)
    assert seen == [*range(16), 15]


LONG_ID = "ä" * 17


@pytest.mark.parametrize(
    ("packet", "limits", "sentence"),
    [
        (
            KNOWLEDGE,
            LinkParameters(max_packet=16),
            "the published knowledge of 'r1' has 19 bytes; "
            "at most 16 are allowed (LinkParameters.max_packet)",
        ),
        (
            KnowledgePacket(LONG_ID, Version(0, 1), 0, ()),
            LinkParameters(),
            f"the id '{LONG_ID}' has 34 bytes in UTF-8; at most 32 are allowed (LinkParameters.max_id)",
        ),
    ],
)
def test_packets_beyond_the_limits_are_refused(
    packet: KnowledgePacket, limits: LinkParameters, sentence: str
) -> None:
    longest = KnowledgePacket(LONG_ID[1:], Version(0, 1), 0, ())
    assert unpack(pack(longest)) == longest
    with refused(sentence, ExecutionError):
        pack(packet, limits)


def _body(*items: Any) -> bytes:
    return b"\0" + bytes(msgpack.packb(items))


INVALID = [
    b"",
    b"\0",
    b"\x01" + WIRE[1:],  # another type
    WIRE[:-1],
    WIRE + b"\xc0",
    b"\0\x95\xa1r\0\1\1" + b"\x91" * 17 + b"\x90",  # one array deeper than a role may have
    b"\0" + b"\xdc\xff\xff" * 340,  # arrays that claim to be long
    b"\0\x95\xa1r\0\1\1\x91\x81\xa1k\1",  # a map
    b"\0\x95\xa1r\0\1\1\x91\xd4\1\1",  # an extension
    b"\0\x93\xa1\xff\0\1",  # invalid UTF-8
    *(_body(*items) for items in ((), ("r1", 0), ("r1", -1, 0), (b"r1", 0, 1), ("r" * 33, 0, 1))),
    *(_body("r1", *version) for version in ((0.0, 1), (0, True), (0, -1))),
    *(_body("r1", 0, 1, fingerprint, ()) for fingerprint in (-1, 2**32, True)),
    *(_body("r1", 0, 1, *rest) for rest in ((2,), (7, 7), (7, (0,) * 65))),
    *(_body("r1", 0, 1, 7, (text * 257,)) for text in ("x", b"x")),
    _body("r1", 0, 1, 7, ("x" * 255,) * 4),  # 1039 bytes
]


def test_invalid_packets_are_not_unpacked() -> None:
    assert [data for data in INVALID if unpack(data) is not None] == []


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 255)), max_size=40))
def test_repeated_packets_are_unpacked_as_if_they_came_first(heard: list[tuple[int, int]]) -> None:
    """Copies of six packets, one of them invalid, with any first byte; the cache holds three."""
    bodies = [pack(KnowledgePacket("r1", Version(0, number), 0, ()))[1:] for number in range(5)] + [b"\xa1"]
    unpacker = Unpacker(most=3)
    for number, first in heard:
        data = bytes([first]) + bodies[number]
        assert unpacker.unpack(data) == unpack(data)
    assert unpacker.unpack(b"") is None


def _changed(data: bytes) -> st.SearchStrategy[bytes]:
    places = st.integers(0, len(data) - 1)
    edits: list[st.SearchStrategy[Callable[[bytes], bytes]]] = [
        st.builds(
            lambda at, byte: lambda d: d[:at] + bytes([byte]) + d[at + 1 :], places, st.integers(0, 255)
        ),
        st.builds(lambda at, more: lambda d: d[:at] + more + d[at:], places, st.binary(max_size=4)),
        st.builds(lambda at, n: lambda d: d[:at] + d[at + n :], places, st.integers(1, 9)),
    ]

    def applied(changes: list[Callable[[bytes], bytes]]) -> bytes:
        changed = data
        for change in changes:
            changed = change(changed)
        return changed

    return st.lists(st.one_of(edits), min_size=1, max_size=4).map(applied)


@given(_changed(published(claims=3)) | st.binary(max_size=1100).map(lambda data: b"\0" + data))
@example(b"\0" + b"\x91" * 1023)
@settings(derandomize=True, max_examples=600, deadline=None)
def test_no_bytes_raise(data: bytes) -> None:
    packet = unpack(data)
    if packet is not None:
        assert packet == unpack(data)
        REGISTRY.unpack(packet.component, packet.roles)
