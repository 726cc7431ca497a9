"""Our filter fed with courses from logs, and beside another one that was fed with them."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.localisation import against, log_reader, report
from benchmarks.localisation.cells import PRESETS
from benchmarks.localisation.course import Course
from benchmarks.localisation.filters import Arm, Preset
from benchmarks.localisation.log import LogError
from benchmarks.localisation.metrics import Run, beside_truth
from benchmarks.localisation.replay import replay
from benchmarks.localisation.summary import summary


def run(source: Path, seeds: int = 1, other: Path | None = None, json_output: bool = False) -> dict[str, Any]:
    """Feed each preset, and the odometry alone, with each log; print and give what came of it.

    `source`: a log, or a folder with logs, *.zip. `seeds`: of the filter's own chance, from 1 on. `other`:
    what another localisation made of the same logs (docs/localisation-log.md). Raises LogError.
    """
    known = None if other is None else against.load(other)
    runs = {file.stem: _fed(file, seeds) for file in _logs(source, other, known)}
    told: dict[str, Any] = {
        log: {preset: [one.figures() for one in its] for preset, its in by_preset.items()}
        for log, by_preset in runs.items()
    }
    figures = told if source.is_dir() else next(iter(told.values()))
    console = Console() if sys.stdout.isatty() else Console(width=report.WIDTH)
    if known is not None:
        beside = {log: {str(preset): by[preset] for preset in PRESETS} for log, by in runs.items()}
        rows = against.rows(beside, known)
        figures = {"logs": figures, "against": [asdict(row) for row in rows]}
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
        return figures
    if known is not None:
        console.print(against.table(rows))
        return figures
    for log, by_preset in runs.items():
        console.print(report.log_table(log, [(preset, summary(its)) for preset, its in by_preset.items()]))
    console.print(report.legend(), highlight=False)
    return figures


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
