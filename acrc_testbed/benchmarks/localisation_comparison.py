"""Our particle filter on logged courses, beside the results of another localisation on the same logs."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from acrc_testbed.benchmarks.localisation_tracking import (
    BEYOND,
    LOST,
    NEES_BOUNDS,
    PRESETS,
    STEP_US,
    CourseLogError,
    FilterRun,
    Preset,
    beside_truth,
    localisation,
    read,
    replay,
)
from acrc_testbed.benchmarks.measured import Measured, table_of
from acrc_testbed.experiments.paired_tests import Interval

_RESAMPLES: Final = 2000


def resampled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (_RESAMPLES,) means of as many values, drawn with replacement."""
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    means: NDArray[np.float64] = values[draws].mean(axis=1)
    return means


def root_mean_square(runs: Sequence[FilterRun]) -> Interval:
    """Return the error over all poses of all runs, m, with the 95 % interval of a bootstrap over the runs.

    Percentiles of the bootstrap: Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13.
    """
    squares = np.array([run.mean_square for run in runs])
    low, high = np.percentile(np.sqrt(resampled(squares)), (2.5, 97.5)).tolist()
    return Interval(math.sqrt(squares.mean()), low, high)


def table_row(runs: Sequence[FilterRun]) -> dict[str, str]:
    """Return the columns of a table, as LEGEND describes them, for at least one run."""
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
        f"> {BEYOND:g} m": f"{np.mean(errors > BEYOND):.1%}",
        "lost": f"{lost}/{len(runs)} [{share.low:.0%}, {share.high:.0%}]",
        "NEES": f"{np.median(nees):.2f}" if nees.size and math.isfinite(np.median(nees)) else "∞",
        "low/high": "/".join(f"{one:.0%}" for one in outside),
        "told": f"{sum(spells)}/{len(spells)}",
        "false": f"{sum(run.false_alarms for run in runs)} in {errors.size * STEP_US / 3.6e9:.1f} h",
        "µs": f"{costs.mean():.0f} ({costs.min():.0f})" if costs.size else "-",
    }


LEGEND: Final = (
    "rmse: over all poses of all runs [95 % by bootstrap over runs]; median run: of the runs' own rmse; "
    f"lost: > {LOST:g} m off at the end, of all runs [95 %, Wilson]; NEES: median while at most {BEYOND:g} m "
    "off, where 2.37 is right; low/high: share of that time below and above its two-sided 95 % bounds, where "
    "2.5 % each is right; told: spells of being lost that the robot announced, of all that took 3 s; false: "
    f"announcements while it was at most {BEYOND:g} m off for 5 s before and after; µs: CPU per update, mean "
    "(minimum)."
)


_LARGEST: Final = 10_000_000


class OtherRun(msgspec.Struct):
    """Result of another localisation on a log, from one seed; further fields are ignored."""

    rmse: float
    """Over all poses, m."""
    lost: bool
    """More than 1 m off at the end."""
    nmed: float | None = None
    """Median of the normalised error (NEES)."""


class Other(msgspec.Struct):
    """All runs on one log."""

    log: str
    """The log's file name, without .zip."""
    runs: list[OtherRun]


@dataclass(frozen=True)
class PairedRow:
    """One log, or all of them together."""

    log: str
    preset: str
    ours: float
    """Mean error, m; of all logs, the geometric mean."""
    theirs: float
    ratio: float
    low: float
    high: float
    """The ratio of the two, with its 95 % interval: a bootstrap over the runs of each, and over the logs."""
    lost: str
    """Runs, ours and theirs."""
    nees: str
    """Median over the runs, ours and theirs."""


def load_other(file: Path) -> dict[str, Other]:
    """By log, what another localisation made of it. Raises LogError."""
    try:
        with file.open("rb") as stream:
            data = stream.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise CourseLogError(f"{file}: may have at most {_LARGEST} bytes, and has more.")
        others = msgspec.json.decode(data, type=list[Other])
    except OSError as error:
        raise CourseLogError(f"{file}: cannot be read: {error.strerror}.") from None
    except (msgspec.DecodeError, RecursionError) as error:
        raise CourseLogError(
            f"{file}: must be a list of logs, each with its runs (docs/localisation-log.md): {error}."
        ) from None
    for other in others:
        if not other.runs or not all(math.isfinite(run.rmse) and run.rmse > 0 for run in other.runs):
            raise CourseLogError(f"{file}: {other.log[:80]}: must have runs, each with an rmse above 0.")
    return {other.log: other for other in others}


_Runs = Mapping[str, Mapping[Preset, Sequence[FilterRun]]]
"""Our runs by log and preset."""


def paired(ours: _Runs, others: Mapping[str, Other]) -> list[PairedRow]:
    """Return a row per preset and log and, of several logs, one for all of them; odometry alone has none."""
    found = []
    for preset in PRESETS:
        its = [_row(log, preset, by[preset], others[log].runs) for log, by in ours.items()]
        found += its
        if len(its) > 1:
            found.append(_together(preset, its, ours, others))
    return found


