"""Tests of the declared comparisons: multiplicity, interim looks, and power from a pilot."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from statistics import quantiles
from typing import Any, Final

import numpy as np
from numpy.random import Generator

from acrc_testbed.experiments.comparison import (
    Comparison,
    PairedSample,
    comparison_of,
    samples,
    too_few_pairs_sentence,
)
from acrc_testbed.experiments.metrics import is_full, known_values
from acrc_testbed.experiments.paired_tests import (
    ALPHA,
    MIN_PAIRS,
    SequentialPlan,
    decidable,
    equivalence_p,
    fewest_differing,
    holm,
    mean_test,
    sequential_plan,
    signed_rank,
)
from acrc_testbed.experiments.store import Store
from acrc_testbed.experiments.study import Study, Trial
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.results.result import RunResult
from actors.array_types import Int64s
from actors.runtime.errors import AcrcError
from actors.task.task import Metric


@dataclass(frozen=True)
class PairVerdict:
    """Verdict on a primary comparison in one variant."""

    sample: PairedSample
    steps: tuple[Comparison, ...]
    """Comparisons by each metric, in the order of decision; empty before the first interim look."""
    looks: tuple[Comparison, ...] = ()
    """Step evaluated at each interim look."""
    at_cap: bool = False
    """True at the last interim look, with the maximum number of pairs."""

    @property
    def deciding(self) -> Comparison | None:
        """First step with a significant difference, if all earlier steps show equivalence."""
        step = next((one for one in self.steps if one.differs or not one.equivalent), None)
        return step if step is not None and step.differs else None

    @property
    def equivalent(self) -> bool:
        """True if every step shows equivalence."""
        return bool(self.steps) and all(step.equivalent and not step.differs for step in self.steps)

    @property
    def is_decided(self) -> bool:
        """True if decided, so that no more pairs are needed."""
        return self.deciding is not None or self.equivalent

    @property
    def label(self) -> str:
        """Result for the first strategy: "better", "worse", "equivalent" or "undecided"."""
        if self.deciding is not None:
            return "better" if self.deciding.test.direction > 0 else "worse"
        return "equivalent" if self.equivalent else "undecided"


def family_size(study: Study) -> int:
    """Return the size of the family: one test per step, primary pair and fixed variant."""
    return len(study.primary_pairs) * len(study.fixed_variants()) * len(study.step_metrics())


def planned_pairs(study: Study) -> int:
    """Return the number of pairs in each test of a complete campaign."""
    return study.seeds * max(len(study.cells), 1)


def primary_samples(found: Sequence[PairedSample], study: Study) -> list[PairedSample]:
    """Return the samples of declared comparisons."""
    declared = set(study.primary_pairs)
    return [sample for sample in found if (sample.one, sample.other) in declared]


def verdicts(found: Sequence[PairedSample], study: Study) -> list[PairVerdict]:
    """Return verdicts on the primary comparisons after all runs, adjusted by Holm's method."""
    metrics = study.step_metrics()
    raw = [metric_test(sample, metric) for sample in primary_samples(found, study) for metric in metrics]
    testable = decidable([one.test.differing for one in raw])
    adjusted = iter(holm([one.test.p for one, is_testable in zip(raw, testable, strict=True) if is_testable]))
    steps = [
        replace(
            one,
            tests=sum(testable) + (not is_testable),
            tested=is_testable,
            adjusted=(p := next(adjusted) if is_testable else 1.0),
            differs=p <= ALPHA,
            equivalent=one.equivalence_p <= ALPHA,
        )
        for one, is_testable in zip(raw, testable, strict=True)
    ]
    by_sample = zip(*[iter(steps)] * len(metrics), strict=True)
    return [PairVerdict(of_sample[0].sample, of_sample) for of_sample in by_sample]


