"""How likely a robot is lost, by beams that agree with the map and beams that pass its walls."""

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from actors.robot.localisation import lost
from actors.robot.localisation.lost import LostProbability, odds_of_lost

beams = st.integers(0, 1000)


def likelihood(passing: float, agreeing: float, agreed: int, passed: int) -> float:
    """The logarithm of a beta-binomial's, but for the binomial coefficient, which cancels in a ratio."""

    def beta(a: float, b: float) -> float:
        return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)

    return beta(passing + passed, agreeing + agreed) - beta(passing, agreeing)


def after(scans: int, agreeing: int, passed: int, probability: float = 0.0) -> LostProbability:
    state = LostProbability(probability)
    for _ in range(scans):
        state.take(agreeing, passed)
    return state


@given(beams, beams)
def test_the_odds_are_the_root_of_the_ratio_of_two_beta_binomials(agreed: int, passed: int) -> None:
    ratio = likelihood(*lost._LOST, agreed, passed) - likelihood(*lost._TRACKING, agreed, passed)
    assert odds_of_lost(agreed, passed) == pytest.approx(math.exp(0.5 * ratio), rel=1e-9)


def test_a_scan_that_says_nothing_changes_nothing() -> None:
    assert odds_of_lost(0, 0) == 1.0


@given(st.integers(1, 200), st.integers(0, 200))
def test_a_beam_more_that_passes_a_wall_makes_it_likelier_and_one_that_agrees_less_likely(
    agreed: int, passed: int
) -> None:
    assert odds_of_lost(agreed, passed + 1) > odds_of_lost(agreed, passed)
    if passed == 0:  # with many that pass, one that agrees says only that the share is not all
        assert odds_of_lost(agreed + 1, 0) < odds_of_lost(agreed, 0)


def test_it_falls_with_scans_that_agree_and_rises_with_those_that_pass_walls() -> None:
    falling = [after(scans, 40, 0, 0.5).probability for scans in range(9)]
    rising = [after(scans, 20, 20).probability for scans in range(5)]
    assert all(a > b for a, b in pairwise(falling)) and falling[-1] < 0.001
    assert all(a < b for a, b in pairwise(rising)) and rising[-1] > 0.9


def test_a_beam_that_grazes_a_corner_now_and_then_is_no_reason() -> None:
    state = LostProbability()
    for number in range(300):
        state.take(50, 1 if number % 5 == 0 else 0)
        assert state.probability < 0.01


@given(st.lists(st.tuples(beams, beams), max_size=40), st.floats(0.0, 1.0))
def test_it_is_never_certain_of_either(scans: list[tuple[int, int]], first: float) -> None:
    state = LostProbability(first)
    for agreed, passed in scans:
        state.take(agreed, passed)
        assert 1e-6 <= state.probability <= 0.999


def test_it_recovers_however_long_it_was_sure() -> None:
    certain = after(1000, 0, 1000)
    assert certain.probability == 0.999
    for _ in range(15):
        certain.take(50, 0)
    assert certain.probability < 0.01
    for _ in range(10):
        certain.take(10, 30)
    assert certain.probability > 0.99


@pytest.mark.parametrize(("agreed", "passed"), [(0, 1000), (1000, 0), (1000, 1000), (10_000, 10_000)])
def test_many_beams_stay_finite(agreed: int, passed: int) -> None:
    assert 0.0 < odds_of_lost(agreed, passed) < math.inf
    assert 0.0 < after(20, agreed, passed).probability < 1.0
