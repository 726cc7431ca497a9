"""Results of a campaign: failures, verdicts, estimates, random effects of cells."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from operator import itemgetter
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.experiments.comparison import (
    Comparison,
    PairedSample,
    StrategyRuns,
    compare,
    horizon,
    runs_by_variant,
    samples,
    too_few_pairs_sentence,
)
from acrc_testbed.experiments.metrics import (
    OWN,
    by_rank,
    known_values,
    total_of,
    values,
)
from acrc_testbed.experiments.paired_tests import MIN_PAIRS, share_upper_bound
from acrc_testbed.experiments.statistical_models import MIN_CELLS, RandomEffectsFit, fit
from acrc_testbed.experiments.store import Store, plan_sentences
from acrc_testbed.experiments.study import Study, Variant
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.experiments.verdicts import InterimAnalysis, PairVerdict, family_size, verdicts
from acrc_testbed.results.result import RunResult
from actors.array_types import Flags, Floats, Int64s
from actors.runtime.errors import AcrcError
from actors.task.task import Metric


class OverallEstimate(NamedTuple):
    """Difference in the first ranked metric between two strategies with equal seeds, over all cells."""

    one: str
    other: str
    fitted: RandomEffectsFit | None
    """None with fewer than three cells with runs of both, or too few pairs."""
    cells: int
    metric: str = ""
    """Description of the metric."""
    unit: str = ""
    without: dict[str, float] = {}  # noqa: RUF012
    """Mean difference without each map in turn; empty with a single map."""

    @property
    def sign_changes(self) -> list[str]:
        """Maps without which the difference changes its sign or vanishes; empty if it is 0."""
        overall = 0.0 if self.fitted is None else self.fitted.mean.value
        return [name for name, difference in self.without.items() if overall and difference * overall <= 0]

    def builtins(self) -> dict[str, object]:
        """Return a dictionary for JSON, with sentences."""
        return self._asdict() | {
            "fitted": None if self.fitted is None else asdict(self.fitted),
            "without": [{"map": name, "difference": one} for name, one in self.without.items()],
            "says": overall_sentences(self),
        }


class _Differences(NamedTuple):
    """Differences in a metric between two strategies, by cell, seed and map; each (n,)."""

    values: Floats
    cells: Int64s
    seeds: Int64s
    maps: NDArray[np.str_]

    def mean(self, chosen: Flags) -> float:
        """Return the model's mean; for too few cells the mean of the cells' means."""
        known, cells = self.values[chosen], self.cells[chosen]
        names = np.unique(cells)
        if len(names) >= MIN_CELLS:
            return fit(known, cells, self.seeds[chosen]).mean.value
        return float(np.mean([known[cells == cell].mean() for cell in names]))


def overall_estimates(records: Iterable[TrialRecord], study: Study) -> list[OverallEstimate]:
    """Estimate every declared comparison over all cells; empty with fewer than three cells.

    A cell is a combination of all factors, random or not.
    """
    if len(study.variants()) < MIN_CELLS:
        return []
    runs = runs_by_variant(records, study)
    return [_overall_estimate(one, other, runs, study) for one, other in study.primary_pairs]


def _overall_estimate(
    one: str, other: str, runs: Mapping[Variant, StrategyRuns], study: Study
) -> OverallEstimate:
    metric = by_rank(study.metrics().values())[0]
    differences = _differences(one, other, runs, study, metric)
    cells = len(np.unique(differences.cells))
    estimate = OverallEstimate(one, other, None, cells, metric.description, metric.unit)
    if cells < MIN_CELLS or len(differences.values) < MIN_PAIRS:
        return estimate
    maps = list(dict.fromkeys(differences.maps.tolist()))
    without = {name: differences.mean(differences.maps != name) for name in maps} if len(maps) > 1 else {}
    fitted = fit(differences.values, differences.cells, differences.seeds)
    return estimate._replace(fitted=fitted, without=without)


def _differences(
    one: str, other: str, runs: Mapping[Variant, StrategyRuns], study: Study, metric: Metric
) -> _Differences:
    rows = []
    until = horizon([run for cell in runs.values() for seeds in cell.values() for run in seeds.values()])
    for cell, (variant, by_strategy) in enumerate(runs.items()):
        mine, theirs = by_strategy.get(one, {}), by_strategy.get(other, {})
        for seed in (seed for seed in mine if seed in theirs):
            ours, others = values(metric, (mine[seed], theirs[seed]), until)
            if not math.isnan(ours - others):
                rows.append((ours - others, cell, seed, _map_name(variant, study)))
    found, cells, seeds, maps = zip(*rows, strict=True) if rows else ((), (), (), ())
    return _Differences(
        np.array(found, np.float64),
        np.array(cells, np.int64),
        np.array(seeds, np.int64),
        np.array(maps, np.str_),
    )


def _map_name(variant: Variant, study: Study) -> str:
    """Return the name of a variant's map in the study; empty if the map does not vary."""
    for factor in (*study.factors, *study.random):
        for key, value in variant:
            if key == factor.key and "map" in dict(factor.settings(value)):
                return str(value) if factor.levels else Path(str(value)).stem
    return ""


