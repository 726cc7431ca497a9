"""Our particle filter on logged courses, beside the results of another localisation on the same logs."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from benchmarks.localisation import log
from benchmarks.localisation.log import Course, CourseLogError
from benchmarks.localisation.tracking import (
    BEYOND,
    FOUND,
    LOST,
    NEES_BOUNDS,
    PRESETS,
    STEP_US,
    FilterRun,
    Preset,
    beside_truth,
    finite,
    localisation,
    replay,
)
from benchmarks.measured import Measured, proportion

_RESAMPLES: Final = 2000


@dataclass(frozen=True)
class Share:
    """How many of all, with the 95 % interval of the share (Wilson, JASA 22(158), 1927)."""

    count: int
    of: int
    low: float
    high: float


@dataclass(frozen=True)
class Summary:
    """All runs of a cell, every seed counted."""

    runs: int
    rmse: float
    """Over all poses of all runs, m."""
    rmse_low: float
    rmse_high: float
    """Its 95 % interval: percentiles of a bootstrap over the runs (Efron and Tibshirani 1993, chapter 13)."""
    rmse_median_run: float
    """Of the runs' own values, m."""
    median: float
    """Error over all poses, m."""
    max: float
    share_beyond: float
    """Of the time with an error above BEYOND."""
    lost: Share
    nees_median: float | None
    """Over the steps with an error up to BEYOND."""
    nees_below: float
    nees_above: float
    """Shares of the time outside NEES_BOUNDS; 2.5 % each where the covariance is right."""
    spells: Share
    """Of the spells of being lost those that were announced."""
    false_alarms: int
    hours: float
    """Of robots under way."""
    cpu_us_mean: float | None
    """CPU time per call that weighed a scan, µs; the minimum over all runs beside it."""
    cpu_us_min: float | None


def summary(runs: Sequence[FilterRun]) -> Summary:
    """What the runs of a cell, at least one, come to."""
    squares = np.array([run.mean_square for run in runs])
    errors = np.concatenate([run.errors for run in runs])
    consistency = np.concatenate([run.tracking for run in runs])
    spells = [announced for run in runs for announced in run.spells]
    costs = np.concatenate([run.costs for run in runs])
    low, high = interval(squares)
    return Summary(
        runs=len(runs),
        rmse=math.sqrt(squares.mean()),
        rmse_low=low,
        rmse_high=high,
        rmse_median_run=float(np.median(np.sqrt(squares))),
        median=float(np.median(errors)),
        max=float(errors.max()),
        share_beyond=float(np.mean(errors > BEYOND)),
        lost=share(sum(run.lost for run in runs), len(runs)),
        nees_median=finite(np.median(consistency)) if consistency.size else None,
        nees_below=float(np.mean(consistency < NEES_BOUNDS[0])) if consistency.size else 0.0,
        nees_above=float(np.mean(consistency > NEES_BOUNDS[1])) if consistency.size else 0.0,
        spells=share(sum(spells), len(spells)),
        false_alarms=sum(run.false_alarms for run in runs),
        hours=errors.size * STEP_US / 3.6e9,
        cpu_us_mean=float(costs.mean() * 1e6) if costs.size else None,
        cpu_us_min=float(costs.min() * 1e6) if costs.size else None,
    )


def interval(squares: NDArray[np.float64]) -> tuple[float, float]:
    """The bootstrap's 95 % interval of the root of the mean of (runs,) mean squares."""
    low, high = np.percentile(np.sqrt(resampled(squares)), (2.5, 97.5)).tolist()
    return low, high


def resampled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(_RESAMPLES,): means of as many values, drawn with replacement."""
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    means: NDArray[np.float64] = values[draws].mean(axis=1)
    return means


def share(count: int, of: int) -> Share:
    """With Wilson's interval, which holds for 0 and all as well."""
    if not of:
        return Share(0, 0, 0.0, 1.0)
    return Share(count, of, *proportion(count, of)[1:])


FIGURES = (
    "rmse", "median run", "median", "max", f"> {BEYOND:g} m", "lost", "NEES", "low/high", "told", "false",
    "µs",
)  # fmt: skip


def log_table(title: str, rows: Iterable[tuple[str, Summary]]) -> Table:
    """A row per preset."""
    table = _table(("preset", *FIGURES), title)
    for preset, one in rows:
        table.add_row(preset, *_figures(one))
    return table


def legend() -> str:
    """What the columns mean."""
    return (
        "rmse: over all poses of all runs [95 % by bootstrap over runs]; median run: of the runs' own rmse; "
        f"lost: > {LOST:g} m off at the end, of all runs [95 %, Wilson]; NEES: median while at most "
        f"{BEYOND:g} m off, where 2.37 is right; "
        "low/high: share of that time below and above its two-sided 95 % bounds, where 2.5 % each is right; "
        f"told: spells of being lost that the robot announced, of all that took 3 s; false: announcements "
        f"while it was at most {BEYOND:g} m off for 5 s before and after; "
        f"µs: CPU per update, mean (minimum). Found: within {FOUND[0]:g} m and 15° at that time."
    )


def _table(columns: Iterable[str], title: str) -> Table:
    table = Table(title=title)
    for column in columns:
        table.add_column(column, no_wrap=True)
    return table


