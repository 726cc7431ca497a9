"""Statistics against published values, other libraries and simulation; estimates of a real campaign."""

import numpy as np
import pandas as pd
import pytest
from lifelines import KaplanMeierFitter
from lifelines.utils import restricted_mean_survival_time
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import norm
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.weightstats import DescrStatsW, ttost_paired

from acrc_testbed.experiments.comparison import comparison_of, scores
from acrc_testbed.experiments.paired_tests import (
    AssumedEffect,
    a12,
    a12_bounds,
    a12_interval,
    decidable,
    equivalence_p,
    fewest_differing,
    holm,
    mean_interval,
    mean_test,
    pairs_needed,
    power,
    sequential_plan,
    share_upper_bound,
    signed_rank,
)
from acrc_testbed.experiments.statistical_models import (
    Completion,
    kaplan_meier,
    restricted_mean,
)
from acrc_testbed.experiments.verdicts import verdicts
from tests.experiments import campaign_rows
from tests.experiments.made_runs import METRICS

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


def flipped(differences: Floats, sizes: Floats, *, two_sided: bool = True) -> float:
    """Return scipy's p-value of the sum of signed sizes, over all signs."""
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
    assert tuple(signed_rank(DIFFERENCES)) == (9, 1, 0.0390625), "published, and of R"
    assert signed_rank(np.array([1.0] * 4 + [0.0] * 36)) == (4, 1, 2 / 2**4)
    assert signed_rank(np.zeros(3)) == mean_test(np.zeros(3)) == (0, 0, 1.0)
    assert [fewest_differing(tests) for tests in (1, 2, 3, 6)] == [6, 7, 7, 8]
    # tests that cannot decide share nothing
    assert decidable([6, 5]) == [True, False] and decidable([6, 7]) == [False, True]
    assert decidable([7, 7]) == [True, True] and decidable([]) == []


def test_holm_and_intervals_against_r() -> None:
    """In R: p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm"); t.test(before - after)."""
    found = stats.ttest_1samp(DIFFERENCES, 0.0).confidence_interval(0.95)
    assert mean_interval(DIFFERENCES) == pytest.approx((DIFFERENCES.mean(), found.low, found.high))
    assert np.isnan(mean_interval([3.0]).low)
    assert holm((0.01, 0.04, 0.03, 0.005)) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(()) == []


def test_kaplan_and_meier_against_published_values() -> None:
    curve = kaplan_meier(TREATED)
    assert curve.times.tolist() == [6, 7, 10, 13, 16, 22, 23]
    assert curve.shares == pytest.approx([0.857, 0.807, 0.753, 0.690, 0.627, 0.538, 0.448], abs=5e-4)
    assert (curve.share_at(5.9), curve.share_at(6), curve.share_at(40)) == pytest.approx(
        (1, 0.857, 0.448), abs=5e-4
    )
    assert ((curve.low <= curve.shares) & (curve.shares <= curve.high)).all()


def test_the_restricted_mean_of_complete_times_is_the_mean() -> None:
    times = [run.at for run in PLACEBO]
    assert restricted_mean(PLACEBO, 100.0) == pytest.approx(mean_interval(times))
    assert restricted_mean([Completion(50.0, False)], 40.0).value == 40.0
    never = [Completion(600.0, False)] * 3
    assert restricted_mean(never, 600.0) == (600.0, 600.0, 600.0)
    assert kaplan_meier(never).share_at(600.0) == 1.0


def test_restricted_means_stay_within_the_run() -> None:
    """One of eight runs complete, at 136 s: Student's interval alone would end at 211 s of 200 s."""
    found = restricted_mean([Completion(136.0, True)] + [Completion(200.0, False)] * 7, 200.0)
    assert found == pytest.approx((192.0, 173.08, 200.0), abs=0.01)


def test_sequential_bounds_against_published_values() -> None:
    """Lan and DeMets' spending near O'Brien and Fleming's, two-sided 5 %: Jennison and Turnbull, 2000."""
    rule = sequential_plan([20, 40, 60, 80, 100])
    bounds = [float(norm.isf(p / 2)) for p in rule.thresholds]
    assert bounds == pytest.approx([4.8769, 3.3569, 2.6803, 2.2898, 2.0310], abs=2e-3)


def test_pairs_needed_for_a_large_effect() -> None:
    """By simulation of the exact signed-rank test, give or take one or two."""
    assert pairs_needed(AssumedEffect()) == pytest.approx(40, abs=2)
    assert pairs_needed(AssumedEffect(correlation=0.3)) == pytest.approx(27, abs=2)
    assert pairs_needed(AssumedEffect(tests=6)) == pytest.approx(58, abs=2)
    # Noether, "Sample size determination for some common nonparametric tests", JASA 82, 1987: 579
    assert pairs_needed(AssumedEffect(0.56, tests=2)) == pytest.approx(570, abs=15)
    with pytest.raises(ValueError, match="needs more than 1000 pairs of runs"):
        pairs_needed(AssumedEffect(0.54))
    with pytest.raises(ValueError, match=r"a12 must be between 0 and 1 and not 0\.5"):
        pairs_needed(AssumedEffect(a12=0.5))
    with pytest.raises(ValueError, match=r"looks \(20, 20\) must be ascending numbers of pairs"):
        sequential_plan([20, 20])


