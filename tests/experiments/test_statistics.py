"""Statistics against published values, and against what they promise about error and power."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import norm

from experiments.statistics.paired_tests import (
    Effect,
    SequentialPlan,
    a12,
    a12_bounds,
    a12_interval,
    decidable,
    equivalence_p,
    fewest_differing,
    holm,
    mean_interval,
    mean_test,
    most,
    pairs_needed,
    plan,
    power,
    signed_rank,
)
from experiments.statistics.survival import Completion, kaplan_meier, restricted_mean, restricted_means

Floats = NDArray[np.float64]
# Hamilton depression scale factors before and after tranquilizer: Hollander & Wolfe, "Nonparametric
# Statistical Methods", 1973, p. 29; in R: wilcox.test(before, after, paired = TRUE)
BEFORE = (1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30)
AFTER = (0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29)
# Weeks of remission of leukaemia patients with 6-mercaptopurine and with placebo: Freireich et al., Blood 21,
# 1963; in R: survfit and survdiff on them
TREATED = [Completion(t, True) for t in (6, 6, 6, 7, 10, 13, 16, 22, 23)] + [
    Completion(t, False) for t in (6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35)
]
PLACEBO = [
    Completion(t, True) for t in (1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23)
]


def test_a12_is_the_share_of_pairs_won_ties_counted_half() -> None:
    one, other = (3.0, 1.0, 2.0, 2.0), (2.0, 0.0, 5.0)
    wins = sum((a > b) + 0.5 * (a == b) for a in one for b in other)
    assert a12(one, other) == pytest.approx(wins / 12)
    assert a12(other, one) == pytest.approx(1 - wins / 12)


DIFFERENCES = np.array(BEFORE) - np.array(AFTER)


def test_the_signed_rank_test_against_a_published_value() -> None:
    assert tuple(signed_rank(DIFFERENCES)) == (9, 1, 0.0390625)


def flipped(differences: Floats, sizes: Floats, *, two_sided: bool = True) -> float:
    """The p-value of the sum of signed sizes, by scipy, over all signs."""
    found = stats.permutation_test(
        (np.sign(differences) * sizes,), lambda one, axis: one.sum(axis=axis), permutation_type="samples",
        n_resamples=np.inf, alternative="two-sided" if two_sided else "greater", vectorized=True,
    )  # fmt: skip
    return float(found.pvalue)


@pytest.mark.parametrize("seed", range(3))
def test_tests_of_pairs_are_exact_with_ties_and_without_differences(seed: int) -> None:
    """Against scipy's enumeration of all signs: ranks with ties and zeros, differences, and a margin."""
    rng = np.random.default_rng(seed)
    differences = rng.integers(-3, 5, 11).astype(np.float64)
    ranks = np.where(differences == 0, 0.0, stats.rankdata(np.abs(differences)))
    assert signed_rank(differences).p == pytest.approx(flipped(differences, ranks))
    steps = np.rint(np.abs(differences) * 50 * 11 / np.abs(differences).sum())
    assert mean_test(differences).p == pytest.approx(flipped(differences, steps))
    times = rng.normal(10.0, 40.0, 11)
    assert mean_test(times).p == pytest.approx(flipped(times, np.abs(times)), abs=0.01)
    one_sided = max(
        flipped(shifted, np.abs(shifted), two_sided=False) for shifted in (times + 60.0, 60.0 - times)
    )
    assert equivalence_p(times, 60.0) == pytest.approx(one_sided, abs=0.01)


def test_few_pairs_that_differ_prove_nothing() -> None:
    """Four of forty pairs, all for one side: the normal approximation would have 0.046."""
    four = np.array([1.0] * 4 + [0.0] * 36)
    assert signed_rank(four) == (4, 1, 2 / 2**4)
    assert signed_rank(np.zeros(3)) == mean_test(np.zeros(3)) == (0, 0, 1.0)
    assert [fewest_differing(tests) for tests in (1, 2, 3, 6)] == [6, 7, 7, 8]


def test_tests_that_cannot_decide_share_nothing() -> None:
    """Six differing pairs are enough for one test alone; of two, the other would need seven."""
    assert decidable([6, 5]) == [True, False]
    assert decidable([6, 7]) == [False, True]
    assert decidable([7, 7]) == [True, True]
    assert decidable([]) == []


def test_holm_against_r() -> None:
    """In R: p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm")."""
    assert holm((0.01, 0.04, 0.03, 0.005)) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(()) == []


def test_kaplan_and_meier_against_published_values() -> None:
    curve = kaplan_meier(TREATED)
    assert curve.times.tolist() == [6, 7, 10, 13, 16, 22, 23]
    assert curve.shares == pytest.approx([0.857, 0.807, 0.753, 0.690, 0.627, 0.538, 0.448], abs=5e-4)
    assert (curve.share_at(5.9), curve.share_at(6), curve.share_at(40)) == pytest.approx(
        (1, 0.857, 0.448), abs=5e-4
    )
    assert (curve.low <= curve.shares).all()
    assert (curve.shares <= curve.high).all()


def test_the_restricted_mean_of_complete_times_is_the_mean() -> None:
    times = [run.at for run in PLACEBO]
    assert restricted_mean(PLACEBO, 100.0) == pytest.approx(mean_interval(times))
    assert restricted_mean([Completion(50.0, False)], 40.0).value == 40.0
    never = [Completion(600.0, False)] * 3
    assert restricted_mean(never, 600.0) == (600.0, 600.0, 600.0)
    assert kaplan_meier(never).share_at(600.0) == 1.0


