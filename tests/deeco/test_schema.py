"""Roles are encoded as tuples and restored; any other input is rejected."""

from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, field, make_dataclass
from enum import Enum, Flag, IntEnum
from types import GenericAlias
from typing import Annotated, Any, Literal, NamedTuple, NewType, Optional, Union

import msgpack
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco.component import component, role
from deeco.errors import DefinitionError, DeploymentError, ExecutionError
from deeco.knowledge import Knowledge
from deeco.link import LinkParameters
from deeco.schema import Resolution, RoleRegistry, UnpackedRoles
from tests.deeco.refusals import refused
from tests.deeco.sweepers import REGISTRY, Mode, Point, Sweeper, robot

Metres = NewType("Metres", float)


class Level(IntEnum):
    LOW = 10
    HIGH = 20


class Colours(Flag):
    RED = 1
    BLUE = 2


@dataclass(frozen=True)
class Window:
    least: int
    most: int
    width: int = field(init=False)

    def __post_init__(self) -> None:
        if self.least > self.most:
            raise ValueError("least is above most")
        object.__setattr__(self, "width", self.most - self.least)


@dataclass(frozen=True)
class Tree:
    children: tuple["Tree", ...]


class Pair(NamedTuple):
    first: int
    second: str


def fingerprint(kind: type[Knowledge]) -> int:
    return next(iter(RoleRegistry([kind])._by_fingerprint))


def role_of(name: str = "Sample", **annotations: Any) -> type[Knowledge]:
    return role(type(name, (Knowledge,), {"__annotations__": annotations, "__qualname__": name}))


def played(kind: type[Knowledge]) -> type[Knowledge]:
    return component(type("Player", (kind,), {}))


def packed(annotation: Any, value: Any, **limits: Any) -> Any:
    kind = role_of(value=annotation)
    fields: dict[str, Any] = {"value": value}
    ((_, (there,)),) = RoleRegistry([kind], LinkParameters(**limits)).pack(played(kind)(id="c", **fields))
    return there


def unpacked(annotation: Any, there: Any, **limits: Any) -> Any:
    """Return a received value of a field of this type; JUNK if it is rejected."""
    kind = role_of(value=annotation)
    got = RoleRegistry([kind], LinkParameters(**limits)).unpack("c", ((fingerprint(kind), (there,)),))
    return JUNK if got is None else vars(got.roles[0])["value"]


JUNK = object()


@pytest.mark.parametrize(
    ("annotation", "value", "there"),
    [
        (bool, True, True),
        (int, -7, -7),
        (int, 2**64 - 1, 2**64 - 1),
        (float, 0.1, 0.1),
        (float, 3, 3.0),
        (Metres, 2.5, 2.5),
        (str, "däck", "däck"),
        (bytes, b"\0\xff", b"\0\xff"),
        (None, None, None),
        (Mode, Mode.BLOCKED, 2),
        (Level, Level.HIGH, 1),
        (Literal["b", "a"], "a", 0),
        (Literal[1, True, None], True, 1),
        (int | None, None, None),
        (int | None, 4, 4),
        (int | str, 4, (0, 4)),
        (int | str | None, "x", (1, "x")),
        (float | int, 1, (1, 1)),
        (tuple[int, ...] | tuple[str, ...], ("x",), (1, ("x",))),
        (tuple[int, ...], (1, 2, 3), (1, 2, 3)),
        (tuple[int, str], (1, "x"), (1, "x")),
        (Pair, Pair(1, "x"), (1, "x")),
        (Window, Window(2, 5), (2, 5)),
        (Annotated[float, Resolution(100)], -0.25, -25),
        (Annotated[float, Resolution(1)], 3.0, 3),
        (float | int, 1.0, (0, 1.0)),
        (tuple[()], (), ()),
        (Annotated[Point | None, Resolution(1000)], Point(1.2345, 2), (1234, 2000)),
        (tuple[Annotated[Metres, "along", Resolution(10)], float], (1.04, 1.04), (10, 1.04)),
        (Annotated[tuple[float, Annotated[float, Resolution(10)]], Resolution(2)], (1.5, 1.5), (3, 15)),
    ],
)
def test_every_type_is_encoded(annotation: Any, value: Any, there: Any) -> None:
    assert repr(packed(annotation, value)) == repr(there)  # repr, for 1 == 1.0 == True