def as_good(found: Sequence[PairedRow], ours: _Runs, others: Mapping[str, Other]) -> bool:
    """Return whether preset `chapter` errs no more than the other one over all logs, and is lost no more."""
    preset = PRESETS[0]
    ratio = [row.ratio for row in found if row.preset == preset][-1]
    lost = [run.lost for by_preset in ours.values() for run in by_preset[preset]]
    their = [run.lost for log in ours for run in others[log].runs]
    return ratio <= 1.0 and sum(lost) / len(lost) <= sum(their) / len(their)


def _row(log: str, preset: str, runs: Sequence[FilterRun], others: Sequence[OtherRun]) -> PairedRow:
    ours, theirs = (np.array([run.rmse for run in side]) for side in (runs, others))
    low, high = np.percentile(resampled(ours) / resampled(theirs), (2.5, 97.5)).tolist()
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
        lost=f"{_lost(runs)}, {_lost(others)}",
        nees=", ".join(f"{np.median(known):.2f}" if known else "-" for known in nees),
    )


def _together(
    preset: Preset, its: Sequence[PairedRow], ours: _Runs, others: Mapping[str, Other]
) -> PairedRow:
    logs = np.log([(row.ours, row.theirs, row.ratio) for row in its])
    low, high = np.exp(np.percentile(resampled(logs[:, 2]), (2.5, 97.5))).tolist()
    own = [run for row in its for run in ours[row.log][preset]]
    their = [run for row in its for run in others[row.log].runs]
    mean, other, ratio = np.exp(logs.mean(axis=0)).tolist()
    lost = f"{_lost(own)}, {_lost(their)}"
    return PairedRow(
        f"all {len(its)}",
        preset,
        ours=mean,
        theirs=other,
        ratio=ratio,
        low=low,
        high=high,
        lost=lost,
        nees="",
    )


def _lost(runs: Sequence[FilterRun] | Sequence[OtherRun]) -> str:
    return f"{sum(run.lost for run in runs)}/{len(runs)}"


def _table_row(row: PairedRow) -> dict[str, str]:
    return {
        "log": row.log,
        "preset": row.preset,
        "error, m": f"{row.ours:.3f}",
        "other's": f"{row.theirs:.3f}",
        "ratio": f"{row.ratio:.2f} [{row.low:.2f}, {row.high:.2f}]",
        "lost": row.lost,
        "NEES": row.nees,
    }


def check(source: Path, seeds: int = 1, other: Path | None = None) -> Measured:
    """Feed each preset, and the odometry alone, with each log.

    `source`: a log, or a folder with logs, *.zip. `seeds`: of the filter's own chance, from 1 on. `other`:
    what another localisation made of the same logs (docs/localisation-log.md); it holds where preset
    `chapter` errs no more than that one over all logs, and is lost no more often. Raises LogError.
    """
    known = None if other is None else load_other(other)
    runs = {file.stem: _run_all(file, seeds) for file in _logs(source, other, known)}
    told: dict[str, Any] = {
        log: {preset: [one.figures() for one in its] for preset, its in by_preset.items()}
        for log, by_preset in runs.items()
    }
    figures = told if source.is_dir() else next(iter(told.values()))
    if known is None:
        tables = [
            table_of([{"preset": preset, **table_row(its)} for preset, its in by_preset.items()], log)
            for log, by_preset in runs.items()
        ]
        return Measured(figures, [*tables, LEGEND])
    rows = paired(runs, known)
    table = table_of([_table_row(row) for row in rows], "beside another localisation, on the same logs")
    figures = {"logs": figures, "against": [asdict(row) for row in rows]}
    return Measured(figures, [table], as_good(rows, runs, known))


def _logs(source: Path, other: Path | None, known: dict[str, Other] | None) -> Sequence[Path]:
    files = sorted(source.glob("*.zip")) if source.is_dir() else [source]
    if not files:
        raise CourseLogError(f"{source}: this folder holds no log, which would be a *.zip.")
    if known is None:
        return files
    unknown = [file.stem for file in files if file.stem not in known]
    if unknown:
        raise CourseLogError(
            f"{other}: says nothing of the log {unknown[0]!r}; it must have every log's runs."
        )
    return files


def _run_all(file: Path, seeds: int) -> dict[Preset, list[FilterRun]]:
    course = read(file)

    def run(preset: Preset, seed: int) -> FilterRun:
        track = replay(course, localisation(course, preset, seed))
        return beside_truth(seed, course.truth, course.odometry, track)

    presets: tuple[Preset, ...] = (*PRESETS, "odometry")
    return {preset: [run(preset, 1 + seed) for seed in range(seeds)] for preset in presets}
