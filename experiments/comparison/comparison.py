"""Every pair of strategies by every metric, over the seeds that both have ended, in one variant."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from experiments.campaign.trial_record import TrialRecord
from experiments.comparison import metrics
from experiments.comparison.metrics import Metric, TimeMetric
from experiments.statistics.effect_size import Interval, a12, difference_of, interval
from experiments.statistics.hypothesis_tests import Significance, holm, rank_sum, signed_rank
from experiments.statistics.survival import Completion, log_rank, restricted_mean, restricted_means
from observation.results.result import RunResult

Floats = NDArray[np.float64]
FEWEST: Final = 6
"""Pairs below which no signed-rank test can reach 5 %, two-sided: 2 / 2^5 is more."""
_LEXICOGRAPHIC_SAYS: Final = "more places done, and of as many the earlier completion (rank)"
_SUMMARIES: Final = {
    "mean": lambda values: np.mean(values, axis=-1),
    "median": lambda values: np.median(values, axis=-1),
    "90 % quantile": lambda values: np.quantile(values, 0.9, axis=-1),
}


class PairedSample(NamedTuple):
    """Two strategies in one variant, seed by seed."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
    pairs: tuple[tuple[RunResult, RunResult], ...]


@dataclass(frozen=True)
class Comparison:
    """One metric of one pair of strategies."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
    metric: str
    says: str
    pairs: int
    ones: float
    """Median of `one`; for times the restricted mean over the run's length."""
    others: float
    effect: Interval
    """A12: the probability that `one` is better than `other`, ties counted half, with its 95 % interval."""
    differences: Mapping[str, Interval]
    """Of `one` less `other`, by what summarizes them."""
    tests: tuple[Significance, ...]
    """The first is the one that counts."""
    adjusted: tuple[float, ...] = ()
    """The tests' p-values after Holm, over all tests of the same report."""

    @property
    def differ(self) -> bool:
        """True if the test that counts says so, all others considered."""
        return bool(self.adjusted) and self.adjusted[0] < 0.05


def samples(records: Iterable[TrialRecord], primary: Sequence[tuple[str, str]] = ()) -> list[PairedSample]:
    """Every pair of strategies in every variant, with the seeds that both have a result for.

    The `primary` pairs come first, in their own order and each the way round that it was declared.
    """
    runs: dict[tuple[tuple[str, Any], ...], dict[str, dict[int, RunResult]]] = {}
    for record in records:
        if record.result is not None:
            variant = tuple((key, _frozen(value)) for key, value in record.variant.items())
            runs.setdefault(variant, {}).setdefault(record.strategy, {})[record.seed] = record.result
    names = dict.fromkeys(name for strategies in runs.values() for name in strategies)
    declared = {frozenset(pair) for pair in primary}
    others = [pair for pair in itertools.combinations(names, 2) if frozenset(pair) not in declared]
    return [
        _sample(one, other, variant, strategies[one], strategies[other])
        for pairs in (primary, others)
        for variant, strategies in runs.items()
        for one, other in pairs
        if one in strategies and other in strategies
    ]


def _sample(
    one: str,
    other: str,
    variant: tuple[tuple[str, Any], ...],
    mine: Mapping[int, RunResult],
    theirs: Mapping[int, RunResult],
) -> PairedSample:
    return PairedSample(
        one, other, variant, tuple((mine[seed], theirs[seed]) for seed in mine if seed in theirs)
    )


def compare(found: Sequence[PairedSample], only: str | None = None) -> list[Comparison]:
    """All comparisons of samples with enough pairs, adjusted for there being so many.

    `only`: the metric of that name alone.
    """
    made = [
        comparison
        for sample in found
        if len(sample.pairs) >= FEWEST
        for comparison in _comparisons(sample, only)
    ]
    adjusted = iter(holm([test.p for comparison in made for test in comparison.tests]))
    return [replace(one, adjusted=tuple(itertools.islice(adjusted, len(one.tests)))) for one in made]


def _comparisons(sample: PairedSample, only: str | None) -> Iterator[Comparison]:
    """By every metric, or by that name only; the chapter's first, then ours, then what it costs."""
    ways: dict[str, Callable[[], Comparison]] = {
        metrics.PLACES.name: lambda: _of_values(sample, metrics.PLACES),
        **{time.name: partial(_of_times, sample, time) for time in metrics.TIMES},
        metrics.LEXICOGRAPHIC: lambda: _lexicographic(sample),
    }
    for metric in metrics.METRICS:
        if any(math.isnan(metric.value(run)) for pair in sample.pairs for run in pair):
            continue
        ways.setdefault(metric.name, partial(_of_values, sample, metric))
    for name, way in ways.items():
        if only is None or name == only:
            yield way()


