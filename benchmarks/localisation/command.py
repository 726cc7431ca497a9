"""`acrc bench localisation`: every cell measured and printed beside its goal."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from benchmarks.localisation import log, report
from benchmarks.localisation.cells import COST, CourseCell, Extent, cells, chosen
from benchmarks.localisation.course import STEP_US, made
from benchmarks.localisation.metrics import Run
from benchmarks.localisation.pool import Key, processors, run_all, tasks
from benchmarks.localisation.speed import BEAMS, GOAL_US, PARTICLES, UpdateCost, update_costs
from benchmarks.localisation.summary import Summary, summary

_EXTENT: Final = Extent()


def run(
    corridor: Path,
    others: Sequence[Path],
    patterns: Sequence[str] = (),
    extent: Extent = _EXTENT,
    workers: int | None = None,
    json_output: bool = False,
) -> dict[str, Any]:
    """Measure the cells that match, and print and give their figures.

    `corridor`: map file of the chapter's floor; `others`: of some without symmetry. `workers`: processes, as
    many as there are processors if None; the figures, but for CPU times, do not depend on it. Raises
    CellError, MapError.
    """
    everything = cells(str(corridor), [str(other) for other in others], extent)
    wanted = [pattern for pattern in patterns if pattern != COST]
    todo = chosen(everything, wanted) if wanted or not patterns else []
    costs = update_costs(str(corridor)) if COST in patterns or not patterns else []
    runs = _runs(todo, workers or processors())
    by_cell = [(cell, _of(cell, runs)) for cell in todo]
    figures = _figures(by_cell, costs, extent)
    if json_output:
        sys.stdout.write(json.dumps(figures) + "\n")
    else:
        _print(by_cell, costs, extent)
    return figures


def write_log(
    file: Path,
    corridor: Path,
    others: Sequence[Path],
    patterns: Sequence[str],
    seed: int,
    extent: Extent = _EXTENT,
) -> None:
    """Write the course of the first cell that matches, from that seed.

    Raises CellError, LogError, MapError.
    """
    everything = cells(str(corridor), [str(other) for other in others], extent)
    cell = chosen(everything, patterns or ("realistic",))[0]
    course = made(replace(cell.course, seed=seed))
    log.write(file, course)
    size = file.stat().st_size / 1e6
    Console(stderr=True).print(
        f"{file}: the course of {cell.name}, seed {seed}: {len(course.instants)} poses, {len(course.scans)} "
        f"scans, {size:.1f} MB",
        highlight=False,
        soft_wrap=True,
    )


def _runs(todo: Sequence[CourseCell], workers: int) -> Any:
    courses = tasks(todo)
    console = Console(stderr=True)
    every = max(1, len(courses) // 10)

    def tell(done: int) -> None:
        if done % every == 0 or done == len(courses):
            console.print(f"{done} of {len(courses)} courses …", highlight=False)

    return run_all(courses, min(workers, max(len(courses), 1)), tell)


def _of(cell: CourseCell, runs: dict[Key, Run]) -> list[Run]:
    return [runs[replace(cell.course, seed=seed), cell.arm] for seed in range(1, cell.runs + 1)]


def _figures(
    by_cell: Sequence[tuple[CourseCell, Sequence[Run]]], costs: Sequence[UpdateCost], extent: Extent
) -> dict[str, Any]:
    told = []
    for cell, runs in by_cell:
        one = summary(runs)
        told.append(
            {
                "cell": cell.name,
                "summary": asdict(one),
                "found": [asdict(share) for share in report.found(cell, runs, extent.after, STEP_US / 1e6)]
                if cell.section in report.FROM_NOWHERE
                else None,
                "goal": report.verdict(cell, one),
                "runs": [run.figures() for run in runs],
            }
        )
    return {"extent": asdict(extent), "cells": told, "updates": [asdict(cost) for cost in costs]}


def _console() -> Console:
    """As wide as the terminal, or, in a file, as the tables."""
    return Console() if sys.stdout.isatty() else Console(width=report.WIDTH)


def _print(
    by_cell: Sequence[tuple[CourseCell, Sequence[Run]]], costs: Sequence[UpdateCost], extent: Extent
) -> None:
    console = _console()
    summaries: list[tuple[CourseCell, Summary]] = [(cell, summary(runs)) for cell, runs in by_cell]
    for section in dict.fromkeys(cell.section for cell, _ in by_cell):
        if section in report.FROM_NOWHERE:
            shares = [
                (cell, report.found(cell, runs, extent.after, STEP_US / 1e6))
                for cell, runs in by_cell
                if cell.section == section
            ]
            console.print(report.finding_table(section, shares, extent.after))
        else:
            its = [(cell, one) for cell, one in summaries if cell.section == section]
            console.print(report.tracking_table(section, its))
    if by_cell:
        console.print(report.legend(), highlight=False)
    for cell, one in summaries:
        if cell.goal is not None:
            console.print(report.sentence(cell, one), highlight=False, soft_wrap=True)
    for cost in costs:
        console.print(
            f"one update, {cost.preset}, {PARTICLES} particles, {BEAMS} beams: {cost.min_us:.0f} µs of CPU "
            f"(mean {cost.mean_us:.0f}); goal, at most {GOAL_US:g} µs: "
            f"{'reached' if cost.goal_met else 'MISSED'}",
            highlight=False,
            soft_wrap=True,
        )
