"""Processes of one node: when they run, what they get, and what ends the run."""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol, Self

import pytest

from deeco import (
    DeploymentError,
    ExecutionError,
    Instant,
    Knowledge,
    component,
    milliseconds,
    on_change,
    periodic,
    role,
    seconds,
)
from deeco.node import Node


class Log(Protocol):
    def add(self, line: str) -> None: ...


class Lines:
    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, line: str) -> None:
        self.lines.append(line)


@role
class Thermometer(Knowledge):
    temperature: int = 0

    def is_warm(self) -> bool:
        return self.temperature >= 2


@component
class Sensor(Thermometer):
    alarms: int = 0

    @periodic(every=seconds(1))
    def measure(self, log: Log, now: Instant) -> Self:
        log.add(f"{now // 1000} measure {self.temperature}")
        return replace(self, temperature=self.temperature + 1)

    @periodic(every=seconds(2), offset=milliseconds(500))
    def look(self, log: Log) -> Self:
        log.add(f"look {self.temperature}")
        return self

    @on_change(Thermometer.is_warm)
    def alarm(self, log: Log) -> Self:
        log.add(f"alarm {self.temperature}")
        return replace(self, alarms=self.alarms + 1)


def run(kind: type[Knowledge] | Knowledge, until: float = 0.1, **ports: object) -> Node:
    value = kind if isinstance(kind, Knowledge) else kind(id="a")
    node = Node([value], ports={Log: Lines()})
    node.advance(Instant(seconds(until)))
    return node


def test_processes_run_at_their_own_instants_and_on_changes() -> None:
    log = Lines()
    node = Node([Sensor(id="s")], ports={Log: log})
    node.advance(Instant(seconds(3)))
    assert log.lines == [
        "0 measure 0", "look 1", "1000 measure 1", "alarm 2", "2000 measure 2", "look 3",
    ]  # fmt: skip
    assert node.knowledge("s") == Sensor(id="s", temperature=3, alarms=1)


def test_a_fact_triggers_on_change_and_not_on_every_commit() -> None:
    node = Node([Sensor(id="s")], ports={Log: Lines()})
    node.advance(Instant(seconds(10)))
    assert node.knowledge("s") == Sensor(id="s", temperature=10, alarms=1)


@component
class Ordered(Thermometer):
    seen: str = ""

    @periodic(every=seconds(1), order=1)
    def later(self) -> Self:
        return replace(self, seen=self.seen + "b")

    @periodic(every=seconds(1))
    def sooner(self) -> Self:
        return replace(self, seen=self.seen + "a")


@component
class Overriding(Ordered):
    def sooner(self) -> Self:
        return replace(self, seen=self.seen + "A")

    @periodic(every=seconds(1))
    def further(self) -> Self:
        return replace(self, seen=self.seen + "c")


def test_order_and_overriding() -> None:
    assert run(Ordered).knowledge("a") == Ordered(id="a", seen="ab")
    assert run(Overriding).knowledge("a") == Overriding(id="a", seen="Acb")


@component
class Circle(Thermometer):
    left: bool = False
    right: bool = False

    def is_left(self) -> bool:
        return self.left

    def is_right(self) -> bool:
        return self.right

    @periodic(every=seconds(1))
    def begin(self) -> Self:
        return replace(self, left=not self.left)

    @on_change(is_left)
    def follow(self) -> Self:
        return replace(self, right=not self.right)

    @on_change(is_right)
    def answer(self) -> Self:
        return replace(self, left=not self.left)


def test_a_circle_of_triggers_is_named() -> None:
    with pytest.raises(ExecutionError) as caught:
        run(Circle)
    assert str(caught.value) == (
        "at 0 s processes keep triggering each other: Circle.answer → Circle.follow → Circle.answer"
    )


@component
class Chain(Thermometer):
    """Fifteen steps of a chain are no circle."""

    length: int = 0

    def short(self) -> int:
        return min(self.length, 15)

    @periodic(every=seconds(1))
    def begin(self) -> Self:
        return replace(self, length=1)

    @on_change(short)
    def go_on(self) -> Self:
        return replace(self, length=self.length + 1)


def test_a_long_chain_is_no_circle() -> None:
    assert run(Chain).knowledge("a") == Chain(id="a", length=16)


class Positioning(Protocol):
    def position(self) -> float: ...


@component
class Demanding(Thermometer):
    @periodic(every=seconds(1))
    def sense(self, base: Positioning) -> Self:
        return replace(self, temperature=int(base.position()))


@pytest.mark.parametrize(
    ("ports", "there"), [({}, "nothing"), ({Log: Lines(), int: 3}, "Log, int")], ids=["none", "others"]
)
def test_a_missing_port_is_refused_at_deployment(ports: dict[type, object], there: str) -> None:
    with pytest.raises(DeploymentError) as caught:
        Node([Demanding(id="a")], ports=ports)
    assert str(caught.value) == (f"Demanding.sense needs a Positioning ('base'); this node provides {there}")


def test_only_components_and_different_ids_can_be_deployed() -> None:
    with pytest.raises(DeploymentError) as caught:
        Node([Thermometer(id="a")])
    assert str(caught.value) == "Thermometer cannot be deployed; its class should have @component"
    with pytest.raises(DeploymentError) as caught:
        Node([Ordered(id="a"), Ordered(id="a")])
    assert str(caught.value) == "two components of a node have the same id; each should have its own"


def wrong(change: Callable[[Thermometer], object]) -> type[Knowledge]:
    @component
    class Wrong(Thermometer):
        @periodic(every=seconds(1), offset=milliseconds(1500))
        def go(self) -> Self:
            return change(self)  # type: ignore[return-value]  # what a user without mypy could write

    return Wrong


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda one: None, "Wrong.go of 'a' at 1.5 s gives a NoneType; it should give the next Wrong"),
        (
            lambda one: Thermometer(id="a"),
            "Wrong.go of 'a' at 1.5 s gives a Thermometer; it should give the next Wrong",
        ),
        (
            lambda one: replace(one, id="b"),
            "Wrong.go of 'a' at 1.5 s changes the id to 'b'; it should stay",
        ),
    ],
)
def test_what_a_process_must_not_give(change: Callable[[Thermometer], object], sentence: str) -> None:
    with pytest.raises(ExecutionError) as caught:
        run(wrong(change), until=2)
    assert str(caught.value) == sentence


def test_an_exception_of_a_process_says_where() -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        run(wrong(lambda one: 1 / 0), until=2)
    assert caught.value.__notes__ == ["in process Wrong.go of 'a' at 1.5 s"]


def test_a_node_that_stood_still_keeps_its_rhythm_and_counts_what_it_left_out() -> None:
    log = Lines()
    node = Node([Sensor(id="s")], ports={Log: log})
    node.advance(Instant(seconds(1)))
    node.skip(Instant(seconds(7.2)))
    node.advance(Instant(seconds(8.6)))
    assert log.lines == ["0 measure 0", "look 1", "8000 measure 1", "alarm 2", "look 2"]
    assert node.outcome()["counters"]["skipped"] == 7 + 3 + 7, "measurements, looks, publications"


def test_a_process_is_a_plain_method() -> None:
    assert Ordered(id="a").sooner() == Ordered(id="a", seen="a")
