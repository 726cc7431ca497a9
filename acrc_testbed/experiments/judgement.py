"""Results of a campaign in sentences: failures, verdicts, estimates, effects over random cells."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.experiments import comparison, store
from acrc_testbed.experiments.comparison import (
    PLACES,
    Comparison,
    PairedSample,
    StrategyRuns,
    TimeMetric,
    compare,
    horizon,
    runs_by_variant,
    samples,
    too_few_pairs,
    values,
)
from acrc_testbed.experiments.paired_tests import LEAST_PAIRS, most
from acrc_testbed.experiments.statistical_models import FEWEST_CELLS, RandomEffectsFit, fit
from acrc_testbed.experiments.store import Store
from acrc_testbed.experiments.study import Study, Variant
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.experiments.verdicts import (
    PairVerdict,
    Watch,
    tests_of,
    verdicts,
)
from acrc_testbed.results.result import RunResult
from actors.runtime.errors import AcrcError

_MAP: Final = "map"


class AcrossCells(NamedTuple):
    """Places of one strategy less those of another with the same seed, over all cells."""

    one: str
    other: str
    fitted: RandomEffectsFit | None
    """None with fewer than three cells that have runs of both, or too few pairs."""
    cells: int
    without: dict[str, float] = {}  # noqa: RUF012
    """Mean difference without each map in turn; empty if there is but one."""

    @property
    def turning(self) -> list[str]:
        """The maps without which the difference has the other sign, or none; empty where all has none."""
        whole = 0.0 if self.fitted is None else self.fitted.mean.value
        return [name for name, difference in self.without.items() if whole and difference * whole <= 0]

    def builtins(self) -> dict[str, object]:
        """Return it for JSON, with its sentences."""
        return self._asdict() | {
            "fitted": None if self.fitted is None else asdict(self.fitted),
            "without": [{"map": name, "difference": one} for name, one in self.without.items()],
            "says": across_sentences(self),
        }


class _Differences(NamedTuple):
    """Differences in places between two strategies, by cell, seed and map; each (n,)."""

    places: NDArray[np.float64]
    cells: NDArray[np.int64]
    seeds: NDArray[np.int64]
    maps: NDArray[np.str_]

    def mean(self, chosen: NDArray[np.bool_]) -> float:
        """Return that of the model; of too few cells for it the mean of theirs."""
        places, cells = self.places[chosen], self.cells[chosen]
        names = np.unique(cells)
        if len(names) >= FEWEST_CELLS:
            return fit(places, cells, self.seeds[chosen]).mean.value
        return float(np.mean([places[cells == cell].mean() for cell in names]))


def across_cells(records: Iterable[TrialRecord], study: Study) -> list[AcrossCells]:
    """Estimate every declared comparison over all cells; none of a study with fewer than three cells.

    A cell is a combination of all factors, random or not.
    """
    if len(study.variants()) < FEWEST_CELLS:
        return []
    runs = runs_by_variant(records, study)
    return [_across(one, other, runs, study) for one, other in study.primary_pairs]


def _across(one: str, other: str, runs: Mapping[Variant, StrategyRuns], study: Study) -> AcrossCells:
    found = _differences(one, other, runs, study)
    cells = len(np.unique(found.cells))
    if cells < FEWEST_CELLS or len(found.places) < LEAST_PAIRS:
        return AcrossCells(one, other, None, cells)
    maps = list(dict.fromkeys(found.maps.tolist()))
    without = {name: found.mean(found.maps != name) for name in maps} if len(maps) > 1 else {}
    return AcrossCells(one, other, fit(found.places, found.cells, found.seeds), cells, without)


def _differences(one: str, other: str, runs: Mapping[Variant, StrategyRuns], study: Study) -> _Differences:
    rows = []
    for cell, (variant, by_strategy) in enumerate(runs.items()):
        mine, theirs = by_strategy.get(one, {}), by_strategy.get(other, {})
        for seed in (seed for seed in mine if seed in theirs):
            ours, others = values(PLACES, (mine[seed], theirs[seed]), 0.0)
            rows.append((ours - others, cell, seed, _map(variant, study)))
    places, cells, seeds, maps = zip(*rows, strict=True) if rows else ((), (), (), ())
    return _Differences(
        np.array(places, np.float64),
        np.array(cells, np.int64),
        np.array(seeds, np.int64),
        np.array(maps, np.str_),
    )


def _map(variant: Variant, study: Study) -> str:
    """Return the study's name of the map of a variant; empty if the map does not vary."""
    for factor in (*study.factors, *study.random):
        for key, value in variant:
            if key == factor.key and _MAP in dict(factor.settings(value)):
                return str(value) if factor.levels else Path(str(value)).stem
    return ""


