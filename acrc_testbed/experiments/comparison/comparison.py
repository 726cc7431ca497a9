"""Every pair of strategies by every metric: estimates with intervals, over the seeds that both have ended."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.experiments.campaign.trial_record import TrialRecord
from acrc_testbed.experiments.comparison import metrics
from acrc_testbed.experiments.comparison.metrics import JudgedRun, Metric, TimeMetric, horizon, judged
from acrc_testbed.experiments.statistics.paired_tests import (
    LEAST_PAIRS,
    Interval,
    a12_interval,
    mean_interval,
)
from acrc_testbed.experiments.study.study import Study, Variant

Floats = NDArray[np.float64]
StrategyRuns = dict[str, dict[int, JudgedRun]]
"""By strategy and seed."""
_LEXICOGRAPHIC_SAYS = "places done, then running time"


class PairedSample(NamedTuple):
    """Two strategies in one variant, seed by seed, and of each seed cell by cell."""

    one: str
    other: str
    variant: Variant
    pairs: tuple[tuple[JudgedRun, JudgedRun], ...]
    cells: int = 1
    """In so many the study has drawn."""

    @property
    def where(self) -> str:
        """The variant in words; empty if there is but one."""
        told = f" with {', '.join(f'{key} = {value}' for key, value in self.variant)}" if self.variant else ""
        return f"{told} over {self.cells} cells" if self.cells > 1 else told


class Scores(NamedTuple):
    """A metric of both runs of each pair in which it is known."""

    ones: Floats
    others: Floats
    sign: int
    """1: more is better; -1: less is."""
    happened: bool
    """False: a time at which nothing happened in any run."""

    @property
    def gains(self) -> Floats:
        """How much better the first run of each pair is."""
        return self.sign * (self.ones - self.others)


@dataclass(frozen=True)
class Comparison:
    """One metric of one pair of strategies, without any claim."""

    one: str
    other: str
    variant: Variant
    metric: str
    says: str
    unit: str
    pairs: int
    better: int
    """Pairs in which `one` is better."""
    worse: int
    ones: float | None
    """Mean of `one`, of times restricted to the run's length; None for the lexicographic order."""
    others: float | None
    difference: Interval | None
    """The mean over pairs of `one` less `other`, with its 95 % interval."""
    effect: Interval
    """A12: the probability that `one` is better than `other`, ties counted half, with its 95 % interval."""


def runs_by_variant(records: Iterable[TrialRecord], study: Study | None) -> dict[Variant, StrategyRuns]:
    """The runs of each variant. One that failed has done nothing, or is left out, as the study declares."""
    counts = study is None or study.failed_runs == "worst"
    runs: dict[Variant, StrategyRuns] = {}
    for record in records:
        variant = tuple((key, _frozen(value)) for key, value in record.variant.items())
        of_strategy = runs.setdefault(variant, {}).setdefault(record.strategy, {})
        if record.result is not None or counts:
            of_strategy[record.seed] = judged(record.result)
    return runs


def samples(records: Iterable[TrialRecord], study: Study | None = None) -> list[PairedSample]:
    """Every pair of strategies in every variant, with the seeds that both have ended.

    The primary pairs of the study come first, in their own order and each the way round that it was declared.
    Cells that the study has drawn are one variant together.
    """
    primary: Sequence[tuple[str, str]] = () if study is None else study.primary_pairs
    runs: dict[Variant, list[StrategyRuns]] = {}
    names: dict[str, None] = {}
    for variant, of_variant in runs_by_variant(records, study).items():
        runs.setdefault(variant if study is None else study.fixed_part(variant), []).append(of_variant)
        names |= dict.fromkeys(of_variant)
    declared = {frozenset(pair) for pair in primary}
    others = [pair for pair in itertools.combinations(names, 2) if frozenset(pair) not in declared]
    return [
        _sample(one, other, variant, having)
        for pairs in (primary, others)
        for variant, cells in runs.items()
        for one, other in pairs
        if (having := [cell for cell in cells if one in cell and other in cell])
    ]


def _sample(one: str, other: str, variant: Variant, cells: Sequence[StrategyRuns]) -> PairedSample:
    seeds = dict.fromkeys(seed for cell in cells for seed in cell[one])
    pairs = (
        (cell[one][seed], cell[other][seed])
        for seed in seeds
        for cell in cells
        if seed in cell[one] and seed in cell[other]
    )
    return PairedSample(one, other, variant, tuple(pairs), len(cells))


def too_few_pairs(pairs: int, least: int = LEAST_PAIRS) -> str:
    """Return why nothing is said of so few pairs."""
    return (
        f"{pairs} pairs of runs are too few: the exact test needs {least} to reach 5 %, whatever the runs "
        "show. Nothing is tested or estimated."
    )


def compare(
    found: Sequence[PairedSample], only: str | None = None, least: int = LEAST_PAIRS
) -> list[Comparison]:
    """Return all estimates of samples with so many pairs; `only`: of the metric of that name alone."""
    return [
        one
        for sample in found
        if len(sample.pairs) >= least
        for one in _comparisons(sample, [only] if only is not None else metrics.ORDER)
    ]


def _comparisons(sample: PairedSample, names: Sequence[str]) -> Iterator[Comparison]:
    for name in names:
        made = estimate(sample, name)
        if made is not None:
            yield made


def scores(metric: Metric | TimeMetric, pairs: Sequence[tuple[JudgedRun, JudgedRun]]) -> Scores:
    """A metric of the pairs in which it is known of both runs."""
    runs = [run for pair in pairs for run in pair]
    found = np.array(metrics.values(metric, runs, horizon(runs))).reshape(-1, 2)
    known = found[~np.isnan(found).any(axis=1)]
    if isinstance(metric, Metric):
        return Scores(known[:, 0], known[:, 1], 1 if metric.more_is_better else -1, True)
    return Scores(known[:, 0], known[:, 1], -1, any(metric.at(run) is not None for run in runs))


def estimate(sample: PairedSample, name: str) -> Comparison | None:
    """Return one metric of a sample, or None if it is known of fewer than LEAST_PAIRS."""
    says, unit, in_order = _LEXICOGRAPHIC_SAYS, "", name == metrics.LEXICOGRAPHIC
    if in_order:
        order = np.array(metrics.ranks([run for pair in sample.pairs for run in pair]))
        found = Scores(order[::2], order[1::2], 1, True)
    else:
        metric = metrics.named(name)
        says, unit, found = metric.says, metric.unit, scores(metric, sample.pairs)
    if found.ones.size < LEAST_PAIRS:
        return None
    return Comparison(
        one=sample.one,
        other=sample.other,
        variant=sample.variant,
        metric=name,
        says=says,
        unit=unit,
        pairs=found.ones.size,
        better=int((found.gains > 0).sum()),
        worse=int((found.gains < 0).sum()),
        ones=None if in_order else float(found.ones.mean()),
        others=None if in_order else float(found.others.mean()),
        difference=None if in_order else mean_interval(found.ones - found.others),
        effect=a12_interval(found.sign * found.ones, found.sign * found.others),
    )


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value