def overall_sentences(estimate: OverallEstimate) -> list[str]:
    """Return sentences on the estimate over all cells."""
    name, fitted = f"{estimate.one} minus {estimate.other}", estimate.fitted
    if fitted is None:
        return [
            f"{name} over all cells: only {estimate.cells} have runs of both; estimates need at least "
            f"{MIN_CELLS} cells and {MIN_PAIRS} pairs of runs."
        ]
    mean, new = fitted.mean, fitted.new_cell
    difference = f"{mean.value:+.3g} {estimate.unit}".rstrip()
    sentences = [
        f"{name} over all {fitted.cells} cells, {fitted.values} pairs: {difference} "
        f"[{mean.low:+.3g}, {mean.high:+.3g}]; standard deviation {_deviations_text(fitted)}. "
        f"Prediction for a new cell with as many seeds: {new.low:+.3g} to {new.high:+.3g} (95 %)."
    ]
    if fitted.rest is not None and fitted.between_cells == 0.0:
        sentences.append(
            "The fit is singular: cells differ no more than by chance, so the estimated variance between "
            f"them is 0. With only {fitted.cells} cells both intervals may be too narrow."
        )
    if estimate.without:
        sentences.append(_map_sensitivity(estimate, is_zero=mean.value == 0.0))
    return sentences


def _deviations_text(fitted: RandomEffectsFit) -> str:
    if fitted.rest is None:
        return f"{fitted.between_cells:.3g} between cells (one pair each, so it includes the residual)"
    seeds = "" if fitted.between_seeds is None else f"{fitted.between_seeds:.3g} between seeds, "
    return f"{fitted.between_cells:.3g} between cells, {seeds}{fitted.rest:.3g} residual"


def _map_sensitivity(estimate: OverallEstimate, *, is_zero: bool) -> str:
    (least, lowest), *_, (most, highest) = sorted(estimate.without.items(), key=itemgetter(1))
    changes = ", ".join(f"{name} ({estimate.without[name]:+.3g})" for name in estimate.sign_changes)
    unchanged = "there is no direction." if is_zero else "the direction is the same."
    return (
        f"Without each of {len(estimate.without)} maps in turn: {lowest:+.3g} (without {least}) to "
        f"{highest:+.3g} (without {most}); "
        + (f"the direction changes without {changes}." if changes else unchanged)
    )


_MAX_SEEDS: Final = 10
_LARGE_RATIO: Final = 2.0
"""Ratio of typical loss to typical gain above which the loss is called much worse."""


def summary_sentences(records: Iterable[TrialRecord]) -> Iterator[str]:
    """Yield a sentence on the task for each strategy in each variant, over its completed runs."""
    groups: dict[tuple[str, str], list[RunResult]] = {}
    for record in records:
        where = "".join(f", {key} = {value}" for key, value in record.variant.items())
        if record.result is not None:
            groups.setdefault((where, record.strategy), []).append(record.result)
    for (where, strategy), runs in groups.items():
        parts = [text for one in runs[0].declaration.metrics if (text := _summary_text(one, runs))]
        yield f"{strategy}{where}: {', '.join(parts)}, {sum(run.contacts or 0 for run in runs)} contacts"


