"""Metrics, paired samples and estimates with intervals for each pair of strategies; coinciding runs."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.experiments.paired_tests import (
    LEAST_PAIRS,
    Interval,
    a12_interval,
    mean_interval,
)
from acrc_testbed.experiments.study import Study, Variant
from acrc_testbed.experiments.trial_record import TrialRecord, coincide_s
from acrc_testbed.results.outcome import means
from acrc_testbed.results.result import RunResult

Run = RunResult | None
"""Result of a run; None: it failed, so that it did no place and never settled."""


@dataclass(frozen=True)
class Metric:
    """One number of a run, of which the mean over runs is told."""

    name: str
    says: str
    """What it is."""
    unit: str
    value: Callable[[RunResult], float | None]
    """None: unknown of this run."""
    more_is_better: bool


@dataclass(frozen=True)
class TimeMetric:
    """When something was the case, if it was by the run's end; the mean over runs is restricted to that."""

    name: str
    says: str
    event: str
    """What a run is once it is the case."""
    at: Callable[[RunResult], float | None]
    """s; None: not by the end."""
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
"""`last_reached_s` is none of them: it rewards a run that gives up early."""
LEXICOGRAPHIC: Final = "lexicographic"
"""The order of docs/model-problem.md: more places done, and of as many the shorter running time."""
NAMES: Final = (*(one.name for one in METRICS), *(one.name for one in TIMES), LEXICOGRAPHIC)
ORDER: Final = (PLACES.name, *(one.name for one in TIMES), LEXICOGRAPHIC, *(one.name for one in METRICS[1:]))
"""In which metrics are shown: the chapter's first, then what it costs."""
_BY_NAME: Final = {one.name: one for one in (*METRICS, *TIMES)}
_OWN: Final = "outcome."
"""Prefix of a result of the strategy's own."""
CHOICE: Final = f"one of {', '.join(NAMES)} or {_OWN}NAME, of a strategy's own result"


def is_metric(name: str) -> bool:
    """Return whether runs can be compared by the metric of this name."""
    return name in NAMES or (name.startswith(_OWN) and name != _OWN)


def named(name: str) -> Metric | TimeMetric:
    """Return the metric of this name; of a strategy's own result, `outcome.NAME`, more counts as better."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    own = name.removeprefix(_OWN)
    return Metric(name, name, "", lambda run: means(run.outcome).get(own), more_is_better=True)


def horizon(runs: Sequence[Run]) -> float:
    """Until when these runs of one scenario were watched, s; a run ends sooner once nothing is left to do."""
    return max((run.simulated_s for run in runs if run is not None), default=0.0)


def values(metric: Metric | TimeMetric, runs: Sequence[Run], until: float) -> list[float]:
    """A number for each run; of times the horizon `until` where it was not the case by then."""
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
    """The place of each run in the lexicographic order, equal for equal ones; more is better."""
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
    """Two strategies in one variant, seed by seed, and of each seed cell by cell."""

    one: str
    other: str
    variant: Variant
    pairs: tuple[tuple[Run, Run], ...]
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
            of_strategy[record.seed] = record.result
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
        for one in _comparisons(sample, [only] if only is not None else ORDER)
    ]


def _comparisons(sample: PairedSample, names: Sequence[str]) -> Iterator[Comparison]:
    for name in names:
        made = estimate(sample, name)
        if made is not None:
            yield made


def scores(metric: Metric | TimeMetric, pairs: Sequence[tuple[Run, Run]]) -> Scores:
    """A metric of the pairs in which it is known of both runs."""
    runs = [run for pair in pairs for run in pair]
    found = np.array(values(metric, runs, horizon(runs))).reshape(-1, 2)
    known = found[~np.isnan(found).any(axis=1)]
    if isinstance(metric, Metric):
        return Scores(known[:, 0], known[:, 1], 1 if metric.more_is_better else -1, True)
    return Scores(
        known[:, 0], known[:, 1], -1, any(run is not None and metric.at(run) is not None for run in runs)
    )


def estimate(sample: PairedSample, name: str) -> Comparison | None:
    """Return one metric of a sample, or None if it is known of fewer than LEAST_PAIRS."""
    says, unit, in_order = _LEXICOGRAPHIC_SAYS, "", name == LEXICOGRAPHIC
    if in_order:
        order = np.array(ranks([run for pair in sample.pairs for run in pair]))
        found = Scores(order[::2], order[1::2], 1, True)
    else:
        metric = named(name)
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


_FEW: Final = 4
"""Combinations of which each is told by itself."""


@dataclass(frozen=True)
class Coincidence:
    """Two strategies in one variant, over the seeds that both have a run of."""

    one: str
    other: str
    variant: tuple[tuple[str, Any], ...]
    seconds: tuple[int, ...]
    """For each seed, for how many whole seconds from the start on all robots were in the same places."""
    whole: tuple[int, ...]
    """Seeds whose two runs are the same from beginning to end."""

    @property
    def half_s(self) -> int:
        """So many seconds coincide in at least half of the pairs."""
        return sorted(self.seconds, reverse=True)[(len(self.seconds) - 1) // 2]

    @property
    def sharing(self) -> int:
        """How many pairs coincide for that long."""
        return sum(seconds >= self.half_s for seconds in self.seconds)


def coincidences(records: Iterable[TrialRecord]) -> list[Coincidence]:
    """Of every two strategies in every variant; failed runs have none."""
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
) -> Coincidence:
    seeds = [seed for seed in mine if seed in theirs]
    return Coincidence(
        one,
        other,
        variant,
        tuple(coincide_s(mine[seed], theirs[seed]) for seed in seeds),
        tuple(seed for seed in seeds if mine[seed] == theirs[seed]),
    )


def coincidence_sentences(found: Sequence[Coincidence]) -> list[str]:
    """A sentence for each, and one more where whole runs coincide; many combinations have one together."""
    pairs: dict[tuple[str, str], list[Coincidence]] = {}
    for one in found:
        pairs.setdefault((one.one, one.other), []).append(one)
    lines: list[str] = []
    for same in pairs.values():
        lines += _together(same) if len(same) > _FEW else [line for one in same for line in _alone(one)]
    return lines


def _alone(one: Coincidence) -> Iterator[str]:
    where = "".join(f", {key} = {value}" for key, value in one.variant)
    yield (
        f"{one.one} and {one.other}{where}: the first {one.half_s} s of {one.sharing} of"
        f" {len(one.seconds)} pairs coincide ({_range(one.seconds)})"
    )
    if one.whole:
        seeds = ", ".join(map(str, one.whole[:10])) + (" …" if len(one.whole) > 10 else "")
        yield f"    {len(one.whole)} from beginning to end, so they tell no difference: seeds {seeds}"


def _together(same: Sequence[Coincidence]) -> Iterator[str]:
    """All combinations of two strategies in one sentence."""
    seconds = [second for one in same for second in one.seconds]
    name = f"{same[0].one} and {same[0].other}, in {len(same)} combinations"
    yield f"{name}: {len(seconds)} pairs coincide at first ({_range(seconds)})"
    whole = [one for one in same if one.whole]
    if whole:
        most = max(whole, key=lambda one: len(one.whole))
        where = ", ".join(f"{key} = {value}" for key, value in most.variant)
        count = sum(len(one.whole) for one in whole)
        yield (
            f"    {count} from beginning to end, so they tell no difference, in {len(whole)} combinations;"
            f" most ({len(most.whole)}) with {where}"
        )


def _range(seconds: Sequence[int]) -> str:
    return f"least {min(seconds)} s, median {median(seconds):g} s, most {max(seconds)} s"