def test_restricted_means_of_samples_are_the_areas_under_their_curves() -> None:
    rng = np.random.default_rng(6)
    drawn = rng.integers(len(TREATED), size=(10, len(TREATED)))
    for horizon in (5.0, 20.0, 40.0):
        for mean, places in zip(restricted_means(TREATED, horizon, drawn), drawn, strict=True):
            curve = kaplan_meier([TREATED[place] for place in places])
            edges = [0.0, *(at for at in curve.times.tolist() if at < horizon), horizon]
            area = sum((b - a) * curve.share_at(a) for a, b in pairwise(edges))
            assert mean == pytest.approx(area)


def test_sequential_bounds_against_published_values() -> None:
    """Lan and DeMets' spending function close to O'Brien and Fleming's, five looks, two-sided 5 %.

    As in Jennison and Turnbull, "Group Sequential Methods", 2000, and the R packages ldbounds and gsDesign.
    """
    rule = plan([20, 40, 60, 80, 100])
    bounds = [float(norm.isf(p / 2)) for p in rule.thresholds]
    assert bounds == pytest.approx([4.8769, 3.3569, 2.6803, 2.2898, 2.0310], abs=2e-3)


def test_pairs_needed_for_a_large_effect() -> None:
    """By simulation of the exact signed-rank test, give or take one or two."""
    assert pairs_needed(Effect()) == pytest.approx(40, abs=2)
    assert pairs_needed(Effect(correlation=0.3)) == pytest.approx(27, abs=2)
    assert pairs_needed(Effect(tests=6)) == pytest.approx(58, abs=2)
    with pytest.raises(ValueError, match=r"a12 should lie between 0 and 1 and not be 0\.5"):
        pairs_needed(Effect(a12=0.5))
    with pytest.raises(ValueError, match=r"the looks \(20, 20\) should be numbers of pairs that grow"):
        plan([20, 20])


def test_the_power_is_that_of_the_test_itself() -> None:
    effect, rng = Effect(0.75, 0.2, tests=2), np.random.default_rng(4)
    spread = (2 * (1 - effect.correlation)) ** 0.5
    told = sum(signed_rank(rng.normal(effect.shift, spread, 20)).p <= 0.025 for _ in range(400))
    assert told / 400 == pytest.approx(power(effect, 20), abs=0.08)


def looked(differences: Floats, rule: SequentialPlan) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Which campaigns, (runs, pairs), a look decided, and at how many pairs each ended."""
    p = [
        stats.wilcoxon(differences[:, :look], axis=1, method="exact" if look <= 50 else "approx").pvalue
        for look in rule.looks
    ]
    decides = np.less_equal(np.array(p).T, np.array(rule.thresholds))
    decided = np.asarray(decides.any(axis=1), np.bool_)
    first = np.array(rule.looks, np.int64)[decides.argmax(axis=1)]
    return decided, np.where(decided, first, rule.looks[-1])


def test_looking_again_and_again_claims_too_much_in_no_more_than_five_of_a_hundred() -> None:
    """1000 comparisons of a strategy with itself: 5 % and three standard errors at most."""
    rng, rule = np.random.default_rng(1), plan(list(range(10, 61, 10)))
    decided, _ = looked(rng.normal(size=(1000, 60)) - rng.normal(size=(1000, 60)), rule)
    assert decided.sum() <= 68


def test_a_large_effect_is_seen_early() -> None:
    """Power 90 % at A12 = 0.71 with fewer than 50 pairs on average, 60 at most."""
    rng, rule = np.random.default_rng(2), plan(list(range(10, 61, 10)))
    shifted = rng.normal(Effect().shift, 1, (1000, 60)) - rng.normal(size=(1000, 60))
    decided, ended = looked(shifted, rule)
    assert decided.mean() >= 0.9
    assert ended.mean() < 50


def test_an_interval_of_a12_holds_at_its_edge() -> None:
    """Six pairs of which all, or nearly all, are won: the percentile bootstrap's [1, 1] held 39 % there."""
    low, high = a12_bounds(1.0, 6)
    assert [float(low), float(high)] == pytest.approx([0.689, 1.0], abs=0.001)
    rng, share = np.random.default_rng(3), 0.97
    ones = rng.normal(Effect(share).shift, 1, (1000, 6))
    low, high = a12_bounds(a12(ones, rng.normal(size=(1000, 6))), 6)
    assert ((low <= share) & (share <= high)).mean() >= 0.93
    value, below, above = a12_interval(BEFORE, AFTER)
    assert below < value < above
    mirrored = a12_interval(AFTER, BEFORE)
    assert [mirrored.low, mirrored.high] == pytest.approx([1 - above, 1 - below])


def test_the_most_that_a_share_may_be_holds_for_every_share() -> None:
    """Rule of three, and 95 % by the binomial itself for whatever share is true."""
    assert most(0, 100) == pytest.approx(0.03, abs=0.001)
    assert most(6, 6) == 1.0
    for of in (6, 20):
        bounds = np.array([most(found, of) for found in range(of + 1)])
        for share in np.linspace(0.01, 0.99, 99):
            assert stats.binom.pmf(np.arange(of + 1), of, share)[bounds < share].sum() <= 0.05 + 1e-9


def test_the_interval_of_a_mean_is_student_s() -> None:
    """In R: t.test(before - after)."""
    found = stats.ttest_1samp(DIFFERENCES, 0.0).confidence_interval(0.95)
    assert mean_interval(DIFFERENCES) == pytest.approx((DIFFERENCES.mean(), found.low, found.high))
    assert np.isnan(mean_interval([3.0]).low)
