"""Metrics, paired samples, estimates with intervals, and identical starts of runs."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.experiments.paired_tests import (
    LEAST_PAIRS,
    NO_TEST,
    Interval,
    PairedTest,
    a12_interval,
    fewest_differing,
    mean_interval,
)
from acrc_testbed.experiments.study import Study, Variant
from acrc_testbed.experiments.trial_record import TrialRecord, identical_seconds
from acrc_testbed.results.outcome import outcome_means
from acrc_testbed.results.result import RunResult

Run = RunResult | None
"""Result of a run; None: failed, counted as no places done and never settled."""


@dataclass(frozen=True)
class Metric:
    """A number of a run, summarised by the mean over runs."""

    name: str
    says: str
    unit: str
    value: Callable[[RunResult], float | None]
    """None: unknown."""
    more_is_better: bool


@dataclass(frozen=True)
class TimeMetric:
    """Time of an event, if it happened in the run; summarised by the restricted mean over runs."""

    name: str
    says: str
    event: str
    """State of a run after the event."""
    at: Callable[[RunResult], float | None]
    """s; None: not before the end."""
    unit: str = "s"


PLACES: Final = Metric("places", "places done", "places", lambda run: run.places_done, True)
METRICS: Final = (
    PLACES,
    Metric("contacts", "contacts", "contacts", lambda run: run.contacts, False),
    Metric(
        "radio",
        "octets on the air per robot and second",
        "octets/s",
        lambda run: run.radio_bytes_per_robot_s,
        False,
    ),
    Metric("driven", "metres driven by all robots", "m", lambda run: run.driven_m, False),
)
SETTLED: Final = TimeMetric("settled", "running time", "done or given up", lambda run: run.settled_s)
TIMES: Final = (SETTLED, TimeMetric("completion", "time to complete", "done", lambda run: run.completion_s))
"""Without `last_reached_s`, which rewards giving up early."""
LEXICOGRAPHIC: Final = "lexicographic"
"""More places done is better; at equal places the shorter running time (docs/model-problem.md)."""
NAMES: Final = (*(one.name for one in METRICS), *(one.name for one in TIMES), LEXICOGRAPHIC)
ORDER: Final = (PLACES.name, *(one.name for one in TIMES), LEXICOGRAPHIC, *(one.name for one in METRICS[1:]))
"""Order of display: the chapter's metrics, then costs."""
_BY_NAME: Final = {one.name: one for one in (*METRICS, *TIMES)}
_OWN: Final = "outcome."
"""Prefix of values returned by a strategy's outcome()."""
CHOICE: Final = f"one of {', '.join(NAMES)} or {_OWN}NAME, a value returned by outcome()"


def is_metric(name: str) -> bool:
    """Return whether a metric of this name exists."""
    return name in NAMES or (name.startswith(_OWN) and name != _OWN)


def named(name: str) -> Metric | TimeMetric:
    """Return the metric of this name; for `outcome.NAME`, more is better."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    own = name.removeprefix(_OWN)
    return Metric(name, name, "", lambda run: outcome_means(run.outcome).get(own), more_is_better=True)


def horizon(runs: Sequence[Run]) -> float:
    """Return the observation time of runs of one scenario, s: the longest run."""
    return max((run.simulated_s for run in runs if run is not None), default=0.0)


def values(metric: Metric | TimeMetric, runs: Sequence[Run], until: float) -> list[float]:
    """Return a value for each run; times are capped at the horizon `until`."""
    if isinstance(metric, Metric):
        failed = 0.0 if metric is PLACES else math.nan
        found = (None if run is None else metric.value(run) for run in runs)
        return [
            failed if run is None else math.nan if value is None else float(value)
            for run, value in zip(runs, found, strict=True)
        ]
    times = (None if run is None else metric.at(run) for run in runs)
    return [until if at is None else min(at, until) for at in times]


def ranks(runs: Sequence[Run]) -> list[float]:
    """Return the rank of each run in the lexicographic order, with ties; more is better."""
    keys = [
        (0, -math.inf, False)
        if run is None
        else (run.places_done or 0, -math.inf if run.settled_s is None else -run.settled_s, True)
        for run in runs
    ]
    order = {key: float(place) for place, key in enumerate(sorted(set(keys)))}
    return [order[key] for key in keys]


Floats = NDArray[np.float64]
StrategyRuns = dict[str, dict[int, Run]]
"""By strategy and seed."""
_LEXICOGRAPHIC_SAYS = "places done, then running time"


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
        text = f" with {', '.join(f'{key} = {value}' for key, value in self.variant)}" if self.variant else ""
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
    metric: str
    scores: Scores
    margin: float | None = None
    """Equivalence margin in the metric's unit; None: none declared."""
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
        return _LEXICOGRAPHIC_SAYS if self.metric == LEXICOGRAPHIC else named(self.metric).says

    @property
    def unit(self) -> str:
        """Unit of the metric; empty if it has none."""
        return "" if self.metric == LEXICOGRAPHIC else named(self.metric).unit

    @property
    def happened(self) -> bool:
        """True if the metric is known for a pair, and a timed event happened in a run."""
        return self.scores.happened and self.scores.ones.size > 0

    @property
    def is_estimated(self) -> bool:
        """True if the metric is known for enough pairs to estimate."""
        return self.pairs >= LEAST_PAIRS

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
        """Mean of `other`, likewise."""
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
        variant = tuple((key, _frozen(value)) for key, value in record.variant.items())
        of_strategy = runs.setdefault(variant, {}).setdefault(record.strategy, {})
        if record.result is not None or counts:
            of_strategy[record.seed] = record.result
    return runs


