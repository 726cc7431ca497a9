"""Tests of the declared comparisons: multiplicity control, interim looks, and power from a pilot."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from statistics import quantiles
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from acrc_testbed.experiments import comparison
from acrc_testbed.experiments.comparison import (
    SETTLED,
    Comparison,
    PairedSample,
    TimeMetric,
    comparison_of,
    samples,
    too_few_pairs,
)
from acrc_testbed.experiments.paired_tests import (
    ALPHA,
    LEAST_PAIRS,
    SequentialPlan,
    decidable,
    equivalence_p,
    fewest_differing,
    holm,
    mean_test,
    plan,
    signed_rank,
)
from acrc_testbed.experiments.store import Store
from acrc_testbed.experiments.study import Study, Trial
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.results.result import RunResult
from actors.runtime.errors import AcrcError


@dataclass(frozen=True)
class PairVerdict:
    """Result of a primary comparison in one variant."""

    sample: PairedSample
    steps: tuple[Comparison, ...]
    """The metrics in the order in which they decide; empty before the first interim look."""
    looks: tuple[Comparison, ...] = ()
    """At each interim look the step that was asked."""
    at_cap: bool = False
    """True if it was looked at, and no more pairs will come."""

    @property
    def deciding(self) -> Comparison | None:
        """The first step by which the strategies differ, if they are equivalent by all before it."""
        step = next((one for one in self.steps if one.differs or not one.equivalent), None)
        return step if step is not None and step.differs else None

    @property
    def equivalent(self) -> bool:
        """True if the strategies are as good as each other by every step."""
        return bool(self.steps) and all(step.equivalent and not step.differs for step in self.steps)

    @property
    def settled(self) -> bool:
        """True if more pairs have nothing left to decide."""
        return self.deciding is not None or self.equivalent

    @property
    def word(self) -> str:
        """The first strategy beside the second one: "better", "worse", "as good" or "not told apart"."""
        if self.deciding is not None:
            return "better" if self.deciding.test.direction > 0 else "worse"
        return "as good" if self.equivalent else "not told apart"


def step_names(study: Study) -> tuple[str, ...]:
    """The metrics by which primary comparisons are decided, in order. AcrcError for one that there is not."""
    name = study.primary_metric
    if not comparison.is_metric(name):
        raise AcrcError(f"primary_metric is {name!r}; must be {comparison.CHOICE}")
    return (comparison.PLACES.name, SETTLED.name) if name == comparison.LEXICOGRAPHIC else (name,)


def tests_of(study: Study) -> int:
    """How many tests share the error: one for each step of each primary pair in each fixed variant."""
    return len(study.primary_pairs) * len(study.fixed_variants()) * len(step_names(study))


def pairs_of(study: Study) -> int:
    """How many pairs each test is of, once all runs have ended."""
    return study.seeds * max(len(study.cells), 1)


def primary(found: Sequence[PairedSample], study: Study) -> list[PairedSample]:
    """Those of the samples that the study declared."""
    declared = set(study.primary_pairs)
    return [sample for sample in found if (sample.one, sample.other) in declared]


def verdicts(found: Sequence[PairedSample], study: Study) -> list[PairVerdict]:
    """Judge the primary comparisons among the samples after all runs, by Holm's method over their tests."""
    names = step_names(study)
    raw = [step(sample, name, study) for sample in primary(found, study) for name in names]
    able = decidable([one.test.differing for one in raw])
    adjusted = iter(holm([one.test.p for one, is_able in zip(raw, able, strict=True) if is_able]))
    steps = []
    for one, is_able in zip(raw, able, strict=True):
        p = next(adjusted) if is_able else 1.0
        steps.append(
            replace(
                one,
                tests=sum(able) + (not is_able),
                tested=is_able,
                adjusted=p,
                differs=p <= ALPHA,
                equivalent=one.equivalence_p <= ALPHA,
            )
        )
    count = len(names)
    return [
        PairVerdict(steps[place].sample, tuple(steps[place : place + count]))
        for place in range(0, len(steps), count)
    ]


