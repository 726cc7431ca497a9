"""Synthetic trials with a known result of their comparison."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec

from acrc_testbed.experiments.comparison import PairedSample, samples
from acrc_testbed.experiments.metrics import Run, task_metrics
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_record import TrialRecord
from acrc_testbed.experiments.verdicts import PairVerdict, verdicts
from acrc_testbed.results.result import RunResult, field_trial_struct
from actors.task.loading import task_setup

CLEANING = task_setup("cleaning", {}).declaration
METRICS = task_metrics(CLEANING)

LENGTH = 600.0
Outcome = tuple[int, float | None]
"""Places done, and when all places were done or given up."""


def trials(
    plain: RunResult, strategy: str, outcome: Callable[[int], Outcome | None], seeds: int = 20
) -> Iterator[TrialRecord]:
    """Return trials with these outcomes; None: the trial failed."""
    for seed in range(1, seeds + 1):
        found = outcome(seed)
        if found is None:
            yield TrialRecord(strategy, seed, {}, failure="it rained")
            continue
        places, at = found
        result = varied(plain, places_done=places, completion_s=at, settled_s=at, simulated_s=LENGTH)
        yield TrialRecord(strategy, seed, {}, result)


def study(one: str = "one", other: str = "other", **words: object) -> Study:
    made = Study(
        name="made", task=CLEANING, scenario="/nowhere.toml", strategies=(one, other), seeds=20,
        primary=((one, other),),
    )  # fmt: skip
    return msgspec.structs.replace(made, **words)


def varied(plain: RunResult, **words: Any) -> RunResult:
    """Return the result with other fields and values of the task."""
    task = {name: words.pop(name) for name in [*words] if name not in RunResult.__struct_fields__}
    return msgspec.structs.replace(plain, task=plain.task | task, **words)


def run(places: int, settled: Any = None, *, length: float = LENGTH, **others: Any) -> RunResult:
    """Return a result with only the values that comparisons read."""
    task: dict[str, Any] = {
        "places_done": places,
        "places_total": 40,
        "completion_s": settled,
        "settled_s": settled,
    }
    task |= {name: others.pop(name) for name in [*others] if name in task}
    known: dict[str, object] = {
        "task": task, "declaration": CLEANING, "simulated_s": length, "contacts": 0,
        "radio_bytes_per_robot_s": 0.0, "driven_m": 0.0, "outcome": {},
    }  # fmt: skip
    return field_trial_struct(RunResult, **(known | others))


def sample(ones: Sequence[Run], others: Sequence[Run]) -> PairedSample:
    return PairedSample("one", "other", (), tuple(zip(ones, others, strict=True)))


def verdict_of(ones: Sequence[Run], others: Sequence[Run], made: Study | None = None) -> PairVerdict:
    (found,) = verdicts([sample(ones, others)], made or study())
    return found


def judged(records: Sequence[TrialRecord], made: Study) -> list[PairVerdict]:
    return verdicts(samples(records, made), made)