def samples(records: Iterable[TrialRecord], study: Study | None = None) -> list[PairedSample]:
    """Return every pair of strategies in every variant, with the seeds that both have.

    The study's primary pairs come first, as declared. Random cells are pooled into one variant.
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
    """Return a sentence that explains why so few pairs are not evaluated."""
    return (
        f"{pairs} pairs of runs are too few: the exact test needs at least {least} to reach p < 5 %. "
        "Nothing is tested or estimated."
    )


def compare(
    found: Sequence[PairedSample], only: str | None = None, least: int = LEAST_PAIRS
) -> list[Comparison]:
    """Estimate every metric, or `only` one, of samples with at least `least` pairs."""
    made = (
        comparison_of(sample, name)
        for sample in found
        if len(sample.pairs) >= least
        for name in ([only] if only is not None else ORDER)
    )
    return [one for one in made if one.is_estimated]


def comparison_of(sample: PairedSample, name: str) -> Comparison:
    """Return the estimates of one metric of a sample, without a test."""
    if name == LEXICOGRAPHIC:
        order = np.array(ranks([run for pair in sample.pairs for run in pair]))
        return Comparison(sample, name, Scores(order[::2], order[1::2], 1))
    return Comparison(sample, name, scores(named(name), sample.pairs))


def scores(metric: Metric | TimeMetric, pairs: Sequence[tuple[Run, Run]]) -> Scores:
    """Return a metric of the pairs in which it is known for both runs."""
    runs = [run for pair in pairs for run in pair]
    found = np.array(values(metric, runs, horizon(runs))).reshape(-1, 2)
    ones, others = found[~np.isnan(found).any(axis=1)].T
    if isinstance(metric, Metric):
        return Scores(ones, others, 1 if metric.more_is_better else -1)
    return Scores(ones, others, -1, any(run is not None and metric.at(run) is not None for run in runs))


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


_FEW: Final = 4
"""Variants up to which each has its own sentence."""


@dataclass(frozen=True)
class IdenticalStart:
    """Identical starts of the runs of two strategies in one variant."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
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
    """Compare every two strategies in every variant; failed runs are left out."""
    traces: dict[str, tuple[tuple[tuple[str, Any], ...], dict[str, dict[int, str]]]] = {}
    for record in records:
        if record.trace:
            variant = tuple(record.variant.items())
            _, by_strategy = traces.setdefault(repr(variant), (variant, {}))
            by_strategy.setdefault(record.strategy, {})[record.seed] = record.trace
    return [
        _coincidence(one, other, variant, mine, theirs)
        for variant, strategies in traces.values()
        for (one, mine), (other, theirs) in combinations(strategies.items(), 2)
        if mine.keys() & theirs.keys()
    ]


def _coincidence(
    one: str, other: str, variant: tuple[tuple[str, Any], ...], mine: dict[int, str], theirs: dict[int, str]
) -> IdenticalStart:
    seeds = [seed for seed in mine if seed in theirs]
    return IdenticalStart(
        one,
        other,
        variant,
        tuple(identical_seconds(mine[seed], theirs[seed]) for seed in seeds),
        tuple(seed for seed in seeds if mine[seed] == theirs[seed]),
    )


def identical_start_sentences(found: Sequence[IdenticalStart]) -> list[str]:
    """Return sentences on identical starts, summarised for pairs with many variants."""
    pairs: dict[tuple[str, str], list[IdenticalStart]] = {}
    for one in found:
        pairs.setdefault((one.one, one.other), []).append(one)
    lines: list[str] = []
    for same in pairs.values():
        lines += _summary(same) if len(same) > _FEW else [line for one in same for line in _alone(one)]
    return lines


def _alone(one: IdenticalStart) -> Iterator[str]:
    where = "".join(f", {key} = {value}" for key, value in one.variant)
    yield (
        f"{one.one} and {one.other}{where}: {one.sharing} of {len(one.seconds)} pairs are identical for the "
        f"first {one.half_s} s or longer ({_range(one.seconds)})"
    )
    if one.whole:
        seeds = ", ".join(map(str, one.whole[:10])) + (" …" if len(one.whole) > 10 else "")
        yield f"    {len(one.whole)} are identical throughout and show no difference: seeds {seeds}"


def _summary(same: Sequence[IdenticalStart]) -> Iterator[str]:
    """Summarise all variants of two strategies."""
    seconds = [second for one in same for second in one.seconds]
    name = f"{same[0].one} and {same[0].other}, in {len(same)} variants"
    yield f"{name}: identical start of {len(seconds)} pairs ({_range(seconds)})"
    whole = [one for one in same if one.whole]
    if whole:
        most = max(whole, key=lambda one: len(one.whole))
        where = ", ".join(f"{key} = {value}" for key, value in most.variant)
        count = sum(len(one.whole) for one in whole)
        yield (
            f"    {count} are identical throughout and show no difference, in {len(whole)} variants;"
            f" most ({len(most.whole)}) with {where}"
        )


def _range(seconds: Sequence[int]) -> str:
    return f"minimum {min(seconds)} s, median {median(seconds):g} s, maximum {max(seconds)} s"