def step(sample: PairedSample, name: str, study: Study) -> Comparison:
    """Test one metric of a sample, without any decision."""
    if name == comparison.LEXICOGRAPHIC:
        raise ValueError("the order is asked step by step")
    is_time = isinstance(comparison.named(name), TimeMetric)
    margin = study.margin_s if is_time else study.margin_places if name == comparison.PLACES.name else None
    found = replace(comparison_of(sample, name), margin=margin)
    if not found.happened:
        return found
    gains = np.round(found.scores.gains, 9)  # equal decimals are equal, whatever floats make of them
    test = mean_test(gains) if is_time else signed_rank(gains)
    if margin is None or gains.size < LEAST_PAIRS:
        return replace(found, test=test)
    return replace(found, test=test, equivalence_p=equivalence_p(gains, margin))


def foreseen(study: Study, least: int = LEAST_PAIRS) -> list[str]:
    """Return what is known before a study's first run: that its comparisons can never show anything.

    `least`: pairs that a verdict needs.
    """
    if len(study.strategies) < 2:
        return []
    if not study.primary_pairs:
        return [
            "The study declares no comparison, so acrc compare will estimate and test nothing; "
            "to test, declare primary = [[ONE, OTHER]]"
        ]
    pairs = pairs_of(study)
    return (
        []
        if pairs >= least
        else [f"acrc compare will say nothing of strategies: {too_few_pairs(pairs, least)}"]
    )


_FIRST_LOOK: Final = 10
"""Pairs; fewer could hardly decide."""
_MOST_LOOKS: Final = 10


@dataclass(frozen=True)
class LookRules:
    """What p-values are enough at each look."""

    differ: SequentialPlan
    """For a difference, two-sided; each test of the family has its part of the 5 %."""
    equivalent: SequentialPlan
    """For equivalence, one-sided."""

    @property
    def least(self) -> int:
        """Pairs that a verdict needs at the last look."""
        return fewest_differing(1, self.differ.thresholds[-1])


