"""When a campaign may stop: it is looked at on its way, and yet errs no more often than if it were not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from acrc_testbed.experiments.campaign.store import Store
from acrc_testbed.experiments.campaign.trial_record import TrialRecord
from acrc_testbed.experiments.comparison.comparison import PairedSample, samples
from acrc_testbed.experiments.comparison.family import (
    ComparedMetric,
    PairVerdict,
    pairs_of,
    primary,
    step,
    step_names,
    tests_of,
)
from acrc_testbed.experiments.statistics.paired_tests import ALPHA, SequentialPlan, fewest_differing, plan
from acrc_testbed.experiments.study.study import Study, Trial
from actors.runtime.errors import AcrcError

_FIRST_LOOK: Final = 10
"""Pairs; fewer could hardly decide."""
_MOST_LOOKS: Final = 10


class LookedAt(NamedTuple):
    """How a primary comparison in one variant stands after the last look that was due."""

    verdict: PairVerdict
    """Without steps if none of the looks has come."""
    looks: tuple[ComparedMetric, ...]
    """At each look the step that was asked."""
    at_cap: bool
    """True if there will be no more pairs."""

    @property
    def settled(self) -> bool:
        """True if nothing more is to be looked at."""
        return self.at_cap or (bool(self.looks) and self.verdict.settled)


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


def look(sample: PairedSample, study: Study, rules: LookRules, *, ended: bool = False) -> LookedAt:
    """Look at the first pairs of a sample, until a look settles the comparison or pairs are missing.

    What a look has shown stays. `ended`: no pair will come any more, so the last look takes what there are;
    fewer than planned, where failed runs are left out.
    """
    shown: dict[str, ComparedMetric] = {}
    asked: list[ComparedMetric] = []
    verdict = PairVerdict(sample, ())
    due = [pairs for pairs in rules.differ.looks if pairs <= len(sample.pairs)]
    if ended and len(due) < len(rules.differ.looks) and sample.pairs:
        due.append(len(sample.pairs))
    for number, pairs in enumerate(due):
        place = -1 if ended and pairs == len(sample.pairs) else number
        first = sample._replace(pairs=sample.pairs[:pairs])
        steps = [shown.get(name) or _at_look(first, name, study, rules, place) for name in step_names(study)]
        shown |= {one.metric: one for one in steps if one.differs or one.equivalent}
        verdict = PairVerdict(first, tuple(steps))
        asked.append(next((one for one in steps if not one.equivalent or one.differs), steps[-1]))
        if verdict.settled:
            break
    return LookedAt(verdict, tuple(asked), ended)


def _at_look(sample: PairedSample, name: str, study: Study, rules: LookRules, place: int) -> ComparedMetric:
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
        return all(one.settled for one in self.looked_at())

    def looked_at(self) -> list[LookedAt]:
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
        """Those, from the first on, that have ended for every strategy and variant."""
        seeds: list[int] = []
        complete = True
        for trial in self._store.study.trials():
            if not seeds or seeds[-1] != trial.seed:
                if seeds and not complete:
                    break
                seeds.append(trial.seed)
                complete = True
            complete = complete and self._store.path(trial).exists()
        return seeds if complete else seeds[:-1]


def told(found: Sequence[LookedAt], rules: LookRules) -> list[str]:
    """What has been looked at, and what came of it."""
    rule = rules.differ
    lines = [
        f"looks after {', '.join(map(str, rule.looks))} pairs, at most {rule.looks[-1]};"
        f" for a difference p must be at most {_listed(rule.thresholds)},"
        f" for equivalence {_listed(rules.equivalent.thresholds)}"
    ]
    for one in found:
        sample = one.verdict.sample
        name = f"{sample.one} and {sample.other}{sample.where}"
        if not one.looks:
            lines.append(f"{name}: {len(sample.pairs)} pairs, none of the looks has come")
            continue
        lines.append(f"{name}: {_outcome(one)}; {'; '.join(map(_at, one.looks))}")
    return lines


def _outcome(one: LookedAt) -> str:
    after = f"after {len(one.looks[-1].sample.pairs)} pairs"
    if one.verdict.deciding is not None:
        return f"decided {after}"
    if one.verdict.equivalent:
        return f"equivalent {after}"
    return f"not decided {'by the cap' if one.at_cap else 'yet'}, {after}"


def _at(asked: ComparedMetric) -> str:
    ahead = {1: f"{asked.sample.one} ahead", -1: f"{asked.sample.other} ahead", 0: "level"}
    sign = "≤" if asked.differs else ">"
    return (
        f"at {len(asked.sample.pairs)} {ahead[asked.test.direction]} by {asked.metric},"
        f" p = {asked.test.p:.2g} {sign} {asked.threshold:.2g}"
    )


def _listed(thresholds: Sequence[float]) -> str:
    return ", ".join(f"{one:.2g}" for one in thresholds)