def _of_values(sample: PairedSample, metric: Metric) -> Comparison:
    ones, others = ([metric.value(pair[side]) for pair in sample.pairs] for side in (0, 1))
    good, bad = scores(metric.name, sample.pairs)
    return Comparison(
        one=sample.one, other=sample.other, variant=sample.variant,
        metric=metric.name, says=metric.says, pairs=len(ones),
        ones=float(np.median(ones)), others=float(np.median(others)),
        effect=interval(good, bad, a12, paired=True),
        differences={
            name: interval(ones, others, difference_of(summary), paired=True)
            for name, summary in _SUMMARIES.items()
        },
        tests=(signed_rank(ones, others), rank_sum(ones, others)),
    )  # fmt: skip


def _of_times(sample: PairedSample, metric: TimeMetric) -> Comparison:
    """Runs that were not done by their end count as done later than all that were."""
    horizon = max(run.simulated_s for pair in sample.pairs for run in pair)
    ones, others = ([_completion(pair[side], metric) for pair in sample.pairs] for side in (0, 1))
    early, late = scores(metric.name, sample.pairs)

    def mean(places: Floats, runs: Sequence[Completion]) -> Floats:
        """Restricted means of samples of `runs`, given by their places along the last axis."""
        return restricted_means(runs, horizon, places.astype(np.int64))

    places = np.arange(len(ones), dtype=np.float64)
    return Comparison(
        one=sample.one, other=sample.other, variant=sample.variant,
        metric=metric.name, says=metric.says, pairs=len(ones),
        ones=restricted_mean(ones, horizon), others=restricted_mean(others, horizon),
        effect=interval(early, late, a12, paired=True),
        differences={
            "restricted mean": interval(
                places, places, lambda a, b: mean(a, ones) - mean(b, others), paired=True, resamples=500
            )
        },
        tests=(log_rank(ones, others), signed_rank(early, late)),
    )  # fmt: skip


def scores(metric: str, pairs: Sequence[tuple[RunResult, RunResult]]) -> tuple[list[float], list[float]]:
    """A number for each run of the pairs, greater for a better one, by the metric of this name.

    For times and the lexicographic order these are ranks. ValueError for a metric that there is not.
    """
    for one in metrics.METRICS:
        if one.name == metric:
            sign = 1.0 if one.more_is_better else -1.0
            ones, others = ([sign * one.value(pair[side]) for pair in pairs] for side in (0, 1))
            return ones, others
    for time in metrics.TIMES:
        if time.name == metric:
            done = [[_completion(pair[side], time) for pair in pairs] for side in (0, 1)]
            early, late = ([-run.at if run.done else -np.inf for run in runs] for runs in done)
            return _ranked(early, late)
    if metric == metrics.LEXICOGRAPHIC:
        keys = [[metrics.lexicographic_key(pair[side]) for pair in pairs] for side in (0, 1)]
        order = {key: place for place, key in enumerate(sorted({*keys[0], *keys[1]}))}
        ones, others = ([float(order[key]) for key in side] for side in keys)
        return ones, others
    raise ValueError(f"there is no metric {metric!r}")


def _lexicographic(sample: PairedSample) -> Comparison:
    ones, others = scores(metrics.LEXICOGRAPHIC, sample.pairs)
    return Comparison(
        one=sample.one, other=sample.other, variant=sample.variant,
        metric=metrics.LEXICOGRAPHIC, says=_LEXICOGRAPHIC_SAYS, pairs=len(ones),
        ones=float(np.median(ones)), others=float(np.median(others)),
        effect=interval(ones, others, a12, paired=True), differences={},
        tests=(signed_rank(ones, others), rank_sum(ones, others)),
    )  # fmt: skip


def _completion(run: RunResult, metric: TimeMetric) -> Completion:
    at = metric.at(run)
    return Completion(run.simulated_s, False) if at is None else Completion(at, True)


def _ranked(one: Sequence[float], other: Sequence[float]) -> tuple[list[float], list[float]]:
    """The values' ranks among all of them, which are finite."""
    ranks = rankdata([*one, *other]).tolist()
    return ranks[: len(one)], ranks[len(one) :]


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