def _summary_text(metric: Metric, runs: Sequence[RunResult]) -> str:
    """Return a metric of several runs as text; empty for one that is unknown."""
    known = sorted(known_values(metric, runs))
    if metric.event:
        half = (len(runs) + 1) // 2
        by = f", half of the runs by {known[half - 1]:.1f} s" if len(known) >= half else ""
        return f"{metric.event} in {len(known)} of {len(runs)} runs{by}"
    if not known:
        return ""
    if metric.total:
        total = sum(total_of(metric, run) or 0.0 for run in runs)
        return f"{sum(known):g} of {total:g} {metric.description}"
    return f"mean {metric.description} {np.mean(known):.4g}"


def failure_sentences(records: Sequence[TrialRecord], study: Study) -> list[str]:
    """Return sentences on failed runs by strategy and how they count, and on failed metrics."""
    runs = Counter(record.strategy for record in records)
    failed: dict[str, list[int]] = {}
    for record in records:
        if record.result is None:
            failed.setdefault(record.strategy, []).append(record.seed)
    metrics = study.metrics().values()
    decisive = [one for one in metrics if one.rank is not None or one.column.startswith(OWN)]
    worst = (
        f"never {one.event}" if one.worst is None else f"{one.name} = {one.worst:g}"
        for one in decisive
        if one.event or one.worst is not None
    )
    counts = f"each counts as a run with {', '.join(worst) or 'no value'}"
    if study.failed_runs == "left out":
        counts = (
            "each is left out with its pair, as declared in the study; "
            "this favours strategies that fail on hard seeds"
        )
    return [
        *(
            f"{strategy} failed in {len(seeds)} of {runs[strategy]} runs ({_seeds_text(seeds)}); {counts}"
            for strategy, seeds in failed.items()
        ),
        *metric_fault_sentences(records, study),
    ]


def metric_fault_sentences(records: Iterable[TrialRecord], study: Study) -> Iterator[str]:
    """Yield a sentence for each error of a study's own metric, with its trials."""
    found: dict[tuple[str, str], list[str]] = {}
    for record in records:
        variant = "".join(f", {key} = {value}" for key, value in record.variant.items())
        faults = record.result.metric_faults or {} if record.result is not None else {}
        for metric, cause in faults.items():
            trials = found.setdefault((metric, cause), [])
            trials.append(f"{record.strategy} with seed {record.seed}{variant}")
    for (metric, cause), trials in found.items():
        yield (
            f"study {study.name}: metric {metric} failed in {_count_text(len(trials), 'run')}, "
            f"first {trials[0]}: {cause}; it is unknown for these runs, and their pairs are left out of its "
            "comparison"
        )


def _seeds_text(seeds: Sequence[int]) -> str:
    several = sorted(set(seeds))
    more = ", …" if len(several) > _MAX_SEEDS else ""
    return f"seed{'s' if len(several) > 1 else ''} {', '.join(map(str, several[:_MAX_SEEDS]))}{more}"


def too_few_sentences(samples: Sequence[PairedSample], least: int = MIN_PAIRS) -> list[str]:
    """Return a sentence for each pair of strategies with too few pairs of runs."""
    return [
        f"{one.name}: {too_few_pairs_sentence(len(one.pairs), least)}"
        for one in samples
        if len(one.pairs) < least
    ]


