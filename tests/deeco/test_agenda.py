"""The agenda does things in order, without drift."""

from typing import TypeVar

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deeco.errors import ExecutionError
from deeco.instant import Duration, Instant, Task
from deeco.node import Agenda

T = TypeVar("T")


class Log:
    def __init__(self) -> None:
        self.instants: list[int] = []

    def __call__(self, now: Instant) -> None:
        self.instants.append(now)


def note(log: list[tuple[int, T]], what: T) -> Task:
    return lambda now: log.append((now, what))


def test_repeats_at_whole_multiples_however_time_goes_on() -> None:
    agenda, log = Agenda(), Log()
    agenda.repeat(log, Instant(3), Duration(10))
    for until in (4, 5, 27, 28, 43):
        agenda.run(Instant(until))
    assert log.instants == [3, 13, 23, 33]


def test_lower_order_goes_first_then_who_came_first() -> None:
    agenda = Agenda()
    log: list[tuple[int, str]] = []
    for name, order in (("a", 1), ("b", 0), ("c", 1), ("d", 0)):
        agenda.repeat(note(log, name), Instant(0), Duration(5), order)
    agenda.once(note(log, "once"), Instant(5), order=1)
    agenda.run(Instant(6))
    names = [name for _, name in log]
    assert names == ["b", "d", "a", "c", "b", "d", "a", "c", "once"]


def test_what_is_planned_meanwhile_is_done_in_the_same_run() -> None:
    agenda, log = Agenda(), Log()
    agenda.once(lambda now: agenda.once(log, Instant(now + 2)), Instant(1))
    agenda.run(Instant(3))
    assert log.instants == []
    agenda.run(Instant(4))
    assert log.instants == [3]


def test_skipping_keeps_the_rhythm_and_drops_what_was_once() -> None:
    agenda, log = Agenda(), Log()
    agenda.repeat(log, Instant(3), Duration(10))
    agenda.once(log, Instant(20))
    agenda.once(log, Instant(45))
    assert agenda.skip(Instant(43)) == 4 + 1
    agenda.run(Instant(60))
    assert log.instants == [43, 45, 53]


@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(1, 20), st.integers(-2, 2)), min_size=1, max_size=6),
    st.lists(st.integers(0, 40), max_size=10),
)
def test_any_cutting_into_steps_gives_the_same(tasks: list[tuple[int, int, int]], cuts: list[int]) -> None:
    def log_of(boundaries: list[int]) -> list[tuple[int, int]]:
        agenda: Agenda = Agenda()
        log: list[tuple[int, int]] = []
        for number, (first, every, order) in enumerate(tasks):
            agenda.repeat(note(log, number), Instant(first), Duration(every), order)
        for until in boundaries:
            agenda.run(Instant(until))
        return log

    whole = log_of([60])
    assert log_of([*sorted(cuts), 60]) == whole
    assert [now for now, _ in whole] == sorted(now for now, _ in whole)


def test_what_plans_without_end_is_stopped() -> None:
    agenda = Agenda(most=3)
    agenda.repeat(lambda now: None, Instant(7_000_000), Duration(10))
    for _ in range(2):
        agenda.once(lambda now: None, Instant(9_000_000))
    sentence = "3 tasks are planned already, the next at 7 s; no more can be until some are done"
    with pytest.raises(ExecutionError, match=sentence):
        agenda.once(lambda now: None, Instant(1))
    with pytest.raises(ExecutionError, match=sentence):
        agenda.repeat(lambda now: None, Instant(1), Duration(1))
    agenda.run(Instant(9_000_001))
    agenda.once(lambda now: None, Instant(10_000_000))
