"""When a campaign may stop: it is looked at on its way, and yet errs no more often than if it were not."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from actors.runtime.errors import AcrcError
from experiments.campaign.store import Store
from experiments.campaign.trial_record import TrialRecord
from experiments.comparison import metrics
from experiments.comparison.comparison import scores
from experiments.statistics.hypothesis_tests import signed_rank
from experiments.statistics.sequential import InterimLook, SequentialPlan, last_look, plan
from observation.results.result import RunResult

_FIRST_LOOK: Final = 10
"""Pairs; fewer could hardly decide."""
_MOST_LOOKS: Final = 10
ALPHA: Final = 0.05


class PrimaryVerdict(NamedTuple):
    """How a primary comparison in one variant stands."""

    one: str
    other: str
    variant: tuple[tuple[str, object], ...]
    pairs: int
    """There are."""
    look: InterimLook | None
    """The one that decided, or the last; None: none has come."""
    at_cap: bool
    """True if there will be no more pairs."""

    @property
    def settled(self) -> bool:
        """True if nothing more is to be looked at."""
        return self.at_cap or (self.look is not None and self.look.decides)


class Watch:
    """The primary comparisons of a campaign that is going on."""

    def __init__(self, store: Store) -> None:
        """Raises AcrcError for a study without one primary comparison at least."""
        study = store.study
        self._pairs = study.primary_pairs
        if not self._pairs:
            raise AcrcError(
                "--until-decided: the study declares no comparison; must have primary = [[ONE, OTHER]]"
            )
        if study.primary_metric not in metrics.NAMES:
            raise AcrcError(
                f"primary_metric is {study.primary_metric!r}; must be one of {', '.join(metrics.NAMES)}"
            )
        self._store = store
        self._variants = study.variants()
        self.rule = rule_for(study.seeds, ALPHA / (len(self._pairs) * len(self._variants)))
        self._records: dict[str, TrialRecord] = {}
        self._looked = 0

    def enough(self) -> bool:
        """True once every primary comparison is decided, or has had its last look."""
        ended = self._ended()
        if not any(self._looked < look <= ended for look in self.rule.looks):
            return False
        self._looked = ended
        return all(verdict.settled for verdict in self.verdicts())

    def verdicts(self) -> list[PrimaryVerdict]:
        """How every primary comparison stands, after the last look that was due."""
        return [self._verdict(*pair, variant) for pair in self._pairs for variant in self._variants]

    def _verdict(self, one: str, other: str, variant: tuple[tuple[str, object], ...]) -> PrimaryVerdict:
        """Seeds of which one run failed make no pair."""
        metric = self._store.study.primary_metric
        chosen = [self._records_of(seed, variant, (one, other)) for seed in self._seeds()]
        runs = [(a.result, b.result) for a, b in chosen if a.result is not None and b.result is not None]
        look = last_look(lambda pairs: p_of(metric, runs[:pairs]), len(runs), self.rule)
        return PrimaryVerdict(one, other, variant, len(runs), look, len(chosen) >= self._store.study.seeds)

    def _ended(self) -> int:
        """How many seeds, from the first on, have ended for every strategy and variant."""
        return len(self._seeds())

    def _seeds(self) -> list[int]:
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

    def _records_of(
        self, seed: int, variant: tuple[tuple[str, object], ...], strategies: Sequence[str]
    ) -> list[TrialRecord]:
        found = {}
        for trial in self._store.study.trials_of(seed):
            if trial.variant == variant and trial.strategy in strategies:
                record = self._records.get(trial.name) or self._store.record(trial)
                found[trial.strategy] = self._records[trial.name] = record
        return [found[strategy] for strategy in strategies]


def rule_for(cap: int, alpha: float = ALPHA) -> SequentialPlan:
    """Looks after every tenth pair, or so that there are ten, up to the cap."""
    step = max(_FIRST_LOOK, -(-cap // _MOST_LOOKS))
    return plan([*range(step, cap, step), cap], alpha)


def told(verdicts: Sequence[PrimaryVerdict], rule: SequentialPlan, metric: str) -> list[str]:
    """What has been looked at, and what came of it."""
    lines = [
        f"looks after {', '.join(map(str, rule.looks))} pairs, at most {rule.looks[-1]}, by {metric};"
        f" p must be at most {', '.join(f'{threshold:.2g}' for threshold in rule.thresholds)}"
    ]
    for one in verdicts:
        where = "".join(f", {key} = {value}" for key, value in one.variant)
        name, look = f"{one.one} and {one.other}{where}", one.look
        if look is None:
            lines.append(f"{name}: {one.pairs} pairs, none of the looks has come")
        elif look.decides:
            lines.append(f"{name}: decided after {look.pairs} pairs, p = {look.p:.2g} ≤ {look.threshold:.2g}")
        else:
            when = "by the cap" if one.at_cap else "yet"
            lines.append(
                f"{name}: not decided {when},"
                f" after {look.pairs} pairs p = {look.p:.2g} > {look.threshold:.2g}"
            )
    return lines


def p_of(metric: str, pairs: Sequence[tuple[RunResult, RunResult]]) -> float:
    """The signed-rank test's p-value of these pairs."""
    return signed_rank(*scores(metric, pairs)).p
