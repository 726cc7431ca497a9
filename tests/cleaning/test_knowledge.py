"""Knowledge in frames: short, true to the bit, and unimpressed by whatever else the air holds."""

import struct

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.geometry import Point
from cleaning.knowledge import FRAME_LIMIT, Knowledge, WorkState, pack, unpack

coordinates = st.floats(allow_nan=False, allow_infinity=False)
points = st.builds(Point, coordinates, coordinates)
knowledge = st.builds(
    Knowledge,
    id=st.text("abcXYZ019-_", min_size=1, max_size=32),
    position=points,
    destination=st.none() | points,
    state=st.sampled_from(WorkState),
)


@given(knowledge)
def test_what_is_packed_is_short_and_unpacks_to_itself(sent: Knowledge) -> None:
    data = pack(sent)
    assert len(data) <= FRAME_LIMIT
    received = unpack(data)
    assert received == sent
    assert received is not None and isinstance(received.position, Point)


@given(st.binary(max_size=127))
def test_bytes_from_the_air_never_raise(data: bytes) -> None:
    unpack(data)


@given(knowledge, st.integers(0, 99), st.integers(0, 255))
def test_a_changed_byte_never_raises(sent: Knowledge, place: int, value: int) -> None:
    data = bytearray(pack(sent))
    data[place % len(data)] = value
    unpack(bytes(data))


GOOD = ["r1", [1.0, 2.0], None, "idle"]


@pytest.mark.parametrize(
    "fields",
    [
        GOOD[:3],
        [*GOOD, 1],
        ["", [1.0, 2.0], None, "idle"],
        ["r" * 33, [1.0, 2.0], None, "idle"],
        [7, [1.0, 2.0], None, "idle"],
        ["r1", [1.0], None, "idle"],
        ["r1", [1.0, float("nan")], None, "idle"],
        ["r1", [1.0, 2.0], [1.0, float("inf")], "idle"],
        ["r1", [1.0, 2.0], None, "asleep"],
        {"id": "r1"},
        "r1",
    ],
)
def test_what_is_no_knowledge_is_junk(fields: object) -> None:
    assert unpack(msgspec.msgpack.encode(GOOD)) is not None
    assert unpack(msgspec.msgpack.encode(fields)) is None


def test_deeply_nested_long_and_badly_encoded_bytes_are_junk() -> None:
    assert unpack(b"\x91" * 100) is None
    assert unpack(b"\xdd\xff\xff\xff\xff") is None
    assert unpack(b"\x94\xa2\xff\xfe" + struct.pack(">B", 0xC0) * 3) is None
    assert unpack(pack(Knowledge("r1", Point(0, 0), None, WorkState.IDLE)) + bytes(100)) is None