def metric_test(sample: PairedSample, metric: Metric) -> Comparison:
    """Compute the tests of one metric of a sample, without a decision."""
    found = comparison_of(sample, metric)
    if not found.happened:
        return found
    gains = np.round(found.scores.gains, 9)  # remove rounding errors, so that equal values are tied
    test = mean_test(gains) if metric.event else signed_rank(gains)
    if metric.margin is None or gains.size < MIN_PAIRS:
        return replace(found, test=test)
    return replace(found, test=test, equivalence_p=equivalence_p(gains, metric.margin))


def power_warnings(study: Study, least: int = MIN_PAIRS) -> list[str]:
    """Return warnings if a study's comparisons cannot become significant; empty otherwise.

    `least`: pairs needed for a verdict.
    """
    if len(study.strategies) < 2:
        return []
    if not study.primary_pairs:
        return [
            "No comparison is declared, so acrc compare will only estimate and not test; "
            "to test, declare primary = [[ONE, OTHER]] in a study"
        ]
    if (pairs := planned_pairs(study)) >= least:
        return []
    return [f"acrc compare will have too little data: {too_few_pairs_sentence(pairs, least)}"]


_FIRST_LOOK: Final = 10
"""Pairs at the first look; fewer rarely decide."""
_MAX_LOOKS: Final = 10


@dataclass(frozen=True)
class StoppingRules:
    """Thresholds of p at the interim looks."""

    differ: SequentialPlan
    """Difference, two-sided; the family's tests share 5 % equally."""
    equivalent: SequentialPlan
    """Equivalence, one-sided."""

    @property
    def least(self) -> int:
        """Pairs needed for a verdict at the last look."""
        return fewest_differing(1, self.differ.thresholds[-1])


