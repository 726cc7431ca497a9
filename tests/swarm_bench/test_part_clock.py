"""Calls are clocked from outside: every moment is in exactly one account, and all is put back."""

from collections.abc import Iterator

import pytest

from benchmarks.swarm import part_clock
from benchmarks.swarm.part_clock import Account, PartClock, Target, calls_of


class Ticks:
    """A clock that shows what the tested code makes it show."""

    now = 0

    def __call__(self) -> int:
        return self.now


TICKS = Ticks()


@pytest.fixture(autouse=True)
def _from_nought() -> Iterator[None]:
    TICKS.now = 0
    yield


class Inner:
    def work(self, fails: bool = False) -> int:
        TICKS.now += 5
        if fails:
            raise ValueError
        return 7

    @property
    def shown(self) -> int:
        return 1

    def _hidden(self) -> None:
        TICKS.now += 1


class Outer:
    def __init__(self, name: str) -> None:
        self.name = name
        self.inner = Inner()

    def turn(self, fails: bool = False) -> int:
        TICKS.now += 2
        found = self.inner.work(fails)
        self.inner._hidden()
        return found


def test_time_is_the_parts_own_by_the_actor_whose_turn_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = PartClock(TICKS)
    monkeypatch.setattr(Outer, "turn", clock.wrap(Outer.turn, "turn", lambda outer: outer.name))
    with part_clock.clocked(clock, calls_of(Inner, "inner")):
        clock.start()
        TICKS.now += 11
        assert Outer("a").turn() == Outer("b").turn() == Inner().work() == 7
        clock.stop()
    TICKS.now += 100
    assert clock.accounts == {
        ("a", "turn"): Account(3, 1, 1),
        ("a", "inner"): Account(5, 1, 0),
        ("b", "turn"): Account(3, 1, 1),
        ("b", "inner"): Account(5, 1, 0),
        ("", "inner"): Account(5, 1, 0),
    }
    assert clock.own == Account(11, 0, 3)
    assert clock.total_ns == 32


def test_an_exception_closes_its_accounts() -> None:
    clock = PartClock(TICKS)
    with part_clock.clocked(clock, calls_of(Outer, "outer") + calls_of(Inner, "inner")):
        clock.start()
        with pytest.raises(ValueError):
            Outer("a").turn(fails=True)
        TICKS.now += 50
        clock.stop()
    assert clock.own.spent_ns == 50 and clock.accounts["", "outer"].spent_ns == 2


def test_everything_is_put_back_and_wrapped_once() -> None:
    before = dict(vars(Inner))
    targets = calls_of(Inner, "inner")
    assert targets == [Target(Inner, "work", "inner")]
    clock = PartClock(TICKS)
    with pytest.raises(RuntimeError), part_clock.clocked(clock, targets * 2):
        clock.start()
        Inner().work()
        raise RuntimeError
    assert clock.accounts["", "inner"].calls == 1
    assert dict(vars(Inner)) == before


def test_the_clocks_own_cost_is_measured() -> None:
    cost = part_clock.overhead(probes=500, repeats=2)
    assert 0 < cost.inside_ns + cost.outside_ns < 100_000
