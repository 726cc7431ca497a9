"""Wire format: equal messages give equal bytes, and errors name invalid fields."""

import math
import platform
import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.items import ItemGivenUp, ItemKey, plain_items
from actors.messages import (
    DRIVE,
    MESSAGE_VERSION,
    RECEIVED,
    SENSES,
    TRUTH,
    Drive,
    FrameReceived,
    FrameSent,
    Jam,
    Odometry,
    RadioEvents,
    RobotTruth,
    SensorData,
    Truth,
)
from actors.runtime import typed_json
from actors.runtime.codec import WireError, decode, encode
from actors.runtime.processor import (
    Processor,
    _model_in,
    combine_fingerprints,
    difference_cause,
    differing_kernels,
    fingerprints,
    parse_fingerprints,
    processor,
)
from actors.runtime.replay_bus import first_difference
from actors.topic import Message, Topic
from cleaning.place import VisitReport

REALS = st.floats(-1e5, 1e5)
COUNTS = st.integers(min_value=0, max_value=2**40)
REPORTS = st.builds(VisitReport, st.text(max_size=5), COUNTS, COUNTS)
GIVEN_UP = st.builds(ItemGivenUp, st.text(max_size=5), COUNTS, COUNTS, st.text(max_size=9))
KEYS = st.builds(ItemKey, st.text(max_size=5), COUNTS)
DRIVES = st.builds(
    Drive,
    COUNTS,
    REALS,
    REALS,
    REALS,
    st.integers(0, 32),
    st.lists(REPORTS, max_size=3).map(tuple),
    st.lists(GIVEN_UP, max_size=3).map(tuple),
    st.none() | st.lists(KEYS, max_size=3).map(tuple),
    st.none() | st.tuples(REALS, REALS, REALS),
)
HEARD = st.builds(FrameReceived, COUNTS, COUNTS, REALS, COUNTS, st.binary(max_size=118))
RECEIVEDS = st.builds(
    RadioEvents, COUNTS, st.lists(HEARD | st.builds(FrameSent, COUNTS, COUNTS), max_size=4).map(tuple)
)


def packed(*values: object) -> bytes:
    """Return a version byte and a msgpack array."""
    return bytes([MESSAGE_VERSION]) + msgspec.msgpack.encode(values)


@given(DRIVES)
def test_a_drive_survives_the_wire(message: Drive) -> None:
    plain = msgspec.structs.replace(message, reports=plain_items(message.reports))
    assert decode(DRIVE, "k", encode(message)) == plain  # type: ignore[arg-type]


@given(RECEIVEDS)
def test_a_union_of_events_survives_the_wire(message: RadioEvents) -> None:
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
        (DRIVE, b"", f"swarm/k: no bytes, expected message version {MESSAGE_VERSION}"),
        (DRIVE, b"\x4d", f"swarm/k: version 77, expected message version {MESSAGE_VERSION}"),
        (DRIVE, packed(3, 0.1, "x", 0.2, 0), "swarm/k: Drive.vy is 'x', but must be a number"),
        (
            DRIVE,
            packed(3, 0.1, 0.0, 0.2, 0, [], [["r1", 2.5, 4, "x"]]),
            "swarm/k: Drive.given_up[0].number is 2.5, but must be a whole number",
        ),
        (DRIVE, packed(3), "swarm/k: Drive is [3], but must be a list of at least length 5"),
        (
            RECEIVED,
            packed(3, [["shout", 1, 2]]),
            "swarm/k: RadioEvents.events[0][0] = 'shout': invalid value 'shout'",
        ),
        (DRIVE, bytes([MESSAGE_VERSION, 0xC1]), "swarm/k: 2 bytes of invalid msgpack: MessagePack data is "
         "malformed: invalid opcode '\\xc1' (byte 0)"),
        (DRIVE, packed(3, 0.1, 0.0, 0.2, 0, [["r1", 2, 4]]).replace(b"r1", b"\xde1"), "swarm/k: 38 bytes of "
         "invalid msgpack: 'utf-8' codec can't decode byte 0xde in position 0: invalid continuation byte"),
    ],
)  # fmt: skip
def test_the_error_names_key_field_and_value(topic: Topic[Message], payload: bytes, sentence: str) -> None:
    with pytest.raises(WireError) as caught:
        decode(topic, "swarm/k", payload)
    assert str(caught.value) == sentence


