"""The wire format: equal messages give equal bytes, and whatever does not fit is named."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.messages import DRIVE, MESSAGE_VERSION, RECEIVED, Drive, Heard, Received, Sent
from actors.runtime.codec import WireError, decode, encode
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport
from actors.topic import Message, Topic

REALS = st.floats(allow_nan=False, allow_infinity=False)
COUNTS = st.integers(min_value=0, max_value=2**40)
REPORTS = st.builds(PlaceReport, st.text(max_size=5), COUNTS, COUNTS)
GIVEN_UP = st.builds(PlaceGivenUp, st.text(max_size=5), COUNTS, COUNTS, st.text(max_size=9))
KEYS = st.builds(PlaceKey, st.text(max_size=5), COUNTS)
DRIVES = st.builds(
    Drive,
    COUNTS,
    REALS,
    REALS,
    REALS,
    COUNTS,
    st.lists(REPORTS, max_size=3).map(tuple),
    st.lists(GIVEN_UP, max_size=3).map(tuple),
    st.none() | st.lists(KEYS, max_size=3).map(tuple),
    st.none() | st.tuples(REALS, REALS, REALS),
)
HEARD = st.builds(Heard, COUNTS, COUNTS, REALS, COUNTS, st.binary(max_size=118))
RECEIVEDS = st.builds(
    Received, COUNTS, st.lists(HEARD | st.builds(Sent, COUNTS, COUNTS), max_size=4).map(tuple)
)


def packed(*values: object) -> bytes:
    """Version byte and a msgpack array."""
    return bytes([MESSAGE_VERSION]) + msgspec.msgpack.encode(values)


@given(DRIVES)
def test_a_drive_survives_the_wire(message: Drive) -> None:
    assert decode(DRIVE, "k", encode(message)) == message  # type: ignore[arg-type]


@given(RECEIVEDS)
def test_a_union_of_events_survives_the_wire(message: Received) -> None:
    assert decode(RECEIVED, "k", encode(message)) == message  # type: ignore[arg-type]


@given(st.binary(max_size=64))
def test_any_bytes_decode_or_are_a_wire_error(payload: bytes) -> None:
    try:
        message = decode(DRIVE, "swarm/up/r1/drive", payload)  # type: ignore[arg-type]
    except WireError as error:
        assert str(error).startswith("swarm/up/r1/drive: ")
    else:
        assert isinstance(message, Drive)


@pytest.mark.parametrize(
    ("topic", "payload", "sentence"),
    [
        (DRIVE, b"", f"swarm/k: no bytes where message version {MESSAGE_VERSION} was due"),
        (DRIVE, b"\x4d", f"swarm/k: version 77 where message version {MESSAGE_VERSION} was due"),
        (DRIVE, packed(3, 0.1, "x", 0.2, 0), "swarm/k: Drive.vy is 'x', but must be a number"),
        (
            DRIVE,
            packed(3, 0.1, 0.0, 0.2, 0, [["r1", 2.5, 4]]),
            "swarm/k: Drive.reports[0][1] is 2.5, but must be a whole number",
        ),
        (DRIVE, packed(3), "swarm/k: Drive is [3], but must be a list of at least length 5"),
        (
            RECEIVED,
            packed(3, [["shout", 1, 2]]),
            "swarm/k: Received.events[0][0] = 'shout': invalid value 'shout'",
        ),
        (DRIVE, bytes([MESSAGE_VERSION, 0xC1]), "swarm/k: not msgpack after 2 bytes: MessagePack data is "
         "malformed: invalid opcode '\\xc1' (byte 0)"),
        (DRIVE, packed(3, 0.1, 0.0, 0.2, 0, [["r1", 2, 4]]).replace(b"r1", b"\xde1"), "swarm/k: not msgpack "
         "after 38 bytes: 'utf-8' codec can't decode byte 0xde in position 0: invalid continuation byte"),
    ],
)  # fmt: skip
def test_the_error_names_key_field_and_value(topic: Topic[Message], payload: bytes, sentence: str) -> None:
    with pytest.raises(WireError) as caught:
        decode(topic, "swarm/k", payload)
    assert str(caught.value) == sentence
