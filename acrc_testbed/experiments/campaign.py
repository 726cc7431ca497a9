"""Execution of a campaign: order of trials, resumption, progress, and tables of results."""

import shlex
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any, Final

import msgspec

from acrc_testbed.experiments.store import PendingTrial, Store
from acrc_testbed.experiments.study import Study
from acrc_testbed.experiments.trial_pool import Pool, trial_pool
from acrc_testbed.experiments.trial_record import (
    NO_CODE,
    CodeFolders,
    TrialOutcome,
    TrialRecord,
    compare_repetition,
    make_order,
    validated_record,
    write_durably,
    write_json,
)
from acrc_testbed.results.outcome import csv_text, outcome_means
from actors.processes.signals import signals_as_interrupts
from actors.runtime import regular_file
from deploy.scenario.tables import inline_toml


class RemainingTime:
    """Estimator of the remaining time, by strategy, variant and whether a trial is repeated."""

    def __init__(self) -> None:
        self._durations: dict[str, list[float]] = {}

    def add_duration(self, pending: PendingTrial, duration_s: float) -> None:
        """Add the duration of a trial."""
        self._durations.setdefault(_trial_kind(pending), []).append(duration_s)

    def remaining_s(
        self, waiting: Iterable[PendingTrial], running: Sequence[tuple[PendingTrial, float]], slots: int
    ) -> float | None:
        """Return the remaining time with `slots` trials at once, s; None before any trial has ended.

        `running`: trials in progress and their age, s. Kinds without an ended trial take the others' mean.
        """
        if not self._durations:
            return None
        means = {kind: fmean(spans) for kind, spans in self._durations.items()}
        overall = fmean(means.values())
        begun = [max(means.get(_trial_kind(pending), overall) - since, 0.0) for pending, since in running]
        to_come = sum(means.get(_trial_kind(pending), overall) for pending in waiting)
        return max((sum(begun) + to_come) / max(slots, 1), max(begun, default=0.0))


def _trial_kind(pending: PendingTrial) -> str:
    return repr((pending.trial.strategy, pending.trial.variant, pending.check))


_POLL_S: Final = 1.0


@dataclass(frozen=True)
class CampaignOptions:
    """Options of execution, without influence on results."""

    jobs: int = 0
    """Trials at once; 0: one per core."""
    patience_s: float = 3600.0
    """Timeout of a trial, s; on expiry the trial fails."""
    check_every: int = 0
    """Repeat the first and every `check_every`-th trial of each strategy as processes over Zenoh; 0: none."""
    on: str | None = None
    """Scheduler of a cluster for the trials, `tls://host:port`; None: this computer."""
    folders: CodeFolders = NO_CODE


@dataclass(frozen=True)
class CampaignProgress:
    """Progress of a campaign."""

    done: int
    """Ended trials, including those of earlier calls."""
    failed: int
    total: int
    left_s: float | None
    """Estimated remaining time, s; None before the first trial has ended."""
    enough: bool = False
    """True if it stopped early because all declared comparisons are decided."""


OnProgress = Callable[[CampaignProgress], None]


def run_campaign(
    store: Store,
    options: CampaignOptions,
    on_progress: OnProgress = lambda progress: None,
    is_decided: Callable[[], bool] = lambda: False,
) -> CampaignProgress:
    """Run every trial that has no record, and return the final progress.

    Records survive any interruption; the next call resumes. A trial that crashes or times out is recorded as
    a failure. `is_decided`: evaluated at the start and after each trial; once true, no further trial starts.
    """
    opened = trial_pool(options.jobs, options.patience_s, options.on, store.commit)
    with signals_as_interrupts(), opened as pool:
        return _Campaign(store, options, pool, on_progress, is_decided).run()


class _Campaign:
    def __init__(
        self,
        store: Store,
        options: CampaignOptions,
        pool: Pool,
        on_progress: OnProgress,
        is_decided: Callable[[], bool],
    ) -> None:
        self._store = store
        self._every = 0 if store.study.isolated else options.check_every
        self._pool = pool
        self._folders = options.folders
        self._running: dict[Future[TrialOutcome], tuple[PendingTrial, float]] = {}
        self._on_progress = on_progress
        self._is_decided = is_decided
        self._trials = deque(store.pending())
        self._checks = deque[PendingTrial]()
        self._total = sum(1 for _ in store.study.trials())
        self._done = self._total - len(self._trials)
        self._failed = 0
        self._remaining_time = RemainingTime()
        self._stopped_early = False
        for trial in store.study.trials():
            if not store.path(trial).exists():
                continue
            result = store.record(trial).result
            if result is None:
                self._failed += 1
            else:
                self._remaining_time.add_duration(PendingTrial(trial), result.startup_s + result.wall_s)

    def run(self) -> CampaignProgress:
        self._check_decision()
        self._on_progress(self._progress())
        self._run_trials(self._trials)
        if self._every:
            self._checks.extend(self._store.unchecked_trials(self._every))
            self._run_trials(self._checks)
        return self._progress()

    def _run_trials(self, waiting: deque[PendingTrial]) -> None:
        """Run all waiting trials to completion."""
        while waiting or self._running:
            while waiting and len(self._running) < self._pool.slots:
                pending = waiting.popleft()
                trial, check = pending
                regular_file.write_atomically(self._store.log(trial, check=check), b"")
                order = make_order(self._store.study, trial, self._folders, repeated=check)
                self._running[self._pool.submit(order)] = (pending, time.monotonic())
            ended, _ = wait(self._running, _POLL_S, FIRST_COMPLETED)
            for future in ended:
                pending, began = self._running.pop(future)
                self._remaining_time.add_duration(pending, time.monotonic() - began)
                self._store_record(pending, self._pool.outcome(future))
            if ended:
                self._check_decision()
            self._on_progress(self._progress())

    def _check_decision(self) -> None:
        if not self._stopped_early and self._is_decided():
            self._stopped_early = True
            self._trials.clear()

    def _store_record(self, pending: PendingTrial, outcome: TrialOutcome) -> None:
        """Validate and store the record of an ended trial."""
        trial, check = pending
        store = self._store
        regular_file.write_atomically(store.log(trial, check=check), outcome.output)
        record = validated_record(outcome.record, trial, store.study.task, outcome.cause)
        if check:
            write_json(store.check_path(trial), compare_repetition(store.record(trial), record))
            return
        self._done += 1
        self._failed += record.failure is not None
        write_json(store.path(trial), record)

    def _progress(self) -> CampaignProgress:
        waiting = (*self._trials, *self._checks)
        now = time.monotonic()
        running = [(pending, now - began) for pending, began in self._running.values()]
        left_s = self._remaining_time.remaining_s(waiting, running, self._pool.slots)
        return CampaignProgress(self._done, self._failed, self._total, left_s, self._stopped_early)