TRUTH_OF_R1 = RobotTruth("r1", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, True, True, 0)
DRIVE_OF_R1 = Drive(7, 0.1, 0.0, 0.0, 0)
STILL = Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
JAM = Jam(0.0, 0.0, 1.0, 0)


@pytest.mark.parametrize("wild", [float("nan"), float("inf"), -1e200])
@pytest.mark.parametrize(
    ("part", "fields", "topic", "message"),
    [
        (STILL, "x y heading vx vy omega", SENSES, lambda part: SensorData(0, 0, 0, part, 0)),
        (DRIVE_OF_R1, "vx vy omega", DRIVE, lambda part: part),
        (TRUTH_OF_R1, "x y heading vx vy omega", TRUTH, lambda part: Truth(0, 0, (part,))),
        (JAM, "x y radius", TRUTH, lambda part: Truth(0, 0, (), (part,))),
    ],
    ids=["odometry", "drive", "truth", "jam"],
)
def test_impossible_numbers_are_refused(
    part: msgspec.Struct, fields: str, topic: Topic[Message], message: Callable[[Any], Message], wild: float
) -> None:
    for field in fields.split():
        payload = encode(message(msgspec.structs.replace(part, **{field: wild})))
        with pytest.raises(WireError, match=re.escape(f" is {wild}, but must be a number ")):
            decode(topic, "k", payload)
    assert decode(topic, "k", encode(message(part))) == message(part)


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (DRIVE, Drive(7, 0.0, 0.0, 0.0, 33)),
        (DRIVE, Drive(7, 0.0, 0.0, 0.0, -1)),
        (DRIVE, Drive(7, 0.0, 0.0, 0.0, 0, pose=(1.0, 1.0, math.inf))),
        (TRUTH, Truth(0, 0, (), (msgspec.structs.replace(JAM, radius=0.0),))),
        (TRUTH, Truth(0, 0, (), (msgspec.structs.replace(JAM, until=10**16),))),
    ],
)
def test_values_beyond_their_limit_are_refused(topic: Topic[Message], message: Message) -> None:
    with pytest.raises(WireError, match=r"^k: \w+\.\S+ is .*, but must be a (whole )?number (of at|above)"):
        decode(topic, "k", encode(message))


class Part(msgspec.Struct, forbid_unknown_fields=True):
    x: int
    share: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 1.0
    name: Annotated[str, msgspec.Meta(min_length=1)] = "a"
    kind: Literal["a", "b"] = "a"
    counts: dict[str, int] = {}
    maybe: int | None = None


class Whole(msgspec.Struct):
    part: Part
    many: tuple[Part, ...] = ()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{}", "part is missing"),
        ('{"part": {"x": "q"}}', 'part.x is "q", but must be a whole number'),
        ('{"part": {"x": 1, "share": 0}}', "part.share is 0, but must be a number above 0"),
        ('{"part": {"x": 1, "share": 2}}', "part.share is 2, but must be a number of at most 1"),
        ('{"part": {"x": 1, "name": ""}}', 'part.name is "", but must be a string of at least length 1'),
        ('{"part": {"x": 1, "kind": "z"}}', 'part.kind is "z", which is not valid here'),
        ('{"part": {"x": 1, "counts": {"q": 0.5}}}', "part.counts[…] is wrong, but must be a whole number"),
        ('{"part": {"x": 1, "maybe": "u"}}', 'part.maybe is "u", but must be a whole number or null'),
        ('{"part": {"x": 1, "y": 1}}', "unknown key part.y; remove it"),
        ('{"part": {"x": 1}, "many": [{"x": 1}, 7]}', "many[1] is 7, but must be an object"),
        ('{"part": {"x": [1}', "part.x is wrong, but must be a whole number"),
        ("[1]", "it is [1], but must be an object"),
        ("{", "Input data was truncated"),
        (b'{"part": {"x": "\xff"}}', "part.x is wrong, but must be a whole number"),
        (b'{"part": {"x": 1, "name": "\xff"}}', "byte 0 is not UTF-8"),
        ('{"y": ' + "[" * 3000 + "]" * 3000 + "}", "it is nested too deeply"),
    ],
)  # fmt: skip
def test_decoding_error_is_one_sentence(text: str | bytes, sentence: str) -> None:
    with pytest.raises(ValueError) as caught:
        typed_json.decode(text, Whole)
    assert str(caught.value) == sentence


A, B, C = (FrameReceived(instant, 2, -80.0, 100, b"x") for instant in (1, 2, 3))