def rules_for(study: Study) -> LookRules:
    """Looks after every tenth pair, or ten of them, up to the cap. AcrcError if nothing is declared."""
    if not study.primary_pairs:
        raise AcrcError(
            "--until-decided: the study declares no comparison; must have primary = [[ONE, OTHER]]"
        )
    cap = pairs_of(study)
    between = max(_FIRST_LOOK, -(-cap // _MOST_LOOKS))
    looks = [*range(between, cap, between), cap]
    one_sided = plan(looks, 2 * ALPHA)
    halved = replace(one_sided, thresholds=tuple(one / 2 for one in one_sided.thresholds))
    return LookRules(plan(looks, ALPHA / tests_of(study)), halved)


def look(sample: PairedSample, study: Study, rules: LookRules, *, ended: bool = False) -> PairVerdict:
    """Look at the first pairs of a sample, until a look settles the comparison or pairs are missing.

    What a look has shown stays. `ended`: no pair will come any more, so the last look takes what there are;
    fewer than planned, where failed runs are left out.
    """
    shown: dict[str, Comparison] = {}
    asked: tuple[Comparison, ...] = ()
    verdict = PairVerdict(sample, (), at_cap=ended)
    due = [pairs for pairs in rules.differ.looks if pairs <= len(sample.pairs)]
    if ended and len(due) < len(rules.differ.looks) and sample.pairs:
        due.append(len(sample.pairs))
    for number, pairs in enumerate(due):
        place = -1 if ended and pairs == len(sample.pairs) else number
        first = sample._replace(pairs=sample.pairs[:pairs])
        steps = [shown.get(name) or _at_look(first, name, study, rules, place) for name in step_names(study)]
        shown |= {one.metric: one for one in steps if one.differs or one.equivalent}
        asked += (next((one for one in steps if not one.equivalent or one.differs), steps[-1]),)
        verdict = PairVerdict(first, tuple(steps), asked, ended)
        if verdict.settled:
            break
    return verdict


def _at_look(sample: PairedSample, name: str, study: Study, rules: LookRules, place: int) -> Comparison:
    raw = step(sample, name, study)
    threshold = rules.differ.thresholds[place]
    return replace(
        raw,
        tests=tests_of(study),
        tested=2.0 ** (1 - raw.test.differing) <= threshold,
        adjusted=raw.test.p,
        differs=raw.test.p <= threshold,
        equivalent=raw.equivalence_p <= rules.equivalent.thresholds[place],
        threshold=threshold,
    )


class Watch:
    """The primary comparisons of a campaign that is going on."""

    def __init__(self, store: Store) -> None:
        """Raises AcrcError for a study without one primary comparison at least."""
        self._store = store
        self.rules = rules_for(store.study)
        step_names(store.study)
        self._records: dict[str, TrialRecord] = {}
        self._looked = 0

    def enough(self) -> bool:
        """True once every primary comparison is decided, or has had its last look."""
        ended = len(self._seeds()) * max(len(self._store.study.cells), 1)
        if not any(self._looked < due <= ended for due in self.rules.differ.looks):
            return False
        self._looked = ended
        return all(one.at_cap or one.settled for one in self.looked_at())

    def looked_at(self) -> list[PairVerdict]:
        """How every primary comparison stands, after the last look that was due."""
        study = self._store.study
        seeds = self._seeds()
        records = [self._record(trial) for seed in seeds for trial in study.trials_of(seed)]
        ended = len(seeds) >= study.seeds
        found = primary(samples(records, study), study)
        return [look(sample, study, self.rules, ended=ended) for sample in found]

    def _record(self, trial: Trial) -> TrialRecord:
        """Read once: nothing changes a record."""
        if trial.name not in self._records:
            self._records[trial.name] = self._store.record(trial)
        return self._records[trial.name]

    def _seeds(self) -> list[int]:
        """Return those, from the first on, that have ended for every strategy and variant."""
        study, path = self._store.study, self._store.path
        seeds = range(study.first_seed, study.first_seed + study.seeds)
        return list(takewhile(lambda seed: all(path(one).exists() for one in study.trials_of(seed)), seeds))


def look_sentences(found: Sequence[PairVerdict], rules: LookRules) -> list[str]:
    """Interim looks at a campaign, and their results."""
    rule = rules.differ
    lines = [
        f"looks after {', '.join(map(str, rule.looks))} pairs, at most {rule.looks[-1]};"
        f" for a difference p must be at most {_listed(rule.thresholds)},"
        f" for equivalence {_listed(rules.equivalent.thresholds)}"
    ]
    for one in found:
        told = f"{len(one.sample.pairs)} pairs, none of the looks has come"
        if one.looks:
            told = f"{_outcome(one)}; {'; '.join(map(_at, one.looks))}"
        lines.append(f"{one.sample.name}: {told}")
    return lines


def _outcome(one: PairVerdict) -> str:
    after = f"after {len(one.looks[-1].sample.pairs)} pairs"
    if one.deciding is not None:
        return f"decided {after}"
    if one.equivalent:
        return f"equivalent {after}"
    return f"not decided {'by the cap' if one.at_cap else 'yet'}, {after}"


def _at(asked: Comparison) -> str:
    ahead = {1: f"{asked.sample.one} ahead", -1: f"{asked.sample.other} ahead", 0: "level"}
    sign = "≤" if asked.differs else ">"
    return (
        f"at {len(asked.sample.pairs)} {ahead[asked.test.direction]} by {asked.metric},"
        f" p = {asked.test.p:.2g} {sign} {asked.threshold:.2g}"
    )


def _listed(thresholds: Sequence[float]) -> str:
    return ", ".join(f"{one:.2g}" for one in thresholds)


_CAMPAIGNS: Final = 200
"""Drawn for each size."""
_SIZES: Final = (LEAST_PAIRS, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 80, 100, 150, 200)
"""Sample sizes, in pairs, for which power is computed."""
_HARDER_ROBOTS: Final = 8
_HARDER_S: Final = (300.0, 400.0)
"""Within which a shorter run still lets the robots do most of their places."""


@dataclass(frozen=True)
class Promise:
    """How often campaigns of one size tell the declared comparisons apart."""

    pairs: int
    shares: tuple[float, ...]
    """For each comparison in each variant, if all seeds are as those of the pilot."""
    cautious: tuple[float, ...]
    """The same if the pilot's seeds are themselves drawn."""


def promises(found: Sequence[PairedSample], study: Study, power: float) -> Iterator[Promise]:
    """Larger and larger campaigns, until each declared comparison is told apart with the power.

    Seeds are drawn from the pilot's, each with all its runs, and judged as `acrc compare` judges. The same
    pilot gives the same. Ends at 200 pairs. A pilot must have a pair of each comparison.
    """
    declared = primary(found, study)
    for pairs in _SIZES:
        made = Promise(
            pairs,
            told_apart(declared, study, pairs, np.random.default_rng(1), cautious=False),
            told_apart(declared, study, pairs, np.random.default_rng(1), cautious=True),
        )
        yield made
        if min(made.shares) >= power:
            return


def told_apart(
    declared: Sequence[PairedSample],
    study: Study,
    pairs: int,
    rng: Generator,
    campaigns: int = _CAMPAIGNS,
    *,
    cautious: bool = False,
) -> tuple[float, ...]:
    """The share of drawn campaigns of so many pairs that tell each of these declared samples apart.

    `cautious`: each is drawn from a pilot that is itself drawn from this one.
    """
    known = min(len(sample.pairs) for sample in declared)
    counts = np.zeros(len(declared))
    for _ in range(campaigns):
        seeds = rng.integers(known, size=known) if cautious else np.arange(known)
        drawn = redrawn(declared, seeds[rng.integers(known, size=pairs)])
        counts += [one.deciding is not None for one in verdicts(drawn, study)]
    return tuple((counts / campaigns).tolist())


def redrawn(samples: Sequence[PairedSample], places: NDArray[np.int64]) -> list[PairedSample]:
    """The samples with the pairs at these places, the same in each of them."""
    chosen = places.tolist()
    return [one._replace(pairs=tuple(one.pairs[place] for place in chosen)) for one in samples]


def ceilings(records: Iterable[TrialRecord]) -> Iterator[str]:
    """A sentence for each variant in which half of the runs or more did all there was to do."""
    runs: dict[str, tuple[dict[str, Any], list[RunResult]]] = {}
    for record in records:
        if record.result is not None:
            runs.setdefault(repr(record.variant), (record.variant, []))[1].append(record.result)
    for variant, results in runs.values():
        done = [result.completion_s for result in results if result.completion_s is not None]
        if 2 * len(done) >= len(results):
            where = "".join(f" with {key} = {value}" for key, value in variant.items())
            yield (
                f"{len(done)} of {len(results)} runs{where} have all places: they are at their ceiling there."
                f" A harder condition tells more: {_harder(results, done)}."
            )


def _harder(results: list[RunResult], done: list[float]) -> str:
    """More robots, or less time than three quarters of the runs that were done took."""
    least, most = _HARDER_S
    quarter = quantiles(done, n=4)[0] if len(done) > 1 else done[0]
    seconds = min(max(round(quarter, -1), least), most)
    ways = [f"--robots {_HARDER_ROBOTS}"] if results[0].robots < _HARDER_ROBOTS else []
    if seconds < max(result.simulated_s for result in results):
        ways.append(f"--duration {seconds:g}")
    return " and ".join(ways) or "more robots, or places that lie farther apart"