def stopping_rules(study: Study) -> StoppingRules:
    """Return rules with a look every 10 pairs, or ten looks. Raises AcrcError without primary comparisons."""
    if not study.primary_pairs:
        raise AcrcError("--until-decided: the study declares no comparison; add primary = [[ONE, OTHER]]")
    cap = planned_pairs(study)
    between = max(_FIRST_LOOK, -(-cap // _MAX_LOOKS))
    looks = [*range(between, cap, between), cap]
    one_sided = sequential_plan(looks, 2 * ALPHA)
    halved = replace(one_sided, thresholds=tuple(one / 2 for one in one_sided.thresholds))
    return StoppingRules(sequential_plan(looks, ALPHA / family_size(study)), halved)


def interim_verdict(
    sample: PairedSample, study: Study, rules: StoppingRules, *, ended: bool = False
) -> PairVerdict:
    """Evaluate the interim looks due for a sample, until one decides the comparison.

    Decisions are final. `ended`: no more pairs will follow, so the last look uses all pairs, even if fewer
    than planned because failed runs are left out.
    """
    final: dict[str, Comparison] = {}
    evaluated: tuple[Comparison, ...] = ()
    verdict = PairVerdict(sample, (), at_cap=ended)
    due = [pairs for pairs in rules.differ.looks if pairs <= len(sample.pairs)]
    if ended and len(due) < len(rules.differ.looks) and sample.pairs:
        due.append(len(sample.pairs))
    for number, pairs in enumerate(due):
        look = -1 if ended and pairs == len(sample.pairs) else number
        first = sample._replace(pairs=sample.pairs[:pairs])
        steps = [
            final.get(metric.name) or _at_look(first, metric, study, rules, look)
            for metric in study.step_metrics()
        ]
        final |= {one.metric: one for one in steps if one.differs or one.equivalent}
        evaluated += (next((one for one in steps if not one.equivalent or one.differs), steps[-1]),)
        verdict = PairVerdict(first, tuple(steps), evaluated, ended)
        if verdict.is_decided:
            break
    return verdict


def _at_look(
    sample: PairedSample, metric: Metric, study: Study, rules: StoppingRules, look: int
) -> Comparison:
    raw = metric_test(sample, metric)
    threshold = rules.differ.thresholds[look]
    return replace(
        raw,
        tests=family_size(study),
        tested=2.0 ** (1 - raw.test.differing) <= threshold,
        adjusted=raw.test.p,
        differs=raw.test.p <= threshold,
        equivalent=raw.equivalence_p <= rules.equivalent.thresholds[look],
        threshold=threshold,
    )


class InterimAnalysis:
    """Interim analysis of the primary comparisons of a running campaign."""

    def __init__(self, store: Store) -> None:
        """Raise AcrcError for a study without primary comparisons."""
        self._store = store
        self.rules = stopping_rules(store.study)
        store.study.step_metrics()
        self._records: dict[str, TrialRecord] = {}
        self._evaluated_pairs = 0

    def is_decided(self) -> bool:
        """Return whether every primary comparison is decided or has had its last look."""
        ended = len(self._seeds()) * max(len(self._store.study.cells), 1)
        if not any(self._evaluated_pairs < due <= ended for due in self.rules.differ.looks):
            return False
        self._evaluated_pairs = ended
        return all(one.at_cap or one.is_decided for one in self.verdicts())

    def verdicts(self) -> list[PairVerdict]:
        """Return verdicts on all primary comparisons at the last look due."""
        study = self._store.study
        seeds = self._seeds()
        records = [self._record(trial) for seed in seeds for trial in study.trials_of(seed)]
        ended = len(seeds) >= study.seeds
        found = primary_samples(samples(records, study), study)
        return [interim_verdict(sample, study, self.rules, ended=ended) for sample in found]

    def _record(self, trial: Trial) -> TrialRecord:
        """Read a record; cached, as records never change."""
        if trial.name not in self._records:
            self._records[trial.name] = self._store.record(trial)
        return self._records[trial.name]

    def _seeds(self) -> list[int]:
        """Return the leading seeds that have ended for every strategy and variant."""
        study, path = self._store.study, self._store.path
        seeds = range(study.first_seed, study.first_seed + study.seeds)
        return list(takewhile(lambda seed: all(path(one).exists() for one in study.trials_of(seed)), seeds))


def look_sentences(found: Sequence[PairVerdict], rules: StoppingRules) -> list[str]:
    """Return sentences on interim looks and their results."""
    rule = rules.differ
    lines = [
        f"interim looks after {', '.join(map(str, rule.looks))} pairs;"
        f" thresholds of p for a difference {_threshold_text(rule.thresholds)},"
        f" for equivalence {_threshold_text(rules.equivalent.thresholds)}"
    ]
    for one in found:
        text = f"{len(one.sample.pairs)} pairs, no look reached yet"
        if one.looks:
            text = f"{_outcome_text(one)}; {'; '.join(map(_look_text, one.looks))}"
        lines.append(f"{one.sample.name}: {text}")
    return lines


def _outcome_text(one: PairVerdict) -> str:
    after = f"after {len(one.looks[-1].sample.pairs)} pairs"
    if one.deciding is not None:
        return f"decided {after}"
    if one.equivalent:
        return f"equivalent {after}"
    return f"not decided {'at the last look' if one.at_cap else 'yet'}, {after}"


def _look_text(step: Comparison) -> str:
    ahead = {1: f"{step.sample.one} ahead", -1: f"{step.sample.other} ahead", 0: "tied"}
    sign = "≤" if step.differs else ">"
    return (
        f"at {len(step.sample.pairs)} {ahead[step.test.direction]} by {step.metric},"
        f" p = {step.test.p:.2g} {sign} {step.threshold:.2g}"
    )


def _threshold_text(thresholds: Sequence[float]) -> str:
    return ", ".join(f"{one:.2g}" for one in thresholds)


_CAMPAIGNS: Final = 200
"""Simulated campaigns for each size."""
_SIZES: Final = (MIN_PAIRS, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200)
"""Sample sizes, in pairs, for which power is computed."""
_SUGGESTED_ROBOTS: Final = 8
_SUGGESTED_DURATIONS_S: Final = (300.0, 400.0)
"""Range of suggested durations."""


@dataclass(frozen=True)
class PowerEstimate:
    """Estimated power of the declared comparisons at one campaign size."""

    pairs: int
    shares: tuple[float, ...]
    """Power for each comparison and variant, with seeds resampled from the pilot."""
    cautious: tuple[float, ...]
    """The same with the pilot itself resampled, which adds its uncertainty."""


def power_estimates(found: Sequence[PairedSample], study: Study, power: float) -> Iterator[PowerEstimate]:
    """Yield estimates for increasing sizes, until the cautious power of each comparison suffices, or at 200.

    Bootstraps the pilot's seeds, each with all its runs, and tests as `acrc compare`. Deterministic. The
    pilot must have a pair of each comparison.
    """
    declared = primary_samples(found, study)
    for pairs in _SIZES:
        shares, cautious = (
            simulated_power(declared, study, pairs, np.random.default_rng(1), cautious=one)
            for one in (False, True)
        )
        estimate = PowerEstimate(pairs, shares, cautious)
        yield estimate
        if min(*estimate.shares, *estimate.cautious) >= power:
            return


def simulated_power(
    declared: Sequence[PairedSample],
    study: Study,
    pairs: int,
    rng: Generator,
    campaigns: int = _CAMPAIGNS,
    *,
    cautious: bool = False,
) -> tuple[float, ...]:
    """Return the share of simulated campaigns of `pairs` pairs that decide each declared comparison.

    `cautious`: resample the pilot for each campaign, too.
    """
    known = min(len(sample.pairs) for sample in declared)
    counts = np.zeros(len(declared))
    for _ in range(campaigns):
        seeds = rng.integers(known, size=known) if cautious else np.arange(known)
        drawn = select_pairs(declared, seeds[rng.integers(known, size=pairs)])
        counts += [one.deciding is not None for one in verdicts(drawn, study)]
    return tuple((counts / campaigns).tolist())


def select_pairs(samples: Sequence[PairedSample], indices: Int64s) -> list[PairedSample]:
    """Return the samples restricted to the pairs at these indices."""
    chosen = indices.tolist()
    return [one._replace(pairs=tuple(one.pairs[index] for index in chosen)) for one in samples]


def ceiling_sentences(records: Iterable[TrialRecord], study: Study) -> Iterator[str]:
    """Yield a sentence for each variant in which at least half of the runs have a metric's maximum."""
    runs: dict[str, tuple[dict[str, Any], list[RunResult]]] = {}
    for record in records:
        if record.result is not None:
            runs.setdefault(repr(record.variant), (record.variant, []))[1].append(record.result)
    metrics = study.metrics().values()
    events = [one for one in metrics if one.event]
    for variant, results in runs.values():
        where = "".join(f" with {key} = {value}" for key, value in variant.items())
        for metric in metrics:
            full = [run for run in results if is_full(metric, run)]
            if 2 * len(full) >= len(results):
                done = known_values(events[0], full) if events else []
                yield (
                    f"{len(full)} of {len(results)} runs{where} have the largest possible value of "
                    f"{metric.description} (ceiling effect). Use a harder condition, such as "
                    f"{_harder_condition(results, done)}."
                )


def _harder_condition(results: list[RunResult], done: list[float]) -> str:
    """Return a suggestion: more robots, or a duration below the first quartile of the times of events."""
    least, most = _SUGGESTED_DURATIONS_S
    changes = [f"--robots {_SUGGESTED_ROBOTS}"] if results[0].robots < _SUGGESTED_ROBOTS else []
    if done:
        quarter = quantiles(done, n=4)[0] if len(done) > 1 else done[0]
        seconds = min(max(round(quarter, -1), least), most)
        if seconds < max(result.simulated_s for result in results):
            changes.append(f"--duration {seconds:g}")
    return " and ".join(changes) or "more robots or longer ways"
