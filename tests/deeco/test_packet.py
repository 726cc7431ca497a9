"""L2: the bytes of a packet, its budget, and that no bytes whatever do more than be junk."""

from collections.abc import Callable
from typing import Any

import msgpack
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from deeco.errors import ExecutionError
from deeco.link import LinkParameters
from deeco.replication.fragments import Fragmenter
from deeco.replication.packet import KnowledgePacket, Unpacker, Version, pack, relayed, unpack
from tests.deeco.sweepers import BOOK, Sweeper, published, robot

PACKET = KnowledgePacket("r1", Version(2, 300), 1, ((0x01020304, (True, None, "x")),))
WIRE = bytes.fromhex("1095a2723102cd012cce0102030493c3c0a178")
"""Relayed once, knowledge; five items: id, epoch, counter, fingerprint, three fields."""


def test_the_bytes_of_a_packet() -> None:
    assert pack(PACKET) == WIRE
    assert unpack(WIRE) == PACKET


@pytest.mark.parametrize(("claims", "size", "frames"), [(0, 39, [52]), (10, 179, [118, 83])])
def test_a_robot_s_knowledge_fits_few_frames(claims: int, size: int, frames: list[int]) -> None:
    data = published(claims)
    assert len(data) == size
    assert [len(frame) for frame in Fragmenter(12).frames([data])] == frames


def test_what_is_published_comes_back() -> None:
    packet = unpack(published(claims=10))
    assert packet is not None
    assert (packet.component, packet.version, packet.hops) == ("r12", Version(3, 40_000), 0)
    got = BOOK.unpack(packet.component, packet.roles)
    assert got is not None
    here = robot(10)
    assert got.roles == (
        Sweeper(id="r12", position=here.position, mode=here.mode, goal=here.goal, claims=here.claims),
    )


def test_relaying_changes_the_hops_only() -> None:
    data = published(claims=1)
    seen = []
    for _ in range(17):
        packet = unpack(data)
        assert packet is not None
        seen.append(packet.hops)
        assert packet.roles == BOOK.pack(robot(1))
        data = relayed(data)
    assert seen == [*range(16), 15]


def test_too_much_knowledge_is_refused() -> None:
    with pytest.raises(ExecutionError) as error:
        pack(PACKET, LinkParameters(most_packet=16))
    assert str(error.value) == (
        "the published knowledge of 'r1' has 19 bytes; at most 16 go on the air (LinkParameters.most_packet)"
    )


def test_a_long_id_is_refused() -> None:
    longest = KnowledgePacket("ä" * 16, Version(0, 1), 0, ())
    assert unpack(pack(longest)) == longest
    with pytest.raises(ExecutionError) as error:
        pack(KnowledgePacket("ä" * 17, Version(0, 1), 0, ()))
    assert str(error.value) == (
        "the id 'äääääääääääääääää' has 34 bytes in UTF-8; at most 32 go on the air (LinkParameters.most_id)"
    )


def _body(*items: Any) -> bytes:
    return b"\0" + bytes(msgpack.packb(items))


@pytest.mark.parametrize(
    "data",
    [
        b"\0",
        b"\x01" + WIRE[1:],  # of another type
        WIRE[:-1],
        WIRE + b"\xc0",
        b"\0" + b"\x91" * 600 + b"\xc0",  # deep, yet msgpack takes it
        b"\0\x95\xa1r\0\1\1" + b"\x91" * 17 + b"\x90",  # one array deeper than a role may have
        b"\0" + b"\xdc\xff\xff" * 340,  # arrays that claim to be long
        b"\0\x95\xa1r\0\1\1\x91\x81\xa1k\1",  # a map
        b"\0\x95\xa1r\0\1\1\x91\xd4\1\1",  # an extension
        b"\0\x93\xa1\xff\0\1",  # no UTF-8
        b"",
        _body(),
        _body("r1", 0),
        _body("r1", 0.0, 1),
        _body("r1", 0, True),
        _body("r1", 0, -1),
        _body("r1", 0, 1, 2),
        _body("r1", 0, 1, 7, (b"x" * 257,)),
        _body("r1", 0, 1, -1, ()),
        _body("r1", 0, 1, 2**32, ()),
        _body("r1", 0, 1, True, ()),
        _body("r1", 0, 1, 7, 7),
        _body("r1", -1, 0),
        _body(b"r1", 0, 1),
        _body("r" * 33, 0, 1),
        _body("r1", 0, 1, 7, (0,) * 65),
        _body("r1", 0, 1, 7, ("x" * 257,)),
        _body("r1", 0, 1, 7, ("x" * 255,) * 4),  # 1039 bytes
    ],
)
def test_what_is_no_packet_is_none(data: bytes) -> None:
    assert unpack(data) is None


def test_the_deepest_role_is_taken() -> None:
    assert unpack(b"\0\x95\xa1r\0\1\1" + b"\x91" * 16 + b"\x90") is not None


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 255)), max_size=40))
def test_what_comes_again_is_unpacked_as_if_it_came_first(heard: list[tuple[int, int]]) -> None:
    """Copies of six packets, one of them junk, with any first byte, where only three are kept."""
    bodies = [pack(KnowledgePacket("r1", Version(0, number), 0, ()))[1:] for number in range(5)] + [b"\xa1"]
    unpacker = Unpacker(most=3)
    for number, first in heard:
        data = bytes([first]) + bodies[number]
        assert unpacker.unpack(data) == unpack(data)
    assert unpacker.unpack(b"") is None


def read(data: bytes) -> None:
    """All that a node does with a packet."""
    packet = unpack(data)
    if packet is not None:
        assert packet == unpack(data)
        assert repr(packet)
        BOOK.unpack(packet.component, packet.roles)


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
    read(data)