def test_the_id_is_in_the_packet_and_not_in_the_role() -> None:
    (here,) = RoleRegistry([Sweeper, Sweeper]).pack(robot(0))
    assert here == (fingerprint(Sweeper), ((45123, -12500), 1, ("r13", 3, (34234, -12500), 6), ()))
    got = REGISTRY.unpack("r12", (here,))
    value = robot(0)
    expected = Sweeper(
        id="r12", position=value.position, mode=value.mode, goal=value.goal, claims=value.claims
    )
    assert got == UnpackedRoles((expected,), 0)
    assert type(got.roles[0]) is Sweeper


@pytest.mark.parametrize(
    ("annotation", "value", "sentence"),
    [
        (bool, 1, "1 must be True or False"),
        (int, True, "True must be an int"),
        (int, 2**64, "18446744073709551616 must be an int of up to 64 bits"),
        (float, float("nan"), "nan must be a finite float"),
        (float, "1", "'1' must be a float"),
        (float, True, "True must be a float"),
        (Annotated[float, Resolution(10)], float("inf"), "inf must be a finite float"),
        (
            Annotated[float, Resolution(1000)],
            1e17,
            "1e+17 must be a float of up to 64 bits in steps of 1/1000",
        ),
        (str, b"x", "b'x' must be a str"),
        (str, "\ud800", "'\\ud800' must be a str without lone surrogates"),
        (str, "ä" * 129, "a str has 258 bytes in UTF-8; at most 256 are allowed (LinkParameters.max_text)"),
        (
            bytes,
            b"x" * 257,
            "a bytes value has 257 bytes; at most 256 are allowed (LinkParameters.max_text)",
        ),
        (bytes, "x", "'x' must be bytes"),
        (None, 0, "0 must be None"),
        (Mode, "idle", "'idle' must be a member of Mode"),
        (Colours, Colours.RED | Colours.BLUE, "<Colours.RED|BLUE: 3> must be a member of Colours"),
        (Literal["a", "b"], ["a"], "['a'] must be one of 'a', 'b'"),
        (tuple[int, ...], [1], "[1] must be a tuple"),
        (
            tuple[int, ...],
            (1,) * 65,
            "a tuple has 65 items; at most 64 are allowed (LinkParameters.max_items)",
        ),
        (tuple[int, int], (1,), "(1,) must be a tuple of 2 items"),
        (Pair, (1, "x"), "(1, 'x') must be a Pair"),
        (Window, Pair(1, "x"), "Pair(first=1, second='x') must be a Window"),
        (int | str, 1.5, "1.5 must be one of int|str"),
    ],
)
def test_unencodable_values_are_reported(annotation: Any, value: Any, sentence: str) -> None:
    with refused(f"Sample.value of 'c' cannot be published: {sentence}", ExecutionError):
        packed(annotation, value)


@pytest.mark.parametrize(
    ("annotation", "there"),
    [
        (bool, 1),
        (bool, None),
        (int, 1.0),
        (float, float("inf")),
        (Annotated[float, Resolution(10)], True),
        (bytes, "x"),
        (Mode, True),
        (int | str, 1),
        (int | str, (-1, "x")),
        (tuple[int, ...], 7),
        (tuple[int, str], (1, "x", 1)),
        (Pair, {}),
        (int, True),
        (int, 2**64),
        (float, 1),
        (float, float("nan")),
        (Annotated[float, Resolution(10)], 1.0),
        (Annotated[float, Resolution(10)], 2**200),
        (str, b"x"),
        (str, "ä" * 129),
        (str, "\ud800" * 100),
        (bytes, b"x" * 257),
        (None, 0),
        (Mode, 3),
        (Mode, -1),
        (Literal["a"], "a"),
        (int | None, "x"),
        (int | str, (0, "x")),
        (int | str, (2, 1)),
        (int | str, (False, 1)),
        (int | str, (0, 1, 1)),
        (tuple[int, ...], [1]),
        (tuple[int, ...], (1,) * 65),
        (tuple[int, str], (1,)),
        (Pair, (1,)),
        (Window, (5, 2)),  # its class refuses it
        (Window, (2, 5, 3)),
    ],
)
def test_a_value_of_another_encoding_is_rejected(annotation: Any, there: Any) -> None:
    assert unpacked(annotation, there) is JUNK


def test_limits_are_parameters() -> None:
    assert packed(str, "x" * 300, max_text=300) == "x" * 300
    assert unpacked(tuple[int, ...], (1,) * 100, max_items=100) == (1,) * 100
    assert unpacked(str, "xx", max_text=1) is JUNK