def family_sentences(verdicts: Sequence[PairVerdict], study: Study) -> list[str]:
    """Return sentences on the tests of the primary comparisons and their error rate."""
    if not study.primary_pairs:
        return ["No comparison was declared, so nothing is tested; all estimates are exploratory."]
    if not verdicts:
        return []
    steps = [step for one in verdicts for step in one.steps]
    declared = f"Declared: {_count_text(len(verdicts), 'comparison')},"
    if any(step.threshold is not None for step in steps):
        tests = _count_text(family_size(study), "test")
        return [f"{declared} with interim looks; {tests} share the error rate of 5 %."]
    testable = sum(step.tested for step in steps)
    excluded = len(steps) - testable
    return [
        f"{declared} {_count_text(len(steps), 'test')}; "
        f"{testable} can be significant, at a family-wise error rate of 5 % (Holm)"
        + (f"; {excluded} cannot, because too few pairs differ." if excluded else ".")
    ]


def _count_text(count: int, what: str) -> str:
    return f"{count} {what}{'s' if count != 1 else ''}"


def verdict_sentence(one: PairVerdict) -> str:
    """Return the result of a primary comparison as text, with estimates, intervals and p-values."""
    if not one.steps:
        return f"{one.sample.name}: no interim look has been reached yet."
    sentences: list[str] = []
    for index, step in enumerate(one.steps):
        sentences.append(_step_sentence(step))
        if step.differs:
            break
        after = one.steps[index + 1 :]
        if after and not step.equivalent:
            margin = "" if step.margin is None else f" within {_amount_text(step.margin, step)}"
            sentences.append(
                f"Equivalence{margin} is not shown, so they are not compared in {after[0].says}."
            )
            break
        if after and not after[0].happened:
            sentences.append(f"They cannot be compared in {after[0].says}: {_unknown_reason(after[0])}.")
            break
        sentences += [f"Therefore they are compared in {step.says}:" for step in after[:1]]
    return " ".join(sentences)


def _amount_text(value: float, step: Comparison) -> str:
    unit = step.unit
    if value == 1 and unit.isalpha() and len(unit) > 2:
        unit = unit.removesuffix("s")
    return f"{value:.4g} {unit}".rstrip()


def _step_sentence(step: Comparison) -> str:
    by = f"in {step.says}{step.sample.where}"
    if not step.happened:
        return f"{step.one} and {step.other} cannot be compared {by}: {_unknown_reason(step)}."
    estimates = estimate_text(step) if step.is_estimated else f"{len(step.sample.pairs)} pairs"
    if step.differs:
        return f"{_difference_text(step, by)}: {estimates}, {_p_text(step)}."
    if step.equivalent:
        return (
            f"{step.one} and {step.other} are equivalent {by} within "
            f"{_amount_text(step.margin or 0.0, step)}: {estimates}, "
            f"p = {step.equivalence_p:.2g} for equivalence; {_exceeding_text(step)}."
        )
    if not step.tested:
        differing = f"{step.test.differing} of {len(step.sample.pairs)} pairs differ"
        return (
            f"{step.one} and {step.other} were not tested {by}, because only {differing} and "
            f"a test needs {step.fewest}: {estimates}."
        )
    return (
        f"No significant difference between {step.one} and {step.other} {by}: {estimates}, {_p_text(step)}."
    )


def _exceeding_text(step: Comparison) -> str:
    """Return how many pairs differ by more than the margin, which equal means can hide."""
    gains = step.scores.gains
    beyond = int((np.abs(gains) > (step.margin or 0.0)).sum())
    bound = share_upper_bound(beyond, gains.size)
    return (
        f"{beyond} of {gains.size} seeds differ by more (95 % upper bound of the share: {100 * bound:.0f} %)"
    )


def _unknown_reason(step: Comparison) -> str:
    if not step.definition.event or not step.scores.ones.size:
        return "it is unknown for every pair"
    until = horizon([run for pair in step.sample.pairs for run in pair])
    return f"no run was {step.definition.event} by {until:g} s"


