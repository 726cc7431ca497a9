"""Comparison of the particle filter with another localisation on the same logs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from scipy.stats import binomtest

from acrc_testbed.benchmarks.benchmark_result import BenchmarkResult, make_table
from acrc_testbed.benchmarks.localisation_tracking import (
    LOST_ERROR,
    NEES_BOUNDS,
    PRESETS,
    STEP_US,
    TRACKED,
    CourseLogError,
    FilterRun,
    Preset,
    errors_against_truth,
    localisation,
    read_course,
    replay,
)
from acrc_testbed.experiments.paired_tests import Interval
from actors.array_types import Floats

_RESAMPLES: Final = 2000


def bootstrap_means(values: Floats) -> Floats:
    """Return (_RESAMPLES,) bootstrap means of the values."""
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    means: Floats = values[draws].mean(axis=1)
    return means


def root_mean_square(runs: Sequence[FilterRun]) -> Interval:
    """Return the RMS error over all poses of all runs, m, with a 95 % bootstrap interval over runs.

    Percentile method: Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    squares = np.array([run.mean_square for run in runs])
    low, high = np.percentile(np.sqrt(bootstrap_means(squares)), (2.5, 97.5)).tolist()
    return Interval(math.sqrt(squares.mean()), low, high)


def table_row(runs: Sequence[FilterRun]) -> dict[str, str]:
    """Return a table row of at least one run, with the columns that LEGEND describes."""
    rmse, lost = root_mean_square(runs), sum(run.lost for run in runs)
    errors = np.concatenate([run.errors for run in runs])
    nees = np.concatenate([run.tracking for run in runs])
    spells = [announced for run in runs for announced in run.spells]
    costs = 1e6 * np.concatenate([run.costs for run in runs])
    share = binomtest(lost, len(runs)).proportion_ci(method="wilson")
    outside = [
        float(np.mean(beyond)) if nees.size else 0.0
        for beyond in (nees < NEES_BOUNDS[0], nees > NEES_BOUNDS[1])
    ]
    return {
        "rmse": f"{rmse.value:.3f} [{rmse.low:.2f}, {rmse.high:.2f}]",
        "median run": f"{np.median([run.rmse for run in runs]):.3f}",
        "median": f"{np.median(errors):.3f}",
        "max": f"{errors.max():.2f}",
        f"> {TRACKED:g} m": f"{np.mean(errors > TRACKED):.1%}",
        "lost": f"{lost}/{len(runs)} [{share.low:.0%}, {share.high:.0%}]",
        "NEES": f"{np.median(nees):.2f}" if nees.size and math.isfinite(np.median(nees)) else "∞",
        "low/high": "/".join(f"{one:.0%}" for one in outside),
        "detected": f"{sum(spells)}/{len(spells)}",
        "false": f"{sum(run.false_alarms for run in runs)} in {errors.size * STEP_US / 3.6e9:.1f} h",
        "µs": f"{costs.mean():.0f} ({costs.min():.0f})" if costs.size else "-",
    }


LEGEND: Final = (
    "rmse: over all poses of all runs [95 %, bootstrap over runs]; median run: median rmse of runs; "
    f"lost: runs with a final error > {LOST_ERROR:g} m [95 %, Wilson]; NEES: median while the error is at "
    f"most {TRACKED:g} m, ideally 2.37; low/high: share of that time below and above the two-sided 95 % "
    "bounds, ideally 2.5 % each; detected: intervals of 3 s or more in which the robot was lost and reported "
    f"it; false: reports with an error up to {TRACKED:g} m for 5 s before and after; µs: CPU per update, "
    "mean (minimum)."
)


_MAX_BYTES: Final = 10_000_000


class ReferenceRun(msgspec.Struct):
    """Result of another localisation on a log, from one seed; further fields are ignored."""

    rmse: float
    """Error over all poses, m."""
    lost: bool
    """Final error above 1 m."""
    nmed: float | None = None
    """Median NEES."""


class ReferenceRuns(msgspec.Struct):
    """All runs of another localisation on one log."""

    log: str
    """File name of the log, without .zip."""
    runs: list[ReferenceRun]


@dataclass(frozen=True)
class PairedRow:
    """Comparison on one log, or on all logs."""

    log: str
    preset: str
    ours: float
    """Mean error, m; geometric mean for all logs."""
    theirs: float
    ratio: float
    low: float
    high: float
    """95 % interval of the ratio: a bootstrap over runs of each side, and over logs."""
    lost: str
    """Lost runs, ours and theirs."""
    nees: str
    """Median over runs, ours and theirs."""


