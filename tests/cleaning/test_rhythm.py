"""Every instant of a rhythm comes once, whatever the steps are."""

from hypothesis import given
from hypothesis import strategies as st

from actors.instant import Duration, Instant
from cleaning.rhythm import Rhythm


@given(
    period=st.integers(1, 1000),
    phase=st.integers(0, 999),
    begin=st.integers(0, 5000),
    steps=st.lists(st.integers(1, 2500), min_size=1, max_size=20),
)
def test_steps_without_gaps_give_every_instant_exactly_once(
    period: int, phase: int, begin: int, steps: list[int]
) -> None:
    rhythm, end, given_out = Rhythm(Duration(period), phase), begin, []
    for step in steps:
        given_out += rhythm.due(Instant(end), Instant(end + step))
        end += step
    assert given_out == [t for t in range(begin, end) if (t - phase) % period == 0]


def test_what_falls_into_a_small_gap_comes_late_and_the_rhythm_is_kept() -> None:
    rhythm = Rhythm(Duration(500))
    assert rhythm.due(Instant(0), Instant(100)) == [0]
    assert rhythm.due(Instant(510), Instant(610)) == [510]
    assert rhythm.due(Instant(990), Instant(1090)) == [1000]


def test_steps_that_overlap_give_nothing_twice() -> None:
    rhythm = Rhythm(Duration(500))
    assert rhythm.due(Instant(450), Instant(550)) == [500]
    assert rhythm.due(Instant(500), Instant(600)) == []


def test_what_was_missed_by_a_whole_period_is_left_out() -> None:
    rhythm = Rhythm(Duration(500))
    assert rhythm.due(Instant(0), Instant(100)) == [0]
    assert rhythm.due(Instant(1000), Instant(1100)) == [1000]


def test_what_was_missed_for_long_is_left_out() -> None:
    rhythm = Rhythm(Duration(500), 20)
    assert rhythm.due(Instant(0), Instant(100)) == [20]
    assert rhythm.due(Instant(60_000), Instant(60_100)) == [60_020]