def across_sentences(found: AcrossCells) -> list[str]:
    """Return estimates over all cells in sentences that can be quoted."""
    name, fitted = f"{found.one} less {found.other}", found.fitted
    if fitted is None:
        return [
            f"{name} over all cells: {found.cells} have runs of both; at least {FEWEST_CELLS} with "
            f"{LEAST_PAIRS} pairs of runs are needed before anything is said of cells."
        ]
    mean, new = fitted.mean, fitted.new_cell
    told = [
        f"{name} over all {fitted.cells} cells, {fitted.values} pairs: {mean.value:+.3g} places "
        f"[{mean.low:+.3g}, {mean.high:+.3g}]; standard deviation {_spreads(fitted)}. "
        f"A new cell of this kind, with as many seeds, would show {new.low:+.3g} to {new.high:+.3g} (95 %)."
    ]
    if fitted.rest is not None and fitted.between_cells == 0.0:
        told.append(
            "The fit is singular: cells differ no more than chance makes them, so the variance between them "
            f"comes to 0. {fitted.cells} cells do not show that; both intervals may be too narrow."
        )
    if found.without:
        told.append(_leaving_out(found, level=mean.value == 0.0))
    return told


def _spreads(fitted: RandomEffectsFit) -> str:
    if fitted.rest is None:
        return f"{fitted.between_cells:.3g} between cells, each of one pair, so chance of the runs is in it"
    seeds = "" if fitted.between_seeds is None else f"{fitted.between_seeds:.3g} between seeds, "
    return f"{fitted.between_cells:.3g} between cells, {seeds}{fitted.rest:.3g} of what is left"


def _leaving_out(found: AcrossCells, *, level: bool) -> str:
    (least, lowest), *_, (most, highest) = sorted(found.without.items(), key=itemgetter(1))
    turns = ", ".join(f"{name} ({found.without[name]:+.3g})" for name in found.turning)
    holds = "there is no direction." if level else "the direction holds."
    return (
        f"Without each of {len(found.without)} maps in turn: {lowest:+.3g} (without {least}) to "
        f"{highest:+.3g} (without {most}); "
        + (f"the direction does not hold without {turns}." if turns else holds)
    )


_MOST_SEEDS: Final = 10
_MUCH: Final = 2.0
"""So many times as large as the typical gain makes a typical loss a large one."""