def load_reference_runs(file: Path) -> dict[str, ReferenceRuns]:
    """Read the results of another localisation, by log. Raises CourseLogError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(_MAX_BYTES + 1)
        if len(data) > _MAX_BYTES:
            raise CourseLogError(f"{file}: larger than the limit of {_MAX_BYTES} bytes.")
        others = msgspec.json.decode(data, type=list[ReferenceRuns])
    except OSError as error:
        raise CourseLogError(f"{file}: cannot be read: {error.strerror}.") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise CourseLogError(
            f"{file}: must be a list of logs with runs (docs/localisation-log.md): {error}."
        ) from None
    for other in others:
        if not other.runs or not all(math.isfinite(run.rmse) and run.rmse > 0 for run in other.runs):
            raise CourseLogError(f"{file}: {other.log[:80]}: must contain runs, each with an rmse above 0.")
    return {other.log: other for other in others}


_Runs = Mapping[str, Mapping[Preset, Sequence[FilterRun]]]
"""Our runs by log and preset."""


def paired_rows(ours: _Runs, others: Mapping[str, ReferenceRuns]) -> list[PairedRow]:
    """Return a row per preset and log and, for several logs, one for all; odometry alone has no row."""
    found = []
    for preset in PRESETS:
        rows = [_paired_row(log, preset, by[preset], others[log].runs) for log, by in ours.items()]
        found += rows
        if len(rows) > 1:
            found.append(_overall_row(preset, rows, ours, others))
    return found


def is_as_good(found: Sequence[PairedRow], ours: _Runs, others: Mapping[str, ReferenceRuns]) -> bool:
    """Return whether preset `chapter` has no larger error over all logs, and no larger share of lost runs."""
    preset = PRESETS[0]
    ratio = [row.ratio for row in found if row.preset == preset][-1]
    lost = [run.lost for by_preset in ours.values() for run in by_preset[preset]]
    their = [run.lost for log in ours for run in others[log].runs]
    return ratio <= 1.0 and sum(lost) / len(lost) <= sum(their) / len(their)


def _paired_row(
    log: str, preset: str, runs: Sequence[FilterRun], others: Sequence[ReferenceRun]
) -> PairedRow:
    ours, theirs = (np.array([run.rmse for run in side]) for side in (runs, others))
    low, high = np.percentile(bootstrap_means(ours) / bootstrap_means(theirs), (2.5, 97.5)).tolist()
    nees = [
        [float(np.median(run.nees)) for run in runs],
        [run.nmed for run in others if run.nmed is not None],
    ]
    return PairedRow(
        log=log,
        preset=preset,
        ours=float(ours.mean()),
        theirs=float(theirs.mean()),
        ratio=float(ours.mean() / theirs.mean()),
        low=low,
        high=high,
        lost=f"{_lost_text(runs)}, {_lost_text(others)}",
        nees=", ".join(f"{np.median(values):.2f}" if values else "-" for values in nees),
    )


def _overall_row(
    preset: Preset, rows: Sequence[PairedRow], ours: _Runs, others: Mapping[str, ReferenceRuns]
) -> PairedRow:
    logs = np.log([(row.ours, row.theirs, row.ratio) for row in rows])
    low, high = np.exp(np.percentile(bootstrap_means(logs[:, 2]), (2.5, 97.5))).tolist()
    own = [run for row in rows for run in ours[row.log][preset]]
    their = [run for row in rows for run in others[row.log].runs]
    mean, other, ratio = np.exp(logs.mean(axis=0)).tolist()
    lost = f"{_lost_text(own)}, {_lost_text(their)}"
    return PairedRow(
        f"all {len(rows)}",
        preset,
        ours=mean,
        theirs=other,
        ratio=ratio,
        low=low,
        high=high,
        lost=lost,
        nees="",
    )


def _lost_text(runs: Sequence[FilterRun] | Sequence[ReferenceRun]) -> str:
    return f"{sum(run.lost for run in runs)}/{len(runs)}"


def _display_row(row: PairedRow) -> dict[str, str]:
    return {
        "log": row.log,
        "preset": row.preset,
        "error, m": f"{row.ours:.3f}",
        "other's": f"{row.theirs:.3f}",
        "ratio": f"{row.ratio:.2f} [{row.low:.2f}, {row.high:.2f}]",
        "lost": row.lost,
        "NEES": row.nees,
    }


def check(source: Path, seeds: int = 1, other: Path | None = None) -> BenchmarkResult:
    """Run each preset, and the odometry alone, on each log.

    `source`: a log, or a folder with logs, *.zip. `seeds`: number of filter seeds, from 1. `other`: results
    of another localisation on the same logs (docs/localisation-log.md); the claim holds if preset `chapter`
    has no larger error over all logs and no larger share of lost runs. Raises CourseLogError.
    """
    reference = None if other is None else load_reference_runs(other)
    runs = {file.stem: _run_all(file, seeds) for file in _log_files(source, other, reference)}
    by_log: dict[str, Any] = {
        log: {preset: [one.figures() for one in rows] for preset, rows in by_preset.items()}
        for log, by_preset in runs.items()
    }
    figures = by_log if source.is_dir() else next(iter(by_log.values()))
    if reference is None:
        tables = [
            make_table([{"preset": preset, **table_row(rows)} for preset, rows in by_preset.items()], log)
            for log, by_preset in runs.items()
        ]
        return BenchmarkResult(figures, [*tables, LEGEND])
    rows = paired_rows(runs, reference)
    table = make_table(
        [_display_row(row) for row in rows], "compared with another localisation on the same logs"
    )
    figures = {"logs": figures, "against": [asdict(row) for row in rows]}
    return BenchmarkResult(figures, [table], is_as_good(rows, runs, reference))


def _log_files(
    source: Path, other: Path | None, reference: dict[str, ReferenceRuns] | None
) -> Sequence[Path]:
    files = sorted(source.glob("*.zip")) if source.is_dir() else [source]
    if not files:
        raise CourseLogError(f"{source}: contains no log (*.zip).")
    if reference is None:
        return files
    unknown = [file.stem for file in files if file.stem not in reference]
    if unknown:
        raise CourseLogError(
            f"{other}: the log {unknown[0]!r} is missing; every log must be listed with its runs."
        )
    return files


def _run_all(file: Path, seeds: int) -> dict[Preset, list[FilterRun]]:
    course = read_course(file)

    def run(preset: Preset, seed: int) -> FilterRun:
        track = replay(course, localisation(course, preset, seed))
        return errors_against_truth(seed, course.truth, course.odometry, track)

    presets: tuple[Preset, ...] = (*PRESETS, "odometry")
    return {preset: [run(preset, 1 + seed) for seed in range(seeds)] for preset in presets}
