"""Paired samples, estimates with intervals, and identical starts of runs."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np

from acrc_testbed.experiments.metrics import (
    LEXICOGRAPHIC,
    Run,
    by_rank,
    ranks,
    task_metrics,
    value_of,
    values,
)
from acrc_testbed.experiments.paired_tests import (
    MIN_PAIRS,
    NO_TEST,
    Interval,
    PairedTest,
    a12_interval,
    fewest_differing,
    mean_interval,
)
from acrc_testbed.experiments.study import Study, Variant, variant_text
from acrc_testbed.experiments.trial_record import TrialRecord, identical_seconds
from actors.array_types import Floats
from actors.task.task import Metric


def horizon(runs: Sequence[Run]) -> float:
    """Return the observation time of runs of one scenario, s: the longest run."""
    return max((run.simulated_s for run in runs if run is not None), default=0.0)


StrategyRuns = dict[str, dict[int, Run]]
"""By strategy and seed."""


class PairedSample(NamedTuple):
    """Paired runs of two strategies in one variant, by seed and cell."""

    one: str
    other: str
    variant: Variant
    pairs: tuple[tuple[Run, Run], ...]
    cells: int = 1
    """Number of random cells with runs of both."""

    @property
    def where(self) -> str:
        """Variant and cells as text; empty for a single variant."""
        text = f" with {variant_text(self.variant)}" if self.variant else ""
        return f"{text} over {self.cells} cells" if self.cells > 1 else text

    @property
    def name(self) -> str:
        """Names of both strategies, with the variant."""
        return f"{self.one} and {self.other}{self.where}"


class Scores(NamedTuple):
    """Values of a metric for the pairs in which it is known."""

    ones: Floats
    others: Floats
    sign: int
    """1: more is better; -1: less is better."""
    happened: bool = True
    """False: a time of an event that happened in no run."""

    @property
    def gains(self) -> Floats:
        """Advantage of the first run of each pair."""
        return self.sign * (self.ones - self.others)


@dataclass(frozen=True)
class Comparison:
    """Estimates of one metric of a paired sample, and the result of its test if declared."""

    sample: PairedSample
    definition: Metric
    scores: Scores
    test: PairedTest = NO_TEST
    """Test of the gains."""
    equivalence_p: float = 1.0
    tests: int = 1
    """Tests that share the error rate."""
    tested: bool = False
    """False: too few pairs differ for a test."""
    adjusted: float = 1.0
    """Holm-adjusted p-value; unadjusted at an interim look."""
    differs: bool = False
    equivalent: bool = False
    threshold: float | None = None
    """Threshold of p at the last interim look; None: no interim looks."""

    @property
    def metric(self) -> str:
        """Name of the metric."""
        return self.definition.name

    @property
    def margin(self) -> float | None:
        """Equivalence margin in the metric's unit; None: none declared."""
        return self.definition.margin

    @property
    def one(self) -> str:
        """First strategy."""
        return self.sample.one

    @property
    def other(self) -> str:
        """Second strategy."""
        return self.sample.other

    @property
    def variant(self) -> Variant:
        """Values of the study's factors."""
        return self.sample.variant

    @property
    def says(self) -> str:
        """Description of the metric."""
        return self.definition.description

    @property
    def unit(self) -> str:
        """Unit of the metric; empty if it has none."""
        return self.definition.unit

    @property
    def happened(self) -> bool:
        """True if the metric is known for a pair, and a timed event happened in a run."""
        return self.scores.happened and self.scores.ones.size > 0

    @property
    def is_estimated(self) -> bool:
        """True if the metric is known for enough pairs to estimate."""
        return self.pairs >= MIN_PAIRS

    @property
    def pairs(self) -> int:
        """Pairs in which the metric is known."""
        return self.scores.ones.size

    @property
    def better(self) -> int:
        """Pairs in which `one` is better."""
        return int((self.scores.gains > 0).sum())

    @property
    def worse(self) -> int:
        """Pairs in which `one` is worse."""
        return int((self.scores.gains < 0).sum())

    @property
    def ones(self) -> float | None:
        """Mean of `one` (restricted mean for times); None for the lexicographic order."""
        return None if self.metric == LEXICOGRAPHIC else float(self.scores.ones.mean())

    @property
    def others(self) -> float | None:
        """Mean of `other` (restricted mean for times); None for the lexicographic order."""
        return None if self.metric == LEXICOGRAPHIC else float(self.scores.others.mean())

    @cached_property
    def difference(self) -> Interval | None:
        """Mean of `one` minus `other` with its 95 % interval; None for the lexicographic order."""
        if self.metric == LEXICOGRAPHIC:
            return None
        return mean_interval(self.scores.ones - self.scores.others)

    @cached_property
    def effect(self) -> Interval:
        """A12: the probability that `one` is better than `other`, ties counted half, with its interval."""
        ones, others, sign, _ = self.scores
        return a12_interval(sign * ones, sign * others)

    @property
    def fewest(self) -> int:
        """Number of differing pairs below which the test cannot be significant."""
        return fewest_differing(self.tests) if self.threshold is None else fewest_differing(1, self.threshold)

    def estimates(self) -> dict[str, Any]:
        """Return the estimates by name."""
        return {name: getattr(self, name) for name in _ESTIMATES}


