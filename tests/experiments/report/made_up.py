"""Campaigns that never were, of which it is known what a report must say."""

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from acrc_testbed.experiments import store
from acrc_testbed.experiments.study import Study, Trial
from acrc_testbed.experiments.trial_record import TrialRecord, write_json
from acrc_testbed.explanation.time_spent import (
    BlockingEvent,
    Cause,
    DeadlockCount,
    DecisionEvent,
    DiagnosisScore,
    KnowledgeUse,
    TimeSpent,
)
from acrc_testbed.results.result import RobotResult, RunResult
from tests.experiments.made_runs import varied

LENGTH = 600.0
Drawn = Callable[[Trial, np.random.Generator], tuple[int, float | None]]
"""Places done of 40, and when all were done."""


def campaign(
    folder: Path,
    plain: RunResult,
    study: Study,
    drawn: Drawn,
    *,
    fails: Callable[[Trial], str | None] = lambda trial: None,
    with_time: bool = False,
) -> Path:
    """Write a campaign's folder as acrc campaign does, reproducibly."""
    kept = store.create_store(folder, study)
    for trial in study.trials():
        rng = np.random.default_rng([trial.seed, len(trial.strategy), len(str(trial.variant))])
        failure = fails(trial)
        result = None if failure else _result(plain, trial, drawn(trial, rng), rng)
        time = _time(rng) if with_time and result is not None else None
        told = TrialRecord(trial.strategy, trial.seed, dict(trial.variant), result, failure, time)
        write_json(kept.path(trial), told)
    return folder


def _result(
    plain: RunResult, trial: Trial, drawn: tuple[int, float | None], rng: np.random.Generator
) -> RunResult:
    places, completion = drawn
    parts = np.minimum([places // 4 + (robot < places % 4) for robot in range(4)], 10)
    robots = {
        f"r{robot + 1}": RobotResult(
            {
                "places_total": 10, "places_done": int(done), "places_claimed": int(done),
                "completion_s": None if done < 10 else float(rng.uniform(0.5, 1.0)) * (completion or LENGTH),
            },
            plain.per_robot["r1"].pose_error,
        )
        for robot, done in enumerate(parts)
    }  # fmt: skip
    frames = plain.frames | {"frames_sent": 6000, "bytes_sent": int(rng.normal(340_000, 9_000))}
    return varied(
        plain, digest=f"{trial.name:0<64}"[:64], robots=4, seed=trial.seed, simulated_s=LENGTH,
        places_total=40, places_done=places, places_claimed=places, completion_s=completion,
        settled_s=completion, per_robot=robots, frames=frames,
        radio_bytes_per_robot_s=frames["bytes_sent"] / 4 / LENGTH,
        contacts=int(rng.poisson(2)), cpu_s=20.0 + float(rng.normal()), out="",
        deeco=msgspec.structs.replace(plain.deeco, replica_age_mean_s=float(rng.normal(1.5, 0.1))),
        outcome={"turns": {"r1": trial.seed, "r2": 2.0}},
    )  # fmt: skip


def _time(rng: np.random.Generator) -> TimeSpent:
    weights = np.array([0.1, 0.1, 3, 0.3, 0.1, 1, 30, 2, 5, 0.1, 0.1, 1, 2, 2, 12, 3, 4])
    spent = [(rng.dirichlet(weights) * LENGTH).tolist() for _ in range(4)]
    causes = [cause.value for cause in Cause]
    robots = {f"r{n}": dict(zip(causes, one, strict=True)) for n, one in enumerate(spent, start=1)}
    spells = [
        BlockingEvent(
            10.0 * n, 10.0 * n + float(rng.uniform(2, 40)), ("r1", "r2"), 3.0, 4.0, place, cause, n == 3
        )
        for n, (place, cause) in enumerate(
            [("door", Cause.DOOR.value)] * 3 + [("open floor", Cause.OPEN_FLOOR.value)]
        )
    ]  # fmt: skip
    decisions = [
        DecisionEvent(
            "r1", 20.0, "Adoption", f"takes over r2/{number}", (KnowledgeUse("r2", 1.4),), (1.0, 2.0),
            (3.0, 4.0), outcome, 5.0, float(rng.uniform(1, 9)) if outcome == "free" else None,
        )
        for number, outcome in enumerate(("free", "free", "blocked again"))
    ]  # fmt: skip
    return TimeSpent(
        robots, tuple(spells), DiagnosisScore(0.8, 0.6, 3.5, 5, 4, 1), tuple(decisions),
        deadlocks=DeadlockCount(int(rng.integers(0, 2)), 0),
    )  # fmt: skip
