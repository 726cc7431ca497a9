"""Our filter fed with courses from logs, and beside another one that was fed with them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from rich.table import Table

from benchmarks.localisation import log, report
from benchmarks.localisation.cells import PRESETS
from benchmarks.localisation.course import Course
from benchmarks.localisation.filters import Arm, Preset, replay
from benchmarks.localisation.log import CourseLogError
from benchmarks.localisation.metrics import FilterRun, beside_truth
from benchmarks.localisation.report import resampled, summary
from benchmarks.statistics.measured import Measured

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
    runs = {file.stem: _fed(file, seeds) for file in _logs(source, other, known)}
    told: dict[str, Any] = {
        log: {preset: [one.figures() for one in its] for preset, its in by_preset.items()}
        for log, by_preset in runs.items()
    }
    figures = told if source.is_dir() else next(iter(told.values()))
    if known is None:
        tables = [
            report.log_table(log, [(preset, summary(its)) for preset, its in by_preset.items()])
            for log, by_preset in runs.items()
        ]
        return Measured(figures, [*tables, report.legend()])
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


def _fed(file: Path, seeds: int) -> dict[Preset, list[FilterRun]]:
    course = log.read(file)
    presets: tuple[Preset, ...] = (*PRESETS, "odometry")
    return {preset: _runs(course, Arm(preset), seeds) for preset in presets}


def _runs(course: Course, arm: Arm, seeds: int) -> list[FilterRun]:
    runs = []
    for seed in range(1, seeds + 1):
        track = replay(course, arm.localisation(course, seed))
        runs.append(beside_truth(seed, course.truth, course.odometry, track))
    return runs