def summaries(records: Iterable[TrialRecord]) -> Iterator[str]:
    """A line for each strategy in each variant, over the runs that came to an end."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for record in records:
        where = "".join(f", {key} = {value}" for key, value in record.variant.items())
        if record.result is not None:
            groups.setdefault((where, record.strategy), []).append(record.result)
    for (where, strategy), runs in groups.items():
        complete = sum(run.completion_s is not None for run in runs)
        yield (
            f"{strategy}{where}: all places in {complete} of {len(runs)} runs,"
            f" {sum(run.places_done or 0 for run in runs)} of {sum(run.places_total for run in runs)} places,"
            f" {sum(run.places_given_up for run in runs)} given up,"
            f" {sum(run.places_lost for run in runs)} lost,"
            f" {sum(run.contacts or 0 for run in runs)} contacts{_half(runs)}"
        )


def _half(runs: Sequence[RunResult]) -> str:
    """When half of the runs were settled; nothing where fewer ever were, which no median can tell."""
    settled = sorted(run.settled_s for run in runs if run.settled_s is not None)
    half = (len(runs) + 1) // 2
    return f", half of them settled by {settled[half - 1]:.1f} s" if len(settled) >= half else ""


def failures(records: Iterable[TrialRecord], study: Study) -> list[str]:
    """How many runs of each strategy failed, and what they count as."""
    runs: dict[str, int] = {}
    failed: dict[str, list[int]] = {}
    for record in records:
        runs[record.strategy] = runs.get(record.strategy, 0) + 1
        if record.result is None:
            failed.setdefault(record.strategy, []).append(record.seed)
    counts = "each counts as a run that did no place and was never settled"
    if study.failed_runs == "left out":
        counts = (
            "each is left out with its pair, as the study declares, "
            "which favours strategies that fail on hard seeds"
        )
    return [
        f"{strategy} failed in {len(seeds)} of {runs[strategy]} runs ({_seeds(seeds)}); {counts}"
        for strategy, seeds in failed.items()
    ]


def _seeds(seeds: Sequence[int]) -> str:
    several = sorted(set(seeds))
    more = ", …" if len(several) > _MOST_SEEDS else ""
    return f"seed{'s' if len(several) > 1 else ''} {', '.join(map(str, several[:_MOST_SEEDS]))}{more}"


def too_few(samples: Sequence[PairedSample], least: int = LEAST_PAIRS) -> list[str]:
    """Return what to say of each pair of strategies of which nothing is tested or estimated."""
    return [
        f"{one.name}: {too_few_pairs(len(one.pairs), least)}" for one in samples if len(one.pairs) < least
    ]


def family(verdicts: Sequence[PairVerdict], study: Study) -> list[str]:
    """How the primary comparisons are tested; nothing where there is none."""
    if not study.primary_pairs:
        return ["No comparison was declared, so nothing is tested; all that follows is exploration."]
    if not verdicts:
        return []
    if any(step.threshold is not None for one in verdicts for step in one.steps):
        return [
            f"Declared: {_counted(len(verdicts), 'comparison')}, looked at on the way; "
            f"{_counted(tests_of(study), 'test')} share the 5 %."
        ]
    steps = [step for one in verdicts for step in one.steps]
    able = sum(step.tested for step in steps)
    rest = len(steps) - able
    return [
        f"Declared: {_counted(len(verdicts), 'comparison')}, {_counted(len(steps), 'test')}; "
        f"{able} can decide, with 5 % in all by Holm's correction"
        + (f"; {rest} cannot, because too few pairs differ." if rest else ".")
    ]


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


def verdict(one: PairVerdict) -> str:
    """What a primary comparison comes to, step by step, with estimates, intervals and p-values."""
    if not one.steps:
        return f"{one.sample.name}: none of the looks has come, so nothing is said yet."
    said: list[str] = []
    for place, step in enumerate(one.steps):
        said.append(_step(step))
        if step.differs:
            break
        after = one.steps[place + 1 :]
        if after and not step.equivalent:
            margin = "" if step.margin is None else f" within {_amount(step.margin, step)}"
            said.append(f"They are not shown to be equal{margin}, so time does not decide.")
            break
        if after and not after[0].happened:
            said.append(f"Time decides nothing: {_nothing(after[0])}.")
            break
        said += ["So time decides:"] * bool(after)
    return " ".join(said)


def _amount(value: float, step: Comparison) -> str:
    return f"{value:.4g} {'place' if value == 1 and step.unit == 'places' else step.unit}"


def _step(step: Comparison) -> str:
    by = f"by {step.says}{step.sample.where}"
    if not step.happened:
        return f"{step.one} and {step.other} cannot be compared {by}: {_nothing(step)}."
    told = numbers(step) if step.is_estimated else f"{len(step.sample.pairs)} pairs"
    if step.differs:
        return f"{_difference(step, by)}: {told}, {_p(step)}."
    if step.equivalent:
        return (
            f"{step.one} is as good as {step.other} {by}, within {_amount(step.margin or 0.0, step)}: "
            f"{told}, p = {step.equivalence_p:.2g} for equivalence; {_beyond(step)}."
        )
    if not step.tested:
        differing = f"{step.test.differing} of {len(step.sample.pairs)} pairs differ"
        return (
            f"{step.one} cannot be told from {step.other} {by}, whatever the effect, as {differing} and "
            f"a test needs {step.fewest}: {told}."
        )
    return f"{step.one} cannot be told from {step.other} {by}: {told}, {_p(step)}."


def _beyond(step: Comparison) -> str:
    """Say how many pairs differ by more than the margin, which equal means can hide."""
    gains = step.scores.gains
    beyond = int((np.abs(gains) > (step.margin or 0.0)).sum())
    bound = most(beyond, gains.size)
    return f"{beyond} of {gains.size} seeds differ by more, so that of all up to {100 * bound:.0f} % may"


def _nothing(step: Comparison) -> str:
    metric = comparison.named(step.metric)
    if not isinstance(metric, TimeMetric):
        return "it is unknown of every pair"
    until = horizon([run for pair in step.sample.pairs for run in pair])
    return f"no run was {metric.event} by {until:g} s"


def _difference(step: Comparison, by: str) -> str:
    """Say who is better by the test that decided; where the mean or A12 disagrees, both sides."""
    side = step.test.direction
    gains = side * step.scores.gains
    better, worse = ("better", "worse") if side > 0 else ("worse", "better")
    if gains.mean() > 0 and side * (step.effect.value - 0.5) > 0:
        return f"{step.one} is {better} than {step.other} {by}"
    for_it, against = gains[gains > 0], -gains[gains < 0]
    typical, counter = (float(np.median(one)) if one.size else 0.0 for one in (for_it, against))
    much = "much " if counter >= _MUCH * typical else ""
    return (
        f"{step.one} beside {step.other} {by}: {better} on {for_it.size} of {gains.size} seeds"
        f" (median {_amount(typical, step)}), {much}{worse} on {against.size}"
        f" (median {_amount(counter, step)}); test and effect disagree"
    )


def numbers(one: Comparison) -> str:
    """Return means, their difference, on how many seeds which is better, and A12, with intervals."""
    equal = one.pairs - one.better - one.worse
    seeds = f"better on {one.better} of {one.pairs} seeds, worse on {one.worse}, equal on {equal}"
    effect = f"A12 = {one.effect.value:.2f} [{one.effect.low:.2f}, {one.effect.high:.2f}]"
    if one.difference is None:
        return f"{seeds}, {effect}"
    value, low, high = one.difference
    return (
        f"{one.ones:.4g} against {one.others:.4g}, difference {value:+.3g} {one.unit} "
        f"[{low:+.3g}, {high:+.3g}], {seeds}, {effect}"
    )


def _p(step: Comparison) -> str:
    if step.threshold is not None:
        sign = "at most" if step.differs else "above"
        return f"p = {step.test.p:.2g}, {sign} {step.threshold:.2g}, after {len(step.sample.pairs)} pairs"
    return f"p = {step.test.p:.2g}, after Holm {step.adjusted:.2g}"


@dataclass(frozen=True)
class CampaignJudgement:
    """What is to be said of a campaign, and nothing that was not declared is tested."""

    failures: Sequence[str]
    """A sentence for each strategy that failed in some run."""
    declared: Sequence[str]
    """What was frozen before the first run, and what is not as frozen."""
    too_few: Sequence[str]
    family: Sequence[str]
    """How the declared comparisons are tested."""
    verdicts: Sequence[PairVerdict]
    """Of the declared comparisons, in their order."""
    looks: Sequence[PairVerdict]
    """The declared comparisons at their last interim looks; empty if there was none."""
    across: Sequence[AcrossCells]
    """The declared comparisons over all cells; empty with fewer than three."""
    estimates: Sequence[Comparison]
    """Of every pair by every metric, the declared pairs first."""

    def sentences(self) -> list[str]:
        """All of it in words, but for the estimates."""
        return [
            *(f"{line}." for line in self.failures),
            *self.declared,
            *self.too_few,
            *self.family,
            *map(verdict, self.verdicts),
            *(line for one in self.across for line in across_sentences(one)),
        ]


def judge(kept: Store, only: str | None = None) -> CampaignJudgement:
    """Judge what of a campaign has ended; `only`: estimates of the metric of that name alone.

    A campaign that was looked at on its way is judged by its looks. Raises AcrcError for a damaged record.
    """
    study, records = kept.study, list(kept.records())
    found = samples(records, study)
    watch = Watch(kept) if kept.looks is not None else None
    looks = [] if watch is None else watch.looked_at()
    least = LEAST_PAIRS if watch is None else watch.rules.least
    decided = verdicts(found, study) if watch is None else looks
    decided = [one for one in decided if len(one.sample.pairs) >= least]
    estimates, few = compare(found, only, least), too_few(found, least)
    if only is not None and found and not estimates and not few:
        raise AcrcError(f"metric {only!r}: known of fewer than {least} pairs of runs; choose another")
    return CampaignJudgement(
        failures=failures(records, study),
        declared=store.plan_sentences(kept),
        too_few=few,
        family=family(decided, study) if len(study.strategies) > 1 else [],
        verdicts=decided,
        looks=looks,
        across=across_cells(records, study),
        estimates=estimates,
    )