def test_wrong_field_counts_and_repeated_roles_are_rejected() -> None:
    (here,) = REGISTRY.pack(robot(1))
    key, fields = here
    assert REGISTRY.unpack("r12", ((key, fields[:-1]),)) is None
    assert REGISTRY.unpack("r12", ((key, (*fields, 1)),)) is None
    assert REGISTRY.unpack("r12", (here, here)) is None


def test_a_component_publishes_all_its_roles_and_a_peer_reads_those_it_knows() -> None:
    first, second = role_of("First", a=int), role_of("Second", b=str)
    both: type[Knowledge] = component(type("Both", (first, second), {"__annotations__": {"c": float}}))
    fields: dict[str, Any] = {"a": 1, "b": "x", "c": 0.5}
    there = RoleRegistry([first, second]).pack(both(id="r1", **fields))
    assert there == ((fingerprint(first), (1,)), (fingerprint(second), ("x",)))
    got = RoleRegistry([second]).unpack("r1", there)
    assert got is not None
    assert got.unknown == 1
    assert [vars(one) for one in got.roles] == [{"id": "r1", "b": "x"}]


def test_a_fingerprint_changes_with_all_that_nodes_must_agree_on() -> None:
    forms = [
        role_of(a=int, b=int),
        role_of(b=int, a=int),
        role_of("Other", a=int, b=int),
        role_of(a=int),
        role_of(a=float),
        role_of(a=Annotated[float, Resolution(10)]),
        role_of(a=Annotated[float, Resolution(100)]),
        role_of(a=int | None),
        role_of(a=tuple[int, ...]),
        role_of(a=tuple[int]),
        role_of(a=Mode),
        role_of(a=Literal["IDLE", "SWEEPING", "BLOCKED"]),
        role_of(a=Pair),
        role_of(a=Window),
    ]
    assert len({fingerprint(one) for one in forms}) == len(forms)
    assert fingerprint(Sweeper) == 4_135_324_157, "the same in every process"


def test_a_fingerprint_does_not_depend_on_which_order_typing_met_first() -> None:
    one = Optional[Union[int, str]]  # noqa: UP007, UP045  # typing keeps these, and gives back the first
    other = Optional[Union[str, int]]  # noqa: UP007, UP045
    assert (
        fingerprint(role_of(a=one))
        == fingerprint(role_of(a=other))
        == fingerprint(role_of(a=None | str | int))
    )
    assert fingerprint(role_of(a=Literal["a", "b"])) == fingerprint(role_of(a=Literal["b", "a"]))
    assert fingerprint(role_of(a=Metres)) == fingerprint(role_of(a=float))


Unmade = make_dataclass("Unmade", [("a", int)], frozen=True, namespace={"__init__": lambda self, z: None})
Untyped = namedtuple("Untyped", "a b")
OtherMode: Any = Enum("Mode", "IDLE SWEEPING BLOCKED")  # type: ignore[misc]  # the name is the point


Sample, First, Second = role_of(a=int), role_of("First", a=int), role_of("Second", b=int)
Nested: Any = tuple[tuple[tuple[tuple[tuple[int]]]]]


def pack_both() -> object:
    both: type[Knowledge] = component(type("Both", (First, Second), {}))
    fields: dict[str, Any] = {"a": 1, "b": 2}
    return RoleRegistry([First, Second], LinkParameters(max_roles=1)).pack(both(id="c", **fields))


@pytest.mark.parametrize(
    ("fields", "limits", "sentence"),
    [
        ({"a": Tree}, {}, "Tree contains itself; recursive types cannot be encoded"),
        ({"a": Unmade}, {}, "Unmade has parameters z; they must be its fields a"),
        ({"a": Untyped}, {}, "annotate Untyped.a with its type"),
        (
            {"a": Mode | OtherMode},
            {},
            "two alternatives are Mode{IDLE,SWEEPING,BLOCKED}; rename one of them",
        ),
        (
            {"a": Nested},
            {"max_depth": 4},
            "its types are nested 5 levels deep; at most 4 are allowed (LinkParameters.max_depth)",
        ),
        (
            dict.fromkeys((f"a{index}" for index in range(65)), int),
            {},
            "Sample has 65 fields; at most 64 are allowed (LinkParameters.max_items)",
        ),
    ],
)
def test_roles_that_cannot_be_published_are_refused(
    fields: dict[str, Any], limits: dict[str, Any], sentence: str
) -> None:
    with refused(f"role Sample cannot be published: {sentence}", DeploymentError):
        RoleRegistry([role_of("Sample", **fields)], LinkParameters(**limits))