@pytest.mark.parametrize(
    ("one", "other", "field", "values"),
    [
        ((A, B), (A, C), "RadioEvents.events[1].instant", (2, 3)),
        ((A,), (A, B), "RadioEvents.events[1]", ("absent", repr(B))),
        ((A, B, C), (A, C), "RadioEvents.events[1]", (repr(B), repr(C))),
        ((), (A,), "RadioEvents.events[0]", ("absent", repr(A))),
        ((A,), (FrameSent(1, 2),), "RadioEvents.events[0]", (repr(A), repr(FrameSent(1, 2)))),
    ],
)
def test_missing_element_is_absent(
    one: tuple[FrameReceived, ...],
    other: tuple[FrameReceived | FrameSent, ...],
    field: str,
    values: tuple[object, object],
) -> None:
    found = first_difference(RadioEvents(5, one), RadioEvents(5, other))
    assert found is not None
    assert (found.field, *map(repr, found[1:])) == (
        field,
        *(v if isinstance(v, str) else repr(v) for v in values),
    )


def test_equal_messages_do_not_differ() -> None:
    assert first_difference(RadioEvents(5, (A, B)), RadioEvents(5, (A, B))) is None


EPYC = Processor("x86_64", "AMD EPYC", ("avx2", "fma3"))
CORTEX = Processor("aarch64", "Cortex-A76", ("neon",))


class Kernels:
    def __init__(self, name: str, given: bytes | dict[str, bytes]) -> None:
        self.__name__, self.given = name, given

    def fingerprint(self) -> bytes | dict[str, bytes]:
        return self.given


def test_this_processor_has_a_name_and_features() -> None:
    assert np.__version__  # its features are meant
    here = processor()
    assert here.architecture == platform.machine() and here.features
    assert str(here).startswith(f"{here.architecture} ") and ", ".join(here.features) in str(here)
    assert msgspec.json.decode(msgspec.json.encode(here), type=Processor) == here


@pytest.mark.parametrize(
    ("lines", "model"),
    [
        (["processor : 0", "model name\t: AMD EPYC", "model name\t: another"], "AMD EPYC"),
        (["Hardware : BCM2835", "Model : Raspberry Pi 4 Model B"], "Raspberry Pi 4 Model B"),
        (["CPU implementer\t: 0x41", "CPU part\t: 0xd08"], "implementer 0x41, part 0xd08"),
        (["flags : x"], ""),
    ],
)
def test_processor_model_from_cpuinfo(lines: list[str], model: str) -> None:
    assert _model_in(lines) == model


def test_a_module_may_give_its_fingerprint_by_function() -> None:
    prints = fingerprints([Kernels("a.b", b"1"), Kernels("a.c", {"sin": b"1", "cos": b"2"})])
    assert list(prints) == ["a.b", "a.c.sin", "a.c.cos"]
    assert prints["a.b"] == prints["a.c.sin"] != prints["a.c.cos"]
    assert combine_fingerprints(prints) == combine_fingerprints(dict(reversed(prints.items())))
    assert parse_fingerprints(combine_fingerprints(prints)) == {
        name: value[:16] for name, value in prints.items()
    }


def test_differing_kernels_are_found() -> None:
    assert differing_kernels({"a": "1", "b": "2", "c": "3"}, {"b": "2", "c": "4", "d": "5"}) == ["c"]


@pytest.mark.parametrize(
    ("there", "names", "sentence"),
    [
        (EPYC, [], ""),
        (Processor(""), [], ""),
        (
            CORTEX,
            ["a.sin"],
            "recorded on another processor: results of a.sin differ; it was aarch64 (Cortex-A76) with "
            "neon, this is x86_64 (AMD EPYC) with avx2, fma3",
        ),
        (
            CORTEX,
            list("abcde"),
            "recorded on another processor: results of a, b, c and 2 more differ; it was aarch64 "
            "(Cortex-A76) with neon, this is x86_64 (AMD EPYC) with avx2, fma3",
        ),
        (EPYC, ["a.sin"], "recorded with another version of this software: results of a.sin differ"),
        (
            CORTEX,
            [],
            "recorded on another processor, aarch64 (Cortex-A76) with neon; "
            "this is x86_64 (AMD EPYC) with avx2, fma3, with equal results of all kernels",
        ),
    ],
)
def test_cause_of_different_results(there: Processor, names: list[str], sentence: str) -> None:
    assert difference_cause(there, EPYC, names) == sentence
