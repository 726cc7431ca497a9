"""Processes of one node: schedule, arguments and errors."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, Self, TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deeco import (
    DefinitionError,
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
from deeco.instant import Duration, Task
from deeco.network import NetworkParameters
from deeco.node import Node, TaskQueue
from tests.deeco.refusals import refused


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


def run(kind: type[Knowledge], until: float = 0.1) -> Node:
    node = Node([kind(id="a")])
    node.advance(Instant(seconds(until)))
    return node


def test_processes_run_at_their_own_instants_and_on_changes() -> None:
    log = Lines()
    node = Node([Sensor(id="s")], ports={Log: log})
    node.advance(Instant(seconds(3)))
    assert log.lines == [
        "0 measure 0", "look 1", "1000 measure 1", "alarm 2", "2000 measure 2", "look 3",
    ]  # fmt: skip
    node.advance(Instant(seconds(10)))
    assert node.knowledge("s") == Sensor(id="s", temperature=10, alarms=1), "one alarm, not one per commit"


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


def test_a_cycle_of_triggers_is_reported() -> None:
    with refused(
        "at 0 s processes keep triggering each other: Circle.answer → Circle.follow → Circle.answer",
        ExecutionError,
    ):
        run(Circle)


@component
class Chain(Thermometer):
    length: int = 0

    def short(self) -> int:
        return min(self.length, 15)

    @periodic(every=seconds(1))
    def begin(self) -> Self:
        return replace(self, length=1)

    @on_change(short)
    def go_on(self) -> Self:
        return replace(self, length=self.length + 1)


def test_a_long_chain_of_triggers_is_allowed() -> None:
    assert run(Chain).knowledge("a") == Chain(id="a", length=16)


@pytest.mark.parametrize(
    ("components", "ports", "sentence"),
    [
        ([Sensor(id="a")], {}, "Sensor.measure needs a Log ('log'); this node provides nothing"),
        (
            [Sensor(id="a")],
            {Lines: Lines(), int: 3},
            "Sensor.measure needs a Log ('log'); this node provides Lines, int",
        ),
        ([Thermometer(id="a")], {}, "Thermometer cannot be deployed: decorate its class with @component"),
        (
            [Ordered(id="a"), Ordered(id="a")],
            {},
            "the components of a node are a, a; ids must be unique",
        ),
        ([Sensor], {}, "Sensor is a class; use an instance, Sensor(id=...)"),
        ([Ordered(id=3)], {}, "Ordered.id is 3; must be a str that is not empty"),  # type: ignore[arg-type]
        ([Ordered(id="")], {}, "Ordered.id is ''; must be a str that is not empty"),
    ],
)
def test_invalid_deployments_are_refused(components: Any, ports: dict[type, object], sentence: str) -> None:
    with refused(sentence, DeploymentError):
        Node(components, ports=ports)


def test_another_component_and_wrong_durations_are_refused() -> None:
    node = Node([Ordered(id="a"), Ordered(id="b")])
    with refused("this node has no component 'c'; use one of a, b", DeploymentError):
        node.knowledge("c")
    for epoch in ("3", -1, True, 1.5):
        with refused(f"epoch is {epoch!r}; must be an integer of at least 0", DeploymentError):
            Node([Ordered(id="a")], epoch=epoch)  # type: ignore[arg-type]
    advice = "use at least 1000 µs. seconds(1) is one second"
    for name in ("publish_every", "forget_after"):
        for value in (1, -2_000_000):
            with refused(f"NetworkParameters: {name}={value} is {value} µs; {advice}", DefinitionError):
                NetworkParameters(**{name: value})  # type: ignore[arg-type]
        with refused(
            f"NetworkParameters: {name}=True is not a duration; use one, such as seconds(1)", DefinitionError
        ):
            NetworkParameters(**{name: True})  # type: ignore[arg-type]


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
        (lambda one: None, "Wrong.go of 'a' at 1.5 s returned a NoneType; return the next Wrong"),
        (
            lambda one: Thermometer(id="a"),
            "Wrong.go of 'a' at 1.5 s returned a Thermometer; return the next Wrong",
        ),
        (lambda one: replace(one, id="b"), "Wrong.go of 'a' at 1.5 s changed the id to 'b'; keep the id"),
    ],
)
def test_invalid_results_of_processes_are_refused(
    change: Callable[[Thermometer], object], sentence: str
) -> None:
    with refused(sentence, ExecutionError):
        run(wrong(change), until=2)


def test_an_exception_of_a_process_has_a_note_of_its_origin() -> None:
    with pytest.raises(ZeroDivisionError) as caught:
        run(wrong(lambda one: 1 / 0), until=2)
    assert caught.value.__notes__ == ["in process Wrong.go of 'a' at 1.5 s"]


def test_a_skipping_node_keeps_its_schedule_and_counts_skipped_tasks() -> None:
    log = Lines()
    node = Node([Sensor(id="s")], ports={Log: log})
    node.advance(Instant(seconds(1)))
    node.skip(Instant(seconds(7.2)))
    node.advance(Instant(seconds(8.6)))
    assert log.lines == ["0 measure 0", "look 1", "8000 measure 1", "alarm 2", "look 2"]
    assert node.outcome()["counters"]["skipped"] == 7 + 3 + 7, "measurements, looks, publications"


T = TypeVar("T")


def note(log: list[tuple[int, T]], what: T) -> Task:
    return lambda now: log.append((now, what))


def test_tasks_run_by_order_then_by_age() -> None:
    agenda = TaskQueue()
    log: list[tuple[int, str]] = []
    for name, order in (("a", 1), ("b", 0), ("c", 1), ("d", 0)):
        agenda.repeat(note(log, name), Instant(0), Duration(5), order)
    agenda.once(note(log, "once"), Instant(5), order=1)
    agenda.run(Instant(6))
    names = [name for _, name in log]
    assert names == ["b", "d", "a", "c", "b", "d", "a", "c", "once"]


def test_skipping_keeps_periods_and_drops_single_tasks() -> None:
    agenda, log = TaskQueue(), list[tuple[int, str]]()
    agenda.repeat(note(log, "a"), Instant(3), Duration(10))
    agenda.once(note(log, "b"), Instant(20))
    agenda.once(note(log, "b"), Instant(45))
    assert agenda.skip(Instant(43)) == 4 + 1
    agenda.run(Instant(60))
    assert log == [(43, "a"), (45, "b"), (53, "a")]


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(1, 20), st.integers(-2, 2)), min_size=1, max_size=6),
    st.lists(st.integers(0, 40), max_size=10),
)
def test_the_division_into_steps_does_not_matter(tasks: list[tuple[int, int, int]], cuts: list[int]) -> None:
    def log_of(boundaries: list[int]) -> list[tuple[int, int]]:
        agenda: TaskQueue = TaskQueue()
        log: list[tuple[int, int]] = []
        for number, (first, every, order) in enumerate(tasks):
            agenda.repeat(note(log, number), Instant(first), Duration(every), order)
        for until in boundaries:
            agenda.run(Instant(until))
        return log

    whole = log_of([60])
    assert log_of([*sorted(cuts), 60]) == whole
    assert [now for now, _ in whole] == sorted(now for now, _ in whole)


def test_unbounded_scheduling_is_stopped() -> None:
    agenda = TaskQueue(most=3)
    agenda.repeat(lambda now: None, Instant(7_000_000), Duration(10))
    for _ in range(2):
        agenda.once(lambda now: None, Instant(9_000_000))
    sentence = "3 tasks are scheduled, the next at 7 s; which is the limit; check for repeated scheduling"
    with pytest.raises(ExecutionError, match=sentence):
        agenda.once(lambda now: None, Instant(1))
    with pytest.raises(ExecutionError, match=sentence):
        agenda.repeat(lambda now: None, Instant(1), Duration(1))
    agenda.run(Instant(9_000_001))
    agenda.once(lambda now: None, Instant(10_000_000))