def _figures(one: Summary) -> tuple[str, ...]:
    return (
        f"{one.rmse:.3f} [{one.rmse_low:.2f}, {one.rmse_high:.2f}]",
        f"{one.rmse_median_run:.3f}",
        f"{one.median:.3f}",
        f"{one.max:.2f}",
        f"{one.share_beyond:.1%}",
        _share(one.lost),
        "∞" if one.nees_median is None else f"{one.nees_median:.2f}",
        f"{one.nees_below:.0%}/{one.nees_above:.0%}",
        f"{one.spells.count}/{one.spells.of}",
        f"{one.false_alarms} in {one.hours:.1f} h",
        "-" if one.cpu_us_mean is None else f"{one.cpu_us_mean:.0f} ({one.cpu_us_min:.0f})",
    )


def _share(one: Share) -> str:
    return f"{one.count}/{one.of} [{one.low:.0%}, {one.high:.0%}]"


_LARGEST: Final = 10_000_000


class OtherRun(msgspec.Struct):
    """What another localisation made of a log, from one seed; fields that are not needed may be there too."""

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


def paired(
    ours: Mapping[str, Mapping[str, Sequence[FilterRun]]], others: Mapping[str, Other]
) -> list[PairedRow]:
    """A row per preset and log, and one for all logs. `ours`: runs by log and preset, as others have them."""
    found = []
    for preset in dict.fromkeys(preset for by_preset in ours.values() for preset in by_preset):
        its = [_row(log, preset, by[preset], others[log]) for log, by in ours.items()]
        found += its
        if len(its) > 1:
            found.append(_together(preset, its, ours, others))
    return found


def as_good(
    found: Sequence[PairedRow],
    ours: Mapping[str, Mapping[str, Sequence[FilterRun]]],
    others: Mapping[str, Other],
    preset: str,
) -> bool:
    """Whether that preset errs no more than the other one, over all logs, and is lost no more often."""
    ratio = [row.ratio for row in found if row.preset == preset][-1]
    lost = sum(run.lost for by_preset in ours.values() for run in by_preset[preset])
    of = sum(len(by_preset[preset]) for by_preset in ours.values())
    their = [run.lost for log in ours for run in others[log].runs]
    return ratio <= 1.0 and lost / of <= sum(their) / len(their)


def paired_table(found: Sequence[PairedRow]) -> Table:
    """For people."""
    shown = Table(title="beside another localisation, on the same logs")
    for column in ("log", "preset", "error, m", "other's", "ratio", "lost", "NEES"):
        shown.add_column(column, no_wrap=True)
    for row in found:
        ratio = f"{row.ratio:.2f} [{row.low:.2f}, {row.high:.2f}]"
        shown.add_row(row.log, row.preset, f"{row.ours:.3f}", f"{row.theirs:.3f}", ratio, row.lost, row.nees)
    return shown


def _row(log: str, preset: str, runs: Sequence[FilterRun], other: Other) -> PairedRow:
    ours = np.array([run.rmse for run in runs])
    theirs = np.array([run.rmse for run in other.runs])
    drawn = resampled(ours) / resampled(theirs)
    low, high = np.percentile(drawn, (2.5, 97.5)).tolist()
    lost = f"{sum(run.lost for run in runs)}/{len(runs)}, {sum(run.lost for run in other.runs)}/{len(theirs)}"
    nees = (_median([float(np.median(run.nees)) for run in runs]), _median([r.nmed for r in other.runs]))
    return PairedRow(
        log=log,
        preset=preset,
        ours=float(ours.mean()),
        theirs=float(theirs.mean()),
        ratio=float(ours.mean() / theirs.mean()),
        low=low,
        high=high,
        lost=lost,
        nees=f"{nees[0]}, {nees[1]}",
    )


def _together(
    preset: str,
    its: Sequence[PairedRow],
    ours: Mapping[str, Mapping[str, Sequence[FilterRun]]],
    others: Mapping[str, Other],
) -> PairedRow:
    ratios = np.log([row.ratio for row in its])
    low, high = np.exp(np.percentile(resampled(ratios), (2.5, 97.5))).tolist()
    own = [run.lost for row in its for run in ours[row.log][preset]]
    their = [run.lost for row in its for run in others[row.log].runs]
    return PairedRow(
        log=f"all {len(its)}",
        preset=preset,
        ours=_geometric([row.ours for row in its]),
        theirs=_geometric([r.theirs for r in its]),
        ratio=float(np.exp(ratios.mean())),
        low=low,
        high=high,
        lost=f"{sum(own)}/{len(own)}, {sum(their)}/{len(their)}",
        nees="",
    )


def _geometric(values: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(values))))


def _median(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    return f"{np.median(known):.2f}" if known else "-"


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
            log_table(log, [(preset, summary(its)) for preset, its in by_preset.items()])
            for log, by_preset in runs.items()
        ]
        return Measured(figures, [*tables, legend()])
    beside = {log: {str(preset): by[preset] for preset in PRESETS} for log, by in runs.items()}
    rows = paired(beside, known)
    figures = {"logs": figures, "against": [asdict(row) for row in rows]}
    return Measured(figures, (paired_table(rows),), as_good(rows, beside, known, PRESETS[0]))


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
    course = log.read(file)
    return {
        preset: [_run(course, preset, 1 + seed) for seed in range(seeds)] for preset in (*PRESETS, "odometry")
    }


def _run(course: Course, preset: Preset, seed: int) -> FilterRun:
    track = replay(course, localisation(course, preset, seed))
    return beside_truth(seed, course.truth, course.odometry, track)
