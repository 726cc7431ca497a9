"""Histories of role fields: one value per publication, bounded in number and age, on every node."""

from dataclasses import replace
from typing import Annotated, Self

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco import (
    DefinitionError,
    Duration,
    History,
    Instant,
    Knowledge,
    Past,
    component,
    ensemble,
    on_change,
    periodic,
    role,
    seconds,
)
from deeco.explain.description import component_text
from deeco.history import histories
from deeco.link import Reception
from deeco.local import Commit
from deeco.node import Node
from deeco.schema import RoleRegistry
from tests.deeco.refusals import refused


@role
class Room(Knowledge):
    celsius: float = 20.0
    recent: Annotated[Past[float], History("celsius", 3)] = ()

    def is_rising(self) -> bool:
        values = [value for _, value in self.recent]
        return len(values) == 3 and values == sorted(set(values))


@component
class Hall(Room):
    alarms: int = 0

    @periodic(every=seconds(0.5))
    def measure(self, now: Instant) -> Self:
        return replace(self, celsius=20.0 + now / seconds(1))

    @on_change(Room.is_rising)
    def warn(self) -> Self:
        return replace(self, alarms=self.alarms + 1)


@role
class Cooling(Knowledge):
    level: int = 0


@component
class Fan(Cooling):
    seen: Past[float] = ()


@ensemble(every=seconds(1), on_change=Room.is_rising)
class Ventilation:
    def membership(self, coordinator: Room, member: Cooling) -> bool:
        return coordinator.is_rising()

    def at_member(self, coordinator: Room, member: Fan) -> Fan:
        return replace(member, seen=coordinator.recent)


def past(*values: tuple[float, float]) -> Past[float]:
    return tuple((Instant(seconds(second)), value) for second, value in values)


def test_the_own_node_adds_a_value_at_each_publication() -> None:
    commits: list[Commit] = []
    node = Node([Hall(id="hall")], publish_phase=seconds(0.25), on_commit=commits.append)
    node.advance(Instant(seconds(5)))
    hall = node.knowledge("hall")
    assert isinstance(hall, Hall)
    assert hall.recent == past((2.25, 22.0), (3.25, 23.0), (4.25, 24.0))
    assert hall.alarms == 1, "a history triggers processes"
    assert [one.by for one in commits if one.instant == 2_250_000] == ["Hall.history", "Hall.warn"]


def test_peers_add_a_value_at_each_reception_and_use_it_in_ensembles() -> None:
    hall, fan = Node([Hall(id="hall")], address=1), Node([Fan(id="fan")], [Ventilation()], address=2)
    sent = hall.advance(Instant(seconds(6)))
    fan.advance(Instant(seconds(0.1)))
    for number, frame in enumerate(sent):
        if number != 3:  # lost
            instant = Instant(frame.instant + 70_000)
            fan.advance(Instant(instant + 1000), [Reception(instant, 1, frame.data)])
    (replica,) = fan.replicas
    expected = past((2.07, 22.0), (4.07, 24.0), (5.07, 25.0))
    assert replica.role(Room).recent == expected
    assert fan.knowledge("fan") == Fan(id="fan", seen=expected)


def test_peers_of_one_node_share_the_history() -> None:
    node = Node([Hall(id="hall"), Fan(id="fan")], [Ventilation()])
    node.advance(Instant(seconds(3.5)))
    assert node.knowledge("fan") == Fan(id="fan", seen=past((0, 20.0), (1, 21.0), (2, 22.0)))


def test_a_history_is_not_sent_and_does_not_change_the_encoding() -> None:
    @role
    class Plain(Knowledge):
        celsius: float = 20.0

    plain = Plain
    plain.__qualname__ = Room.__qualname__
    with_history, without = RoleRegistry([Room]), RoleRegistry([plain])
    value = Hall(id="hall", recent=((Instant(1), 2.0),))
    packed = with_history.pack(value)
    assert list(with_history._by_fingerprint) == list(without._by_fingerprint)
    assert packed[0][1] == (20.0,)
    unpacked = with_history.unpack("hall", packed)
    assert unpacked is not None and unpacked.roles == (Room(id="hall"),)


@settings(max_examples=200)
@given(
    st.integers(1, 6),
    st.none() | st.integers(1000, 9000),
    st.lists(st.tuples(st.integers(0, 5000), st.integers(0, 3)), max_size=20),
)
def test_a_history_has_the_newest_values_within_both_limits(
    size: int, age: int | None, added: list[tuple[int, int]]
) -> None:
    history = History("x", size, None if age is None else Duration(age))
    collected: Past[object] = ()
    now, everything = 0, []
    for pause, value in added:
        now += pause
        everything.append((now, value))
        collected = history.extended(collected, Instant(now), value)
        assert collected == tuple(one for one in everything[-size:] if age is None or now - one[0] <= age)
        assert collected[-1] == (now, value)


def room(annotation: str) -> None:
    fields = f"celsius: Annotated[float, 1] = 20.0\n    past: {annotation} = ()"
    exec(f"@role\nclass Shed(Knowledge):\n    {fields}", globals())


@pytest.mark.parametrize(
    ("annotation", "sentence"),
    [
        (
            "Annotated[Past[float], History('celsus', 3)]",
            "Shed.past: History('celsus') needs another field of Shed; use one of id, celsius",
        ),
        (
            "Annotated[Past[float], History('past', 3)]",
            "Shed.past: History('past') needs another field of Shed; use one of id, celsius",
        ),
        (
            "Annotated[Past[int], History('celsius', 3)]",
            "Shed.past: History('celsius') collects values of type float; annotate it with Past[float]",
        ),
        (
            "Annotated[Past[float], History('celsius', 0)]",
            "History('celsius'): size is 0; must be an integer from 1 to 1000",
        ),
        (
            "Annotated[Past[float], History('celsius', 3, 60)]",
            "History('celsius'): max_age=60 is 60 µs; use at least 1000 µs. seconds(1) is one second",
        ),
    ],
)
def test_invalid_histories_are_refused(annotation: str, sentence: str) -> None:
    with refused(sentence, DefinitionError):
        room(annotation)


def test_a_component_can_collect_local_fields_and_is_described() -> None:
    @component
    class Cellar(Room):
        water: int = 0
        levels: Annotated[Past[int], History("water", 5, seconds(60))] = ()

    assert list(histories(Cellar)) == ["recent", "levels"] and list(histories(Room)) == ["recent"]
    assert [" ".join(line.split()) for line in component_text(Cellar, ())][:5] == [
        "Cellar, a component",
        "publishes as Room: id: str, celsius: float",
        "keeps local water: int",
        "collects recent: the last 3 values of celsius",
        "collects levels: the last 5 values of water, at most 60 s old",
    ]
    node = Node([Cellar(id="c")])
    node.advance(Instant(seconds(1.5)))
    assert node.knowledge("c") == Cellar(
        id="c",
        recent=past((0, 20.0), (1, 20.0)),
        levels=((Instant(0), 0), (Instant(1_000_000), 0)),
    )
