"""Every cell of localisation measured beside its goal, and what is done with single courses instead."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from rich.table import Table

from actors.console import screen
from actors.installation.repository import SHIPPED
from actors.installation.usage import OptionError
from benchmarks.localisation import log as course_log
from benchmarks.localisation import logs, report
from benchmarks.localisation.cells import COST, CourseCell, Extent, cells, chosen
from benchmarks.localisation.course import STEP_US, made
from benchmarks.localisation.metrics import FilterRun
from benchmarks.localisation.report import summary
from benchmarks.localisation.runs import (
    BEAMS,
    GOAL_US,
    PARTICLES,
    Key,
    UpdateCost,
    run_all,
    tasks,
    update_costs,
)
from benchmarks.statistics.measured import Measured

_MAPS: Final = SHIPPED / "maps"
CORRIDOR: Final = _MAPS / "corridor.yaml"
OTHERS: Final = (_MAPS / "apartment.yaml", _MAPS / "maze.yaml")
"""Maps without symmetry."""
_LONG: Final = 5
"""Times as many runs for cells of the sections alone and realistic, which are nearly the same each time."""


def check(
    cell: Sequence[str] = (),
    runs: int = 20,
    duration: float = 240.0,
    workers: int | None = None,
    log: Path | None = None,
    seed: int = 1,
    source: Path | None = None,
    against: Path | None = None,
) -> Measured:
    """Measure the cells that match, with so many runs of so many simulated s each.

    `log`: only write the course of the first of them, from that seed. `source`: only feed the filter with
    a log, or a folder of them, from so many seeds, and compare it with what `against` has of them.
    """
    if log is not None and source is not None:
        raise OptionError("--log: is another thing to do than --from; give one of them")
    if against is not None and source is None:
        raise OptionError("--against: needs --from, the logs to compare on")
    if source is not None:
        return logs.check(source, runs, against)
    extent = Extent(runs, _LONG * runs, duration)
    return measured(cell, extent, workers) if log is None else write_log(log, cell, seed, extent)


def measured(patterns: Sequence[str], extent: Extent, workers: int | None = None) -> Measured:
    """The cells that match; it holds where each that has a goal reaches it.

    `workers`: processes, as many as there are processors if None; the figures, but for CPU times, do not
    depend on it. Raises CellError, MapError.
    """
    everything = cells(str(CORRIDOR), list(map(str, OTHERS)), extent)
    wanted = [pattern for pattern in patterns if pattern != COST]
    todo = chosen(everything, wanted) if wanted or not patterns else []
    costs = update_costs(str(CORRIDOR)) if COST in patterns or not patterns else []
    runs = _runs(todo, workers)
    by_cell = [(cell, _of(cell, runs)) for cell in todo]
    figures = _figures(by_cell, costs, extent)
    reached = [cell["goal"]["reached"] for cell in figures["cells"] if cell["goal"]]
    return Measured(figures, list(_shown(by_cell, costs, extent)), all(reached) if reached else None)


def write_log(file: Path, patterns: Sequence[str], seed: int, extent: Extent) -> Measured:
    """Write the course of the first cell that matches, from that seed.

    Raises CellError, LogError, MapError.
    """
    everything = cells(str(CORRIDOR), list(map(str, OTHERS)), extent)
    cell = chosen(everything, patterns or ("realistic",))[0]
    course = made(replace(cell.course, seed=seed))
    course_log.write(file, course)
    figures = {
        "file": str(file),
        "cell": cell.name,
        "poses": len(course.instants),
        "scans": len(course.scans),
    }
    size = file.stat().st_size / 1e6
    says = (
        f"{file}: the course of {cell.name}, seed {seed}: {figures['poses']} poses, {figures['scans']} "
        f"scans, {size:.1f} MB"
    )
    return Measured(figures, (says,))


def _runs(todo: Sequence[CourseCell], workers: int | None) -> Any:
    courses = tasks(todo)
    console = screen(stderr=True)
    every = max(1, len(courses) // 10)

    def tell(done: int) -> None:
        if done % every == 0 or done == len(courses):
            console.print(f"{done} of {len(courses)} courses …")

    return run_all(courses, workers, tell)


def _of(cell: CourseCell, runs: dict[Key, FilterRun]) -> list[FilterRun]:
    return [runs[replace(cell.course, seed=seed), cell.arm] for seed in range(1, cell.runs + 1)]


def _figures(
    by_cell: Sequence[tuple[CourseCell, Sequence[FilterRun]]],
    costs: Sequence[UpdateCost],
    extent: Extent,
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


def _shown(
    by_cell: Sequence[tuple[CourseCell, Sequence[FilterRun]]],
    costs: Sequence[UpdateCost],
    extent: Extent,
) -> Iterator[Table | str]:
    summaries = [(cell, summary(runs)) for cell, runs in by_cell]
    for section in dict.fromkeys(cell.section for cell, _ in by_cell):
        if section in report.FROM_NOWHERE:
            shares = [
                (cell, report.found(cell, runs, extent.after, STEP_US / 1e6))
                for cell, runs in by_cell
                if cell.section == section
            ]
            yield report.finding_table(section, shares, extent.after)
        else:
            its = [(cell, one) for cell, one in summaries if cell.section == section]
            yield report.tracking_table(section, its)
    if by_cell:
        yield report.legend()
    yield from (report.sentence(cell, one) for cell, one in summaries if cell.goal is not None)
    for cost in costs:
        yield (
            f"one update, {cost.preset}, {PARTICLES} particles, {BEAMS} beams: {cost.min_us:.0f} µs of CPU "
            f"(mean {cost.mean_us:.0f}); goal, at most {GOAL_US:g} µs: "
            f"{'reached' if cost.goal_met else 'MISSED'}"
        )
