"""The runs of one cell together, with what chance may have done to them, as tables."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.table import Table

from benchmarks.localisation.cells import CourseCell, doses, view
from benchmarks.localisation.course import STEP_US
from benchmarks.localisation.metrics import BEYOND, FOUND, LOST, NEES_BOUNDS, FilterRun, finite
from benchmarks.statistics.measured import proportion

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


def interval(squares: "np.typing.NDArray[np.float64]") -> tuple[float, float]:
    """The bootstrap's 95 % interval of the root of the mean of (runs,) mean squares."""
    low, high = np.percentile(np.sqrt(resampled(squares)), (2.5, 97.5)).tolist()
    return low, high


def resampled(values: "np.typing.NDArray[np.float64]") -> "np.typing.NDArray[np.float64]":
    """(_RESAMPLES,): means of as many values, drawn with replacement."""
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    means: np.typing.NDArray[np.float64] = values[draws].mean(axis=1)
    return means


def share(count: int, of: int) -> Share:
    """With Wilson's interval, which holds for 0 and all as well."""
    if not of:
        return Share(0, 0, 0.0, 1.0)
    return Share(count, of, *proportion(count, of)[1:])


FROM_NOWHERE = ("global", "kidnapped")
"""Sections in which the question is whether the robot finds itself."""
FIGURES = (
    "rmse", "median run", "median", "max", f"> {BEYOND:g} m", "lost", "NEES", "low/high", "told", "false",
    "µs",
)  # fmt: skip
TITLES = {
    "alone": "alone: nobody near",
    "realistic": "realistic: four others near for 15 s of every minute",
    "tracking": "tracking: others near all the time, the worst case",
    "crowd": "crowd: ten others near all the time",
    "causes": "causes: one at a time, from what the chapter's simulation had",
    "range": "range: what the sensor sees as far as its file says, and as far as Stage lets it",
    "mask": "mask: peers' positions told once a second, 0.2 s late, ± 0.1 m",
    "global": "global: the start is not told",
    "kidnapped": "kidnapped: carried elsewhere while driving",
}


def tracking_table(section: str, rows: Iterable[tuple[CourseCell, Summary]]) -> Table:
    """A row per cell. Lengths in m, 95 % intervals in brackets."""
    mask = {"mask": ("mask",), "causes": ("dose",)}.get(section, ())
    table = _table(("map", "view", "odometry", "robots", "preset", *mask, *FIGURES), TITLES[section])
    for cell, one in rows:
        switch = "on" if cell.arm.masked else "off"
        special = {"mask": (switch,), "causes": (doses(cell.course),)}.get(section, ())
        table.add_row(Path(cell.course.plan).stem, *_course(cell), *special, *_figures(one))
    return table


def log_table(title: str, rows: Iterable[tuple[str, Summary]]) -> Table:
    """A row per preset."""
    table = _table(("preset", *FIGURES), title)
    for preset, one in rows:
        table.add_row(preset, *_figures(one))
    return table


def finding_table(
    section: str, rows: Iterable[tuple[CourseCell, Sequence[Share]]], after: Sequence[float]
) -> Table:
    """A row per cell: how many had found themselves so many seconds after."""
    columns = ("map", "view", "odometry", "robots", "preset", "recovery")
    table = _table((*columns, *(f"after {seconds:g} s" for seconds in after)), TITLES[section])
    for cell, shares in rows:
        table.add_row(
            Path(cell.course.plan).stem,
            *_course(cell),
            "on" if cell.arm.recovery else "off",
            *map(_share, shares),
        )
    return table


def found(cell: CourseCell, runs: Sequence[FilterRun], after: Sequence[float], step: float) -> list[Share]:
    """How many of a cell's runs had found themselves so long after the start, or after being carried."""
    begin = cell.course.carried_at or 0.0
    steps = [round((begin + seconds) / step) for seconds in after]
    return [share(sum(run.found(at) for run in runs), len(runs)) for at in steps]


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


def verdict(cell: CourseCell, one: Summary) -> dict[str, Any] | None:
    """A cell beside its goal, if it has one."""
    if cell.goal is None:
        return None
    rmse, lost = cell.goal.rmse, cell.goal.lost
    reached = (rmse is None or one.rmse <= rmse) and one.lost.count <= lost * one.runs
    return {"cell": cell.name, "rmse_goal": rmse, "lost_goal": lost, "runs": one.runs, "reached": reached}


def sentence(cell: CourseCell, one: Summary) -> str:
    """The same as a line."""
    told = verdict(cell, one)
    assert told is not None and cell.goal is not None
    asked = 20 if cell.goal.rmse is None else 100
    few = "" if one.runs >= asked else f" (with {one.runs} runs only; {asked} are asked for)"
    lost = f"at most {cell.goal.lost:.0%} lost" if cell.goal.lost else "none lost"
    rmse = "" if cell.goal.rmse is None else f"rmse ≤ {cell.goal.rmse:g} m and "
    return f"goal, {cell.name}: {rmse}{lost}: {'reached' if told['reached'] else 'MISSED'}{few}"


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


def _course(cell: CourseCell) -> tuple[str, str, str, str]:
    course = cell.course
    robots = f"{course.robots} at times" if course.at_times else str(course.robots)
    degrees, _, rest = view(course).partition("-")
    return f"{degrees}° {rest}".rstrip(), course.base, robots, cell.arm.preset


def _share(one: Share) -> str:
    return f"{one.count}/{one.of} [{one.low:.0%}, {one.high:.0%}]"