def test_the_power_is_that_of_the_test_itself() -> None:
    effect, rng = AssumedEffect(0.75, 0.2, tests=2), np.random.default_rng(4)
    spread = (2 * (1 - effect.correlation)) ** 0.5
    told = sum(signed_rank(rng.normal(effect.shift, spread, 20)).p <= 0.025 for _ in range(400))
    assert told / 400 == pytest.approx(power(effect, 20), abs=0.08)


def test_an_interval_of_a12_holds_at_its_edge() -> None:
    """Six pairs of which all, or nearly all, are won: the percentile bootstrap's [1, 1] held 39 % there."""
    low, high = a12_bounds(1.0, 6)
    assert [float(low), float(high)] == pytest.approx([0.689, 1.0], abs=0.001)
    value, below, above = a12_interval(BEFORE, AFTER)
    assert below < value < above
    mirrored = a12_interval(AFTER, BEFORE)
    assert [mirrored.low, mirrored.high] == pytest.approx([1 - above, 1 - below])


def test_the_most_that_a_share_may_be_holds_for_every_share() -> None:
    """Rule of three, and 95 % by the binomial itself for whatever share is true."""
    assert share_upper_bound(0, 100) == pytest.approx(0.03, abs=0.001)
    assert share_upper_bound(6, 6) == 1.0
    for of in (6, 20):
        bounds = np.array([share_upper_bound(found, of) for found in range(of + 1)])
        for share in np.linspace(0.01, 0.99, 99):
            assert stats.binom.pmf(np.arange(of + 1), of, share)[bounds < share].sum() <= 0.05 + 1e-9


PRIMARY = (("chapter", "none"), ("auction", "chapter"))
ROWS = pd.read_csv(campaign_rows.ROWS)
FACTOR = f"vary.{campaign_rows.FACTOR}"
SAMPLES = campaign_rows.samples(PRIMARY)
VERDICTS = verdicts(SAMPLES, campaign_rows.study(PRIMARY, 40))


def side(strategy: str, places: int) -> pd.DataFrame:
    chosen = ROWS[(ROWS.strategy == strategy) & (ROWS[FACTOR] == places)]
    return chosen.set_index("seed").sort_index()


def paired(place: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    sample = SAMPLES[place]
    ((_, places),) = sample.variant
    return side(sample.one, places), side(sample.other, places)


@pytest.mark.parametrize("place", range(4))
def test_estimates_are_those_of_pandas_and_scipy(place: int) -> None:
    one, other = paired(place)
    found = comparison_of(SAMPLES[place], METRICS["places"])
    assert found.difference is not None
    gains = one.places_done - other.places_done
    assert (found.ones, found.others) == pytest.approx((one.places_done.mean(), other.places_done.mean()))
    assert (found.better, found.worse) == ((gains > 0).sum(), (gains < 0).sum())
    bounds = DescrStatsW(gains).tconfint_mean()
    assert found.difference == pytest.approx((gains.mean(), *bounds))
    u = stats.mannwhitneyu(one.places_done, other.places_done).statistic
    assert found.effect.value == pytest.approx(u / len(one) / len(other), abs=1e-14)
    columns = {"contacts": "contacts", "radio": "radio_bytes_per_robot_s", "driven": "driven_m"}
    for name, column in columns.items():
        cost = comparison_of(SAMPLES[place], METRICS[name])
        assert cost.difference is not None
        assert cost.difference.value == pytest.approx((one[column] - other[column]).mean())
        assert cost.effect.value == pytest.approx(
            1 - stats.mannwhitneyu(one[column], other[column]).statistic / len(one) / len(other)
        )


@pytest.mark.parametrize("strategy", ["none", "chapter", "auction"])
@pytest.mark.parametrize("places", [2, 6])
def test_restricted_means_are_the_areas_under_lifelines_curves(strategy: str, places: int) -> None:
    rows = side(strategy, places)
    curve = KaplanMeierFitter().fit(rows.settled_s.fillna(rows.simulated_s), rows.settled_s.notna())
    runs = [
        Completion(length if np.isnan(at) else at, not np.isnan(at))
        for at, length in zip(rows.settled_s, rows.simulated_s, strict=True)
    ]
    until = float(ROWS.simulated_s.max())
    area = restricted_mean_survival_time(curve, t=until)
    assert restricted_mean(runs, until).value == pytest.approx(area)
    sample = next(one for one in SAMPLES if one.variant[0][1] == places and strategy in one[:2])
    found = comparison_of(sample, METRICS["settled"])
    assert (found.ones if sample.one == strategy else found.others) == pytest.approx(area)


def test_holm_s_correction_is_that_of_statsmodels() -> None:
    tested = [step for one in VERDICTS for step in one.steps if step.tested]
    adjusted = multipletests([step.test.p for step in tested], method="holm")[1]
    assert [step.adjusted for step in tested] == pytest.approx(adjusted)
    assert len(tested) >= 3


def test_equivalence_is_near_to_that_of_two_t_tests() -> None:
    """The same null hypothesis and another test: near to one another for 40 pairs."""
    for verdict in VERDICTS:
        for step in verdict.steps:
            found = scores(step.definition, step.sample.pairs)
            if step.happened and step.margin is not None and found.gains.std() > 0:
                p, *_ = ttost_paired(found.ones, found.others, -step.margin, step.margin)
                assert step.equivalence_p == pytest.approx(p, abs=0.1)
