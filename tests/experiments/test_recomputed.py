"""What is said of a campaign that was really run, recomputed by other libraries from its rows alone."""

import numpy as np
import pandas as pd
import pytest
from lifelines import KaplanMeierFitter
from lifelines.utils import restricted_mean_survival_time
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.weightstats import DescrStatsW, ttost_paired

from experiments.comparison import metrics
from experiments.comparison.comparison import Scores, estimate, scores
from experiments.comparison.family import ComparedMetric, verdicts
from experiments.comparison.metrics import named
from experiments.statistics.paired_tests import mean_interval
from experiments.statistics.survival import Completion, restricted_mean
from tests.experiments import campaign_rows

DRAWS = 60_000
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


def test_the_rows_have_what_makes_comparisons_hard() -> None:
    """Ties, ceilings, runs that never settled, and places that are never the same."""
    share_settled = ROWS.groupby(["strategy", FACTOR]).settled_s.agg(lambda times: times.notna().mean())
    assert share_settled.min() == 0 and share_settled.max() >= 0.5
    assert (ROWS.places_done == ROWS.places_total).mean() > 0.1
    assert len(ROWS) == 3 * 2 * 40 and ROWS.failure.isna().all()


@pytest.mark.parametrize("place", range(4))
def test_estimates_are_those_of_pandas_and_scipy(place: int) -> None:
    one, other = paired(place)
    found = estimate(SAMPLES[place], "places")
    assert found is not None and found.ones is not None and found.difference is not None
    gains = one.places_done - other.places_done
    assert (found.ones, found.others) == pytest.approx((one.places_done.mean(), other.places_done.mean()))
    assert (found.better, found.worse) == ((gains > 0).sum(), (gains < 0).sum())
    bounds = DescrStatsW(gains).tconfint_mean()
    assert found.difference == pytest.approx((gains.mean(), *bounds))
    u = stats.mannwhitneyu(one.places_done, other.places_done).statistic
    assert found.effect.value == pytest.approx(u / len(one) / len(other), abs=1e-14)
    for name, column in (
        ("contacts", "contacts"),
        ("radio", "radio_bytes_per_robot_s"),
        ("driven", "driven_m"),
    ):
        cost = estimate(SAMPLES[place], name)
        assert cost is not None and cost.difference is not None
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
    found = estimate(sample, "settled")
    assert found is not None
    assert (found.ones if sample.one == strategy else found.others) == pytest.approx(area)


def flipped(step: ComparedMetric, found: Scores) -> float:
    """The p-value of the step's statistic under draws of signs, by scipy; with its own rounding."""
    gains = found.gains
    sizes = np.abs(gains)
    if step.metric == metrics.PLACES.name:
        sizes = np.where(gains == 0, 0.0, stats.rankdata(sizes))
    drawn = stats.permutation_test(
        (np.sign(gains) * sizes,), lambda one, axis: one.sum(axis=axis), permutation_type="samples",
        n_resamples=DRAWS, batch=20_000, rng=np.random.default_rng(1), vectorized=True,
    )  # fmt: skip
    return float(drawn.pvalue)


def test_p_values_are_those_of_scipy_s_permutations_and_holm_s_those_of_statsmodels() -> None:
    steps = [step for one in VERDICTS for step in one.steps]
    for step in steps:
        if step.happened:
            p = flipped(step, scores(named(step.metric), step.sample.pairs))
            assert step.test.p == pytest.approx(p, abs=5 * np.sqrt(p * (1 - p) / DRAWS) + 2e-5)
    tested = [step for step in steps if step.tested]
    adjusted = multipletests([step.test.p for step in tested], method="holm")[1]
    assert [step.adjusted for step in tested] == pytest.approx(adjusted)
    assert len(tested) >= 3


def test_equivalence_is_near_to_that_of_two_t_tests() -> None:
    """The same null hypothesis and another test: near to one another for 40 pairs."""
    for verdict in VERDICTS:
        for step in verdict.steps:
            found = scores(named(step.metric), step.sample.pairs)
            if step.happened and step.margin is not None and found.gains.std() > 0:
                p, *_ = ttost_paired(found.ones, found.others, -step.margin, step.margin)
                assert step.equivalence_p == pytest.approx(p, abs=0.1)


def test_the_interval_of_a_mean_holds_on_real_differences() -> None:
    """Of 20 of the 40 real differences, drawn: 95 %, less what ceilings and ties cost."""
    rng = np.random.default_rng(4)
    for place in range(4):
        one, other = paired(place)
        gains = (one.places_done - other.places_done).to_numpy(np.float64)
        if not gains.std():
            continue
        held = [
            low <= gains.mean() <= high
            for _, low, high in (mean_interval(rng.choice(gains, 20)) for _ in range(100))
        ]
        assert np.mean(held) >= 0.85