def _difference_text(step: Comparison, by: str) -> str:
    """Return which strategy is better by the test; if mean or A12 disagree, both sides."""
    side = step.test.direction
    gains = side * step.scores.gains
    better, worse = ("better", "worse") if side > 0 else ("worse", "better")
    if gains.mean() > 0 and side * (step.effect.value - 0.5) > 0:
        return f"{step.one} is {better} than {step.other} {by}"
    advantages, disadvantages = gains[gains > 0], -gains[gains < 0]
    typical, counter = (float(np.median(one)) if one.size else 0.0 for one in (advantages, disadvantages))
    much = "much " if counter >= _LARGE_RATIO * typical else ""
    return (
        f"{step.one} versus {step.other} {by}: {better} on {advantages.size} of {gains.size} seeds"
        f" (median {_amount_text(typical, step)}), {much}{worse} on {disadvantages.size}"
        f" (median {_amount_text(counter, step)}); test and effect disagree"
    )


def estimate_text(one: Comparison) -> str:
    """Return means, difference, number of better and worse seeds, and A12 as text, with intervals."""
    equal = one.pairs - one.better - one.worse
    seeds = f"better on {one.better} of {one.pairs} seeds, worse on {one.worse}, equal on {equal}"
    effect = f"A12 = {one.effect.value:.2f} [{one.effect.low:.2f}, {one.effect.high:.2f}]"
    if one.difference is None:
        return f"{seeds}, {effect}"
    value, low, high = one.difference
    return (
        f"{one.ones:.4g} versus {one.others:.4g}, difference {value:+.3g} {one.unit}".rstrip()
        + f" [{low:+.3g}, {high:+.3g}], {seeds}, {effect}"
    )


def _p_text(step: Comparison) -> str:
    if step.threshold is not None:
        sign = "at most" if step.differs else "above"
        return f"p = {step.test.p:.2g}, {sign} {step.threshold:.2g}, after {len(step.sample.pairs)} pairs"
    return f"p = {step.test.p:.2g}, Holm-adjusted {step.adjusted:.2g}"


@dataclass(frozen=True)
class CampaignEvaluation:
    """Results of a campaign; only declared comparisons are tested."""

    failures: Sequence[str]
    """Sentences on failed runs, by strategy."""
    declared: Sequence[str]
    """Sentences on the frozen plan and deviations from it."""
    too_few: Sequence[str]
    family: Sequence[str]
    """Sentences on the tests of the declared comparisons."""
    verdicts: Sequence[PairVerdict]
    """Verdicts on the declared comparisons, in their order."""
    looks: Sequence[PairVerdict]
    """Verdicts at the last interim look; empty without interim looks."""
    across: Sequence[OverallEstimate]
    """Declared comparisons over all cells; empty with fewer than three cells."""
    estimates: Sequence[Comparison]
    """Estimates of every pair and metric, the declared pairs first."""

    def sentences(self) -> list[str]:
        """Return everything except the estimates as sentences."""
        return [
            *(f"{line}." for line in self.failures),
            *self.declared,
            *self.too_few,
            *self.family,
            *map(verdict_sentence, self.verdicts),
            *(line for one in self.across for line in overall_sentences(one)),
        ]


def evaluate(store: Store, metric: Metric | None = None) -> CampaignEvaluation:
    """Evaluate the ended trials of a campaign; `metric`: estimate this metric only.

    With interim looks, these decide. Raises AcrcError for a damaged record.
    """
    study, records = store.study, list(store.records())
    found = samples(records, study)
    analysis = InterimAnalysis(store) if store.looks is not None else None
    looks = [] if analysis is None else analysis.verdicts()
    least = MIN_PAIRS if analysis is None else analysis.rules.least
    judged = verdicts(found, study) if analysis is None else looks
    judged = [one for one in judged if len(one.sample.pairs) >= least]
    metrics = study.metrics().values() if metric is None else (metric,)
    estimates, few = compare(found, metrics, least), too_few_sentences(found, least)
    if metric is not None and found and not estimates and not few:
        raise AcrcError(f"metric {metric.name!r}: known for fewer than {least} pairs of runs; choose another")
    return CampaignEvaluation(
        failures=failure_sentences(records, study),
        declared=plan_sentences(store),
        too_few=few,
        family=family_sentences(judged, study) if len(study.strategies) > 1 else [],
        verdicts=judged,
        looks=looks,
        across=overall_estimates(records, study),
        estimates=estimates,
    )