SAME = f"the same fingerprint, {fingerprint(Sample):08x}; rename one of them"
MISTAKES: dict[str, Callable[[], object]] = {
    f"{__name__}.Sample and {__name__}.Sample have {SAME}": lambda: RoleRegistry([Sample, role_of(a=int)]),
    "Robot plays Sweeper, which is not in the role registry": lambda: RoleRegistry([]).pack(robot(0)),
    "Both plays 2 roles; at most 1 are allowed (LinkParameters.max_roles)": pack_both,
    "Player cannot be published: decorate its class with @role": lambda: fingerprint(played(Sweeper)),
    "LinkParameters.frame_data is 9; must be an integer from 10 to 65535": (
        lambda: LinkParameters(frame_data=9)
    ),
    "LinkParameters.max_open is '8'; must be an integer from 1 to 65536": (
        lambda: LinkParameters(max_open="8")  # type: ignore[arg-type]
    ),
}


@pytest.mark.parametrize("sentence", MISTAKES)
def test_invalid_role_registries_and_limits_are_refused(sentence: str) -> None:
    with refused(sentence, DeploymentError):
        MISTAKES[sentence]()


@pytest.mark.parametrize("per_unit", [0, -1, True, 0.001])
def test_a_resolution_is_an_integer(per_unit: Any) -> None:
    with refused(
        f"Resolution({per_unit!r}): per_unit must be a positive integer, such as 1000 for millimetres",
        DefinitionError,
    ):
        Resolution(per_unit)


Typed = tuple[Any, st.SearchStrategy[Any]]


def _leaves() -> st.SearchStrategy[Typed]:
    finite = st.floats(allow_nan=False, allow_infinity=False)
    cases: list[Typed] = [
        (bool, st.booleans()),
        (int, st.integers(-(2**63), 2**64 - 1)),
        (float, finite),
        (Metres, finite),
        (Annotated[float, Resolution(1000)], st.integers(-(10**9), 10**9).map(lambda n: n / 1000)),
        (str, st.text(max_size=64)),
        (bytes, st.binary(max_size=256)),
        (None, st.none()),
        (Mode, st.sampled_from(Mode)),
        (Literal["x", 1, None, Level.LOW], st.sampled_from(["x", 1, None, Level.LOW])),
        (Pair, st.builds(Pair, st.integers(0, 9), st.text(max_size=9))),
        (Window, st.builds(Window, st.integers(0, 9), st.integers(10, 19))),
    ]
    return st.sampled_from(cases)


def _around(inner: st.SearchStrategy[Typed]) -> st.SearchStrategy[Typed]:
    several = st.lists(inner, min_size=1, max_size=3)
    return st.one_of(inner.map(_sequence), several.map(_row), several.map(_union), several.map(_record))


def _sequence(item: Typed) -> Typed:
    return GenericAlias(tuple, (item[0], ...)), st.lists(item[1], max_size=5).map(tuple)


def _row(items: list[Typed]) -> Typed:
    return GenericAlias(tuple, tuple(one for one, _ in items)), st.tuples(*(values for _, values in items))


def _union(items: list[Typed]) -> Typed:
    union: Any = Union
    return union[tuple(one for one, _ in items)], st.one_of(*(values for _, values in items))


def _record(items: list[Typed]) -> Typed:
    cls = make_dataclass("Record", [(f"f{i}", one[0]) for i, one in enumerate(items)], frozen=True)
    return cls, st.builds(cls, *(values for _, values in items))


@given(st.data(), st.lists(st.recursive(_leaves(), _around, max_leaves=6), max_size=4))
@settings(derandomize=True, max_examples=120, deadline=None)
def test_roles_of_any_types_are_restored(data: st.DataObject, items: list[Typed]) -> None:
    kind = role_of(**{f"f{i}": annotation for i, (annotation, _) in enumerate(items)})
    values = {f"f{i}": data.draw(values) for i, (_, values) in enumerate(items)}
    registry = RoleRegistry([kind])
    there = registry.pack(played(kind)(id="c", **values))
    travelled = msgpack.unpackb(msgpack.packb(there), use_list=False)
    got = registry.unpack("c", travelled)
    assert got == UnpackedRoles((kind(id="c", **values),), 0)
    assert repr(got.roles[0]) == repr(kind(id="c", **values))  # types, too: 1 == 1.0 == True


_ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4).map(tuple) | st.lists(inner, max_size=3),
    max_leaves=12,
)


@given(_ANYTHING)
@settings(derandomize=True, max_examples=300)
def test_no_fields_raise(fields: Any) -> None:
    got = REGISTRY.unpack("r12", ((fingerprint(Sweeper), fields),))
    assert got is None or isinstance(got.roles[0], Sweeper)
