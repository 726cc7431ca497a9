"""Our filter fed with courses from logs, and beside another one that was fed with them."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.localisation import against, log_reader, report
from benchmarks.localisation.cells import PRESETS
from benchmarks.localisation.course import Course
from benchmarks.localisation.filters import Arm, Preset
from benchmarks.localisation.log import LogError
from benchmarks.localisation.metrics import Run, beside_truth
from benchmarks.localisation.replay import replay
from benchmarks.localisation.summary import summary
from benchmarks.statistics.measured import Measured


def check(source: Path, seeds: int = 1, other: Path | None = None) -> Measured:
    """Feed each preset, and the odometry alone, with each log.

    `source`: a log, or a folder with logs, *.zip. `seeds`: of the filter's own chance, from 1 on. `other`:
    what another localisation made of the same logs (docs/localisation-log.md); it holds where preset
    `chapter` errs no more than that one over all logs, and is lost no more often. Raises LogError.
    """
    known = None if other is None else against.load(other)
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
    rows = against.rows(beside, known)
    figures = {"logs": figures, "against": [asdict(row) for row in rows]}
    return Measured(figures, (against.table(rows),), against.as_good(rows, beside, known, PRESETS[0]))


def _logs(source: Path, other: Path | None, known: dict[str, against.Other] | None) -> Sequence[Path]:
    files = sorted(source.glob("*.zip")) if source.is_dir() else [source]
    if not files:
        raise LogError(f"{source}: this folder holds no log, which would be a *.zip.")
    if known is None:
        return files
    unknown = [file.stem for file in files if file.stem not in known]
    if unknown:
        raise LogError(f"{other}: says nothing of the log {unknown[0]!r}; it must have every log's runs.")
    return files


def _fed(file: Path, seeds: int) -> dict[Preset, list[Run]]:
    course = log_reader.read(file)
    presets: tuple[Preset, ...] = (*PRESETS, "odometry")
    return {preset: _runs(course, Arm(preset), seeds) for preset in presets}


def _runs(course: Course, arm: Arm, seeds: int) -> list[Run]:
    runs = []
    for seed in range(1, seeds + 1):
        track = replay(course, arm.localisation(course, seed))
        runs.append(beside_truth(seed, course.truth, course.odometry, track))
    return runs
