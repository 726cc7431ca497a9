"""Roles of any types, with any values: what was packed comes back, and whatever comes raises nothing."""

from dataclasses import make_dataclass
from types import GenericAlias
from typing import Annotated, Any, Literal, Union

import msgpack
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco.replication.schema import Resolution, RoleBook, Unpacked, fingerprint
from tests.deeco.sweepers import BOOK, Mode, Sweeper
from tests.deeco.test_schema import Level, Metres, Pair, Window, played, role_of

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
def test_any_role_of_any_types_comes_back_as_it_was(data: st.DataObject, items: list[Typed]) -> None:
    kind = role_of(**{f"f{i}": annotation for i, (annotation, _) in enumerate(items)})
    values = {f"f{i}": data.draw(values) for i, (_, values) in enumerate(items)}
    book = RoleBook([kind])
    there = book.pack(played(kind)(id="c", **values))
    travelled = msgpack.unpackb(msgpack.packb(there), use_list=False)
    got = book.unpack("c", travelled)
    assert got == Unpacked((kind(id="c", **values),), 0)
    assert repr(got.roles[0]) == repr(kind(id="c", **values))  # types, too: 1 == 1.0 == True


_ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4).map(tuple) | st.lists(inner, max_size=3),
    max_leaves=12,
)


@given(_ANYTHING)
@settings(derandomize=True, max_examples=300)
def test_whatever_fields_come_nothing_raises(fields: Any) -> None:
    got = BOOK.unpack("r12", ((fingerprint(Sweeper), fields),))
    assert got is None or isinstance(got.roles[0], Sweeper)