Scalar = bool | int | float | str | None
Row = dict[str, Scalar]
_NOT_METRICS: Final = frozenset({"digest", "seed", "out", "bus", "isolation", "task_summary"})
"""Scalar fields of a result that have a column of their own or do not describe the outcome."""
_NOT_TABULATED: Final = frozenset({"per_robot", "frames_by_robot", "origin", "processor", "declaration"})
"""Nested fields of a result without columns."""


def write_tables(store: Store) -> tuple[Path, Path]:
    """Write `results.parquet` and `results.csv` into the campaign's folder, and return their paths.

    Both have the same columns and a row for each ended trial, in the study's order; each file is written
    atomically. Raises AcrcError for a damaged record.
    """
    import pyarrow
    from pyarrow import parquet

    table = columns(store)
    binary = pyarrow.BufferOutputStream()
    parquet.write_table(pyarrow.table(table), binary)
    paths = store.folder / "results.parquet", store.folder / "results.csv"
    write_durably(paths[0], binary.getvalue().to_pybytes())
    write_durably(paths[1], csv_text([table, *zip(*table.values(), strict=True)]).encode())
    return paths


def columns(store: Store) -> dict[str, list[object]]:
    """Return the results by column, each of one type. Raises AcrcError for a damaged record."""
    table = list(rows(store))
    names = dict.fromkeys(name for row in table for name in row)
    return {name: _uniform_column(row.get(name) for row in table) for name in names}


def rows(store: Store) -> Iterator[Row]:
    """Yield a row for each ended trial; dotted column names are fields of nested structures."""
    commit, study = store.commit, store.study
    for trial in (one for one in study.trials() if store.path(one).exists()):
        record = store.record(trial)
        result = record.result
        origin = result.origin if result is not None else None
        row = {
            "scenario": study.scenario,
            "strategy": record.strategy,
            "settings": _json(origin.settings) if origin is not None else None,
            "navigation.preset": origin.navigation if origin is not None else None,
            "seed": record.seed,
            "tuning": study.tuning,
            **{f"vary.{key}": _cell(value) for key, value in record.variant.items()},
            "drawn": _json(record.drawn),
            "command": command(study, record),
            "failure": record.failure,
            "commit": commit,
            "versions": _json(origin.versions) if origin is not None else None,
            "digest": result.digest if result is not None else None,
        }
        found = {} if result is None else _metrics(msgspec.to_builtins(result))
        row |= {name: value for name, value in found.items() if name not in row}
        row |= {
            f"outcome.{name}": mean for name, mean in outcome_means(result.outcome if result else {}).items()
        }
        if store.check_path(trial).exists():
            check = store.check(trial)
            row |= {
                "zenoh.digest": check.over_zenoh or None,
                "zenoh.real_time_factor": check.over_zenoh_speed,
                "zenoh.failure": check.failure,
            }
        yield row


def command(study: Study, record: TrialRecord) -> str:
    """Return the command that repeats one trial as a run."""
    words = ["acrc", "run", study.scenario, "--seed", str(record.seed), "--strategy", record.strategy]
    for key, value in (*study.settings_of(tuple(record.variant.items())), *record.drawn.items()):
        words += ["--set", f"{key}={inline_toml(value)}"]
    return shlex.join(words)


def _metrics(result: Mapping[str, Any], prefix: str = "") -> Row:
    """Return all scalars of a result; those of nested tables have dotted names, except the task's."""
    metrics: Row = {}
    for name, value in result.items():
        if isinstance(value, Mapping) and name not in _NOT_TABULATED:
            metrics |= _metrics(value, "" if name == "task" else f"{prefix}{name}.")
        elif isinstance(value, Scalar) and (prefix or name not in _NOT_METRICS):
            metrics[prefix + name] = value
    return metrics


def _uniform_column(values: Iterable[object]) -> list[object]:
    """Return the values of a column converted to one type: numbers, or else texts."""
    column = list(values)
    kinds = {type(value) for value in column if value is not None}
    if kinds == {int, float}:
        return [float(value) if isinstance(value, int) else value for value in column]
    if len(kinds) > 1:
        return [value if isinstance(value, str | None) else _json(value) for value in column]
    return column


def _cell(value: object) -> Scalar:
    return value if isinstance(value, Scalar) else _json(value)


def _json(value: object) -> str:
    return msgspec.json.encode(value, order="sorted").decode()
