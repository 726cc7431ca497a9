"""Error rate, power and coverage of verdicts, on campaigns drawn from a real one with known differences."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.random import Generator
from scipy.stats import norm

from acrc_testbed.experiments.comparison import PairedSample, scores
from acrc_testbed.experiments.metrics import Run
from acrc_testbed.experiments.paired_tests import ALPHA, AssumedEffect, a12, a12_bounds, power
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.verdicts import (
    PairVerdict,
    interim_verdict,
    select_pairs,
    simulated_power,
    stopping_rules,
    verdicts,
)
from acrc_testbed.experiments.verdicts import family_size as number_of_tests
from tests.experiments import campaign_rows
from tests.experiments.made_runs import CLEANING, METRICS
from tests.experiments.made_runs import run as made

pytestmark = pytest.mark.claim("verdicts")
Record = Callable[[str, object], None]
PRIMARY = (("chapter", "none"), ("auction", "chapter"))
CAP = 40
FAMILY = campaign_rows.study(PRIMARY, CAP)
REAL = campaign_rows.samples(PRIMARY)
SHARES = (0.5, 0.6, 0.71, 0.8, 0.9, 0.95, 0.97, 0.99)
PAIRS = (6, 8, 10, 20, 40)
LEAST_COVERAGE = 0.93
FAILURES = 0.05
"""Share of runs that fail, whatever their strategy."""


def three_errors(share: float, count: int) -> float:
    return 3.0 * float(np.sqrt(share * (1 - share) / count))


def of_one_strategy(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    """Both sides of each comparison drawn from the runs of its first strategy."""
    made = []
    for one in declared:
        runs = [first for first, _ in one.pairs]
        chosen = rng.integers(len(runs), size=(CAP, 2)).tolist()
        made.append(one._replace(pairs=tuple((runs[a], runs[b]) for a, b in chosen)))
    return made


def swapped(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    """Pairs drawn with replacement, with sides swapped at random."""
    made = select_pairs(declared, rng.integers(len(declared[0].pairs), size=CAP))
    swaps = rng.random((len(made), CAP)) < 0.5
    return [
        one._replace(
            pairs=tuple(pair[::-1] if swap else pair for pair, swap in zip(one.pairs, row, strict=True))
        )
        for one, row in zip(made, swaps.tolist(), strict=True)
    ]


def swapped_and_failing(declared: Sequence[PairedSample], rng: Generator) -> list[PairedSample]:
    def failing(run: Run) -> Run:
        return None if rng.random() < FAILURES else run

    return [
        one._replace(pairs=tuple((failing(a), failing(b)) for a, b in one.pairs))
        for one in swapped(declared, rng)
    ]


def after_all(drawn: Sequence[PairedSample], study: Study) -> bool:
    return any(one.deciding is not None for one in verdicts(drawn, study))


def with_looks(drawn: Sequence[PairedSample], study: Study) -> bool:
    rules = stopping_rules(study)
    return any(interim_verdict(one, study, rules).deciding is not None for one in drawn)


@pytest.mark.parametrize("judge", [after_all, with_looks])
@pytest.mark.parametrize("draw", [of_one_strategy, swapped, swapped_and_failing])
def test_strategies_rarely_differ_from_themselves(
    draw: Callable[[Sequence[PairedSample], Generator], list[PairedSample]],
    judge: Callable[[Sequence[PairedSample], Study], bool],
    full: bool,
    record_property: Record,
) -> None:
    count, rng = 5000 if full else 40, np.random.default_rng(1)
    study = campaign_rows.study(PRIMARY[:1], CAP) if draw is of_one_strategy else FAMILY
    declared = [one for one in REAL if (one.one, one.other) in study.primary_pairs]
    share = sum(judge(draw(declared, rng), study) for _ in range(count)) / count
    record_property("share of campaigns that claim a difference", share)
    assert share <= max(0.06, ALPHA + three_errors(ALPHA, count))


def normal_sample(share: float, pairs: int, rng: Generator) -> PairedSample:
    """Return runs with normally distributed places, A12 `share`, and identically distributed times."""
    places = rng.normal((AssumedEffect(share).shift, 0.0), 1.0, (pairs, 2))
    times = rng.uniform(300.0, 600.0, (pairs, 2))

    def run(done: float, at: float) -> Run:
        return made(round(1000 + 100 * done), at, completion_s=None, places_total=2000)

    rows = zip(places.tolist(), times.tolist(), strict=True)
    drawn = tuple((run(one, at), run(other, then)) for (one, other), (at, then) in rows)
    return PairedSample("one", "other", (), drawn)


def more_places(found: Sequence[PairVerdict]) -> bool:
    deciding = found[0].deciding
    return deciding is not None and (deciding.metric, deciding.test.direction) == ("places", 1)


@pytest.mark.parametrize("share", [0.6, 0.71, 0.8])
def test_power_for_normal_effects(share: float, full: bool, record_property: Record) -> None:
    campaigns, rng = 300 if full else 40, np.random.default_rng(2)
    study = Study(
        name="normal",
        task=CLEANING,
        scenario="",
        strategies=("one", "other"),
        seeds=CAP,
        primary=(("one", "other"),),
    )
    for pairs in (10, 20, 40):
        drawn = ([normal_sample(share, pairs, rng)] for _ in range(campaigns))
        delivered = sum(more_places(verdicts(one, study)) for one in drawn) / campaigns
        promised = power(AssumedEffect(share, tests=number_of_tests(study)), pairs)
        record_property(f"{pairs} pairs: promised, delivered", (round(promised, 3), delivered))
        assert delivered >= promised - three_errors(0.5, campaigns)


def test_power_from_a_pilot_agrees_with_other_seeds(full: bool, record_property: Record) -> None:
    """Both are averages over random halves of the real seeds: the pilot, and the rest."""
    campaigns, splits = (15, 20) if full else (4, 5)
    rng, worst = np.random.default_rng(3), 0.0
    for pairs in (10, 20, 40):
        found = np.zeros((len(REAL), 2))
        for _ in range(splits):
            pilot, rest = (
                select_pairs(REAL, half) for half in np.split(rng.permutation(len(REAL[0].pairs)), 2)
            )
            found[:, 0] += simulated_power(pilot, FAMILY, pairs, rng, campaigns, cautious=True)
            found[:, 1] += simulated_power(rest, FAMILY, pairs, rng, campaigns)
        worst = max(worst, float(np.abs(found[:, 0] - found[:, 1]).max() / splits))
    record_property("largest difference of a promise", round(worst, 2))
    assert worst <= (0.2 if full else 0.5)


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.6])
def test_intervals_of_a12_normal_values(correlation: float, full: bool, record_property: Record) -> None:
    draws, rng = 4000 if full else 1000, np.random.default_rng(4)
    covered = {}
    for pairs in PAIRS:
        for share in SHARES:
            shift = np.sqrt(2.0) * norm.ppf(share)
            covariance = ((1.0, correlation), (correlation, 1.0))
            ones, others = rng.multivariate_normal((shift, 0.0), covariance, (draws, pairs)).transpose(
                2, 0, 1
            )
            low, high = a12_bounds(a12(ones, others), pairs)
            covered[pairs, share] = float(((low <= share) & (share <= high)).mean())
    record_property("least coverage", min(covered.values()))
    assert min(covered.values()) >= LEAST_COVERAGE, covered


def test_intervals_of_a12_cover_the_truth_of_real_runs(full: bool, record_property: Record) -> None:
    draws, rng = 4000 if full else 1000, np.random.default_rng(5)
    covered = {}
    for place, sample in enumerate(REAL):
        ones, others, *_ = scores(METRICS["places"], sample.pairs)
        share = a12(ones, others)
        for pairs in PAIRS:
            chosen = rng.integers(ones.size, size=(draws, pairs))
            low, high = a12_bounds(a12(ones[chosen], others[chosen]), pairs)
            covered[place, pairs] = float(((low <= share) & (share <= high)).mean())
    record_property("least coverage", min(covered.values()))
    assert min(covered.values()) >= LEAST_COVERAGE, covered
