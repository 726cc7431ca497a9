"""Which runs in memory are repeated as processes: drawn after all have ended, so that none can know.

Of each strategy one run in so many is drawn by lot, and as many again are those that it won most oddly.
Whoever has a campaign's folder can draw the lots again: runs stand in the order of the SHA-256 of the draw's
entropy and the run's name, and the first are taken.
"""

import hashlib
import math
from collections.abc import Iterator, Sequence
from statistics import median
from typing import NamedTuple

import msgspec

from experiments.campaign.trial_record import TrialRecord
from experiments.study.study import Trial
from observation.accounting.time_spent import TimeSpent
from observation.results.result import RunResult


class Draw(msgspec.Struct, frozen=True):
    """Runs that were drawn at one time, all others of a campaign having ended."""

    entropy: str
    """Hexadecimal: from the system, after the last of these runs had ended."""
    every: int
    """Of each strategy one in so many by lot, and as many odd ones."""
    among: dict[str, str]
    """SHA-256 of each run's record as it was then, by the record's file name without suffix."""
    by_lot: tuple[str, ...]
    odd: dict[str, str]
    """Why each was repeated beside the lots."""

    @property
    def names(self) -> tuple[str, ...]:
        """All runs that are to be repeated."""
        return (*self.by_lot, *(name for name in self.odd if name not in self.by_lot))


class DrawableRun(NamedTuple):
    """One run that may be drawn."""

    trial: Trial
    result: RunResult
    faults: tuple[str, ...]
    """What it says of itself that cannot all be true, in a sentence each."""
    sha256: str
    """Of its record."""


def run_of(trial: Trial, record: TrialRecord, sha256: str) -> DrawableRun | None:
    """The run that a trial's record is of; None for a failed one."""
    if record.result is None:
        return None
    return DrawableRun(trial, record.result, tuple(_contradictions(record.result, record.time)), sha256)


def draw(runs: Sequence[DrawableRun], every: int, entropy: bytes) -> Draw:
    """Draw among the runs; `every` is at least 1."""
    among = {run.trial.name: run.sha256 for run in runs}
    odd = {run.trial.name: reason for run in runs for reason in run.faults}
    lots: list[str] = []
    scores = _Scores(runs)
    for strategy in dict.fromkeys(run.trial.strategy for run in runs):
        own = sorted(
            (run for run in runs if run.trial.strategy == strategy), key=lambda run: _lot(entropy, run)
        )
        share = math.ceil(len(own) / every)
        lots += [run.trial.name for run in own[:share]]
        left = [run for run in own[share:] if run.trial.name not in odd]
        left.sort(key=scores.oddness, reverse=True)
        odd |= {run.trial.name: scores.reason(run) for run in left[:share]}
    return Draw(entropy.hex(), every, among, tuple(lots), odd)


def _lot(entropy: bytes, run: DrawableRun) -> bytes:
    return hashlib.sha256(entropy + run.trial.name.encode()).digest()


def _contradictions(told: RunResult, spent: TimeSpent | None) -> Iterator[str]:
    robots = told.per_robot.values()
    if sum(robot.places_done for robot in robots) != told.places_done:
        yield "its places done are not those of its robots together"
    if told.places_done > min(told.places_claimed, told.places_total):
        yield "it has more places done than were reported, or than there are"
    lengths = [sum(causes.values()) for causes in spent.robots.values()] if spent is not None else []
    if any(abs(length - told.simulated_s) > 1e-6 for length in lengths):
        yield "its recordings are of another length than its result"


class _Scores:
    """How far each run is above what its strategy does elsewhere, and above what others do there."""

    def __init__(self, runs: Sequence[DrawableRun]) -> None:
        self._own: dict[str, list[float]] = {}
        self._beside: dict[str, list[tuple[str, float]]] = {}
        for trial, result, _, _ in runs:
            self._own.setdefault(repr((trial.strategy, trial.variant)), []).append(_score(result))
            self._beside.setdefault(repr((trial.seed, trial.variant)), []).append(
                (trial.strategy, _score(result))
            )

    def oddness(self, run: DrawableRun) -> float:
        """Both together."""
        return sum(self._above(run))

    def reason(self, run: DrawableRun) -> str:
        """The same in words."""
        own, others = self._above(run)
        return f"scores {own:+.3f} beside its strategy's median, {others:+.3f} beside others with its seed"

    def _above(self, run: DrawableRun) -> tuple[float, float]:
        trial, score = run.trial, _score(run.result)
        own = self._own[repr((trial.strategy, trial.variant))]
        beside = self._beside[repr((trial.seed, trial.variant))]
        others = [theirs for strategy, theirs in beside if strategy != trial.strategy]
        return score - median(own), score - median(others) if others else 0.0


def _score(told: RunResult) -> float:
    """The share of places done, and of complete runs above 1 the sooner they were: more is better."""
    share = told.places_done / max(told.places_total, 1)
    return share if told.completion_s is None else share + 100 / (100 + told.completion_s)