_ESTIMATES: Final = (
    "one", "other", "variant", "metric", "says", "unit", "pairs", "better", "worse", "ones", "others",
    "difference", "effect",
)  # fmt: skip


def runs_by_variant(records: Iterable[TrialRecord], study: Study | None) -> dict[Variant, StrategyRuns]:
    """Return the runs of each variant; failed runs are None or left out, as declared in the study."""
    counts = study is None or study.failed_runs == "worst"
    runs: dict[Variant, StrategyRuns] = {}
    for record in records:
        variant = tuple((key, _hashable(value)) for key, value in record.variant.items())
        of_strategy = runs.setdefault(variant, {}).setdefault(record.strategy, {})
        if record.result is not None or counts:
            of_strategy[record.seed] = record.result
    return runs


def samples(records: Iterable[TrialRecord], study: Study | None = None) -> list[PairedSample]:
    """Return the paired runs of every two strategies in every variant, for the seeds that both have.

    The study's primary pairs come first, as declared. Random cells are pooled into one variant.
    """
    primary = () if study is None else study.primary_pairs
    runs: dict[Variant, list[StrategyRuns]] = {}
    names: dict[str, None] = {}
    for variant, of_variant in runs_by_variant(records, study).items():
        runs.setdefault(variant if study is None else study.fixed_part(variant), []).append(of_variant)
        names |= dict.fromkeys(of_variant)
    declared = {frozenset(pair) for pair in primary}
    others = [pair for pair in combinations(names, 2) if frozenset(pair) not in declared]
    return [
        _sample(one, other, variant, common_cells)
        for pairs in (primary, others)
        for variant, cells in runs.items()
        for one, other in pairs
        if (common_cells := [cell for cell in cells if one in cell and other in cell])
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


def too_few_pairs_sentence(pairs: int, least: int = MIN_PAIRS) -> str:
    """Return a sentence on a sample with fewer than `least` pairs, which is not evaluated."""
    return (
        f"{pairs} pairs of runs are too few: the exact test needs at least {least} to reach p < 5 %. "
        "Nothing is tested or estimated."
    )


def compare(
    paired: Sequence[PairedSample], metrics: Iterable[Metric], least: int = MIN_PAIRS
) -> list[Comparison]:
    """Estimate the metrics of samples with at least `least` pairs."""
    comparisons = (
        comparison_of(sample, metric) for sample in paired if len(sample.pairs) >= least for metric in metrics
    )
    return [one for one in comparisons if one.is_estimated]


def comparison_of(sample: PairedSample, metric: Metric) -> Comparison:
    """Return the estimates of one metric of a sample, without a test."""
    return Comparison(sample, metric, scores(metric, sample.pairs))


def scores(metric: Metric, pairs: Sequence[tuple[Run, Run]]) -> Scores:
    """Return a metric of the pairs in which it is known for both runs."""
    runs = [run for pair in pairs for run in pair]
    if metric.name == LEXICOGRAPHIC:
        task = next((run.declaration for run in runs if run is not None), None)
        order = np.array(ranks(runs, () if task is None else by_rank(task_metrics(task).values())))
        return Scores(order[::2], order[1::2], 1)
    found = np.array(values(metric, runs, horizon(runs))).reshape(-1, 2)
    ones, others = found[~np.isnan(found).any(axis=1)].T
    happened = not metric.event or any(run is not None and value_of(metric, run) is not None for run in runs)
    return Scores(ones, others, 1 if metric.better == "more" else -1, happened)


def _hashable(value: Any) -> Any:
    return tuple(map(_hashable, value)) if isinstance(value, list) else value


_MAX_LISTED: Final = 4
"""Variants up to which each has its own sentence."""


@dataclass(frozen=True)
class IdenticalStart:
    """Initial seconds in which the runs of two strategies in one variant are identical."""

    one: str
    other: str
    variant: Variant
    seconds: tuple[int, ...]
    """Whole seconds from the start with identical positions of all robots, by seed."""
    whole: tuple[int, ...]
    """Seeds whose two runs are identical throughout."""

    @property
    def half_s(self) -> int:
        """Seconds that are identical in at least half of the pairs."""
        return sorted(self.seconds, reverse=True)[(len(self.seconds) - 1) // 2]

    @property
    def sharing(self) -> int:
        """Number of pairs that are identical for `half_s`."""
        return sum(seconds >= self.half_s for seconds in self.seconds)


def identical_starts(records: Iterable[TrialRecord]) -> list[IdenticalStart]:
    """Return identical starts for each pair of strategies and variant; failed runs are left out."""
    traces: dict[str, tuple[Variant, dict[str, dict[int, str]]]] = {}
    for record in records:
        if record.trace:
            variant = tuple(record.variant.items())
            _, by_strategy = traces.setdefault(repr(variant), (variant, {}))
            by_strategy.setdefault(record.strategy, {})[record.seed] = record.trace
    return [
        IdenticalStart(
            one,
            other,
            variant,
            tuple(identical_seconds(mine[seed], theirs[seed]) for seed in seeds),
            tuple(seed for seed in seeds if mine[seed] == theirs[seed]),
        )
        for variant, strategies in traces.values()
        for (one, mine), (other, theirs) in combinations(strategies.items(), 2)
        if (seeds := [seed for seed in mine if seed in theirs])
    ]


def identical_start_sentences(starts: Sequence[IdenticalStart]) -> list[str]:
    """Return sentences on identical starts, summarised for pairs with many variants."""
    pairs: dict[tuple[str, str], list[IdenticalStart]] = {}
    for one in starts:
        pairs.setdefault((one.one, one.other), []).append(one)
    lines: list[str] = []
    for variants in pairs.values():
        if len(variants) > _MAX_LISTED:
            lines += _summary_sentences(variants)
        else:
            lines += [line for start in variants for line in _variant_sentences(start)]
    return lines


def _variant_sentences(start: IdenticalStart) -> Iterator[str]:
    where = "".join(f", {key} = {value}" for key, value in start.variant)
    yield (
        f"{start.one} and {start.other}{where}: in {start.sharing} of {len(start.seconds)} pairs robots "
        f"move identically for the first {start.half_s} s or longer ({_range_text(start.seconds)})"
    )
    if start.whole:
        seeds = ", ".join(map(str, start.whole[:10])) + (" …" if len(start.whole) > 10 else "")
        yield f"    in {len(start.whole)} until the end (messages may differ): seeds {seeds}"
        if 2 * len(start.whole) > len(start.seconds):
            yield "    use longer runs (--duration) or more robots (--robots), so that more pairs differ"


def _summary_sentences(starts: Sequence[IdenticalStart]) -> Iterator[str]:
    """Summarise all variants of two strategies."""
    seconds = [second for start in starts for second in start.seconds]
    name = f"{starts[0].one} and {starts[0].other}, in {len(starts)} variants"
    yield f"{name}: {len(seconds)} pairs in which robots move identically at first ({_range_text(seconds)})"
    whole = [start for start in starts if start.whole]
    if whole:
        most = max(whole, key=lambda start: len(start.whole))
        where = variant_text(most.variant)
        count = sum(len(start.whole) for start in whole)
        yield (
            f"    {count} of them until the end (messages may differ), in {len(whole)} variants;"
            f" most ({len(most.whole)}) with {where}"
        )


def _range_text(seconds: Sequence[int]) -> str:
    """Return the spread of the identical times over pairs."""
    return f"shortest {min(seconds)} s, median {median(seconds):g} s, longest {max(seconds)} s"
