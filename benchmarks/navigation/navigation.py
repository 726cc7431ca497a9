"""How well robots get to their goals: how many, how fast, how near to walls and to each other."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, median
from typing import Any, Final

from rich.table import Table

from actors.console import screen
from actors.installation.repository import SHIPPED
from benchmarks.navigation import goal_log, original
from benchmarks.navigation import log as cycle_log
from benchmarks.navigation.course import NavigationCourse
from benchmarks.navigation.run import Leg, RunFigures, measure
from benchmarks.statistics.measured import ConfidenceInterval, Measured, average, proportion
from benchmarks.statistics.runs import in_order
from deploy.scenario.scenario_file import settings

MAPS: Final = tuple(SHIPPED / "maps" / f"{name}.yaml" for name in ("corridor", "maze", "apartment"))
ROBOTS: Final = (1, 4)
SPEED: Final = 0.5
"""With which the shortest way is thought to be driven, m/s: DWA max_vel_x of d3scomp/ROSRemote."""
LONG: Final = 2.0
"""Only ways from here on count for how fast robots are, m; a short one is mostly turning on the spot."""


@dataclass(frozen=True)
class NavigationFigures:
    """All runs on one map with one number of robots."""

    map: str
    robots: int
    goals: int
    succeeded: int
    aborted: dict[str, int]
    """By reason, and those that ended WRONG."""
    unfinished: int
    """Goals that were open when the run's time was up."""
    slowness: float | None
    """Median, over the long ways that succeeded, of the time taken by that of the shortest way at SPEED."""
    total_slowness: float | None
    """The same of the sums."""
    robot_hours: float
    no_trajectory: float | None
    """Share, 0 to 1, of the robots' time, from the begin of each run to its end, in spells without a valid
    trajectory: from the first control cycle that had none to the next that had one, or to the goal's end.
    None if a robot had more such spells than it lists. For the compiled original the control cycles without
    one were counted, of all; a spell holds those in which it recovers and plans anew, too."""
    no_trajectory_95: tuple[float, float] | None
    """Its 95 % interval, over the runs."""
    wall_contacts: int
    robot_contacts: int
    contacts: int
    wall_gap: float
    robot_gap: float | None
    digests: tuple[str, ...]


@dataclass(frozen=True)
class NavigationTask:
    """What is to be measured."""

    maps: Sequence[Path] = MAPS
    robots: Sequence[int] = ROBOTS
    goals: int = 200
    """Of all robots together, on each map with each number of robots."""
    runs: int = 8
    seed: int = 1
    """Of the first run; each further one has the next."""
    localisation: str | None = None
    navigation: str | None = None
    settings: tuple[tuple[str, Any], ...] = ()
    """Keys of a scenario that are other than the presets have them."""
    workers: int | None = None
    """Processes; None: one per processor."""


def check(
    maps: Sequence[Path] = MAPS,
    robots: Sequence[int] = ROBOTS,
    goals: int = 200,
    runs: int = 8,
    localisation: str | None = None,
    navigation: str | None = None,
    log: Path | None = None,
    seed: int = 1,
    source: Path | None = None,
    setting: Sequence[str] = (),
) -> Measured:
    """Measure a task as `NavigationTask` has it, or only write what r1 decides in its first run.

    Or, with `source`, compare preset `chapter` with a folder of what the original decided. It holds where no
    wall is touched, or the original is met. Raises LogError, RowsError.
    """
    if source is not None:
        return original.check(source)
    presets = localisation, navigation, settings(setting)
    task = NavigationTask(tuple(maps), tuple(robots), goals, runs, seed, *presets)
    if log is not None:
        return write_log(task, log)
    figures = measured(task)
    holds = not any(one.wall_contacts for one in figures)
    return Measured([asdict(one) for one in figures], _shown(figures, holds), holds)


def measured(task: NavigationTask) -> list[NavigationFigures]:
    """Every map with every number of robots."""
    console = screen(stderr=True)
    figures = []
    for map_file in task.maps:
        for robots in task.robots:
            console.print(f"{map_file.stem}, robots {robots} …")
            courses = _courses(task, map_file, robots)
            figures.append(_summed(courses[0], list(in_order(measure, courses, task.workers))))
    return figures


def write_log(task: NavigationTask, file: Path) -> Measured:
    """Write what r1 decides in the first run on the first map, with the largest number of robots asked for.

    Raises LogError.
    """
    robots = max(task.robots)
    course = _courses(task, task.maps[0], robots)[0]
    written = cycle_log.write(file, course)
    says = (
        f"{file}: {written.cycles} cycles of r1 among {robots} on {course.map.stem}, seed {course.seed}, "
        f"{written.plans} plans, {written.invalid} cycles without a valid trajectory"
    )
    return Measured({"file": str(file), **asdict(written)}, (says,))


def _courses(task: NavigationTask, map_file: Path, robots: int) -> list[NavigationCourse]:
    """One per run, with goals enough."""
    each = math.ceil(task.goals / (task.runs * robots))
    told = task.localisation, task.navigation, task.settings
    seeds = range(task.seed, task.seed + task.runs)
    return [NavigationCourse(map_file, robots, each, seed, *told) for seed in seeds]


def _summed(course: NavigationCourse, runs: Sequence[RunFigures]) -> NavigationFigures:
    legs = [leg for one in runs for leg in one.legs]
    reached = [leg for leg in legs if leg.how == goal_log.SUCCEEDED]
    median_slowness, total_slowness = _slowness(reached)
    gap = min(one.robot_gap for one in runs)
    reasons = Counter(leg.how for leg in legs if leg.how not in {"", goal_log.SUCCEEDED})
    without = _no_trajectory(runs)
    return NavigationFigures(
        map=course.map.stem,
        robots=course.robots,
        goals=len(legs),
        succeeded=len(reached),
        aborted=dict(sorted(reasons.items())),
        unfinished=sum(not leg.how for leg in legs),
        slowness=median_slowness,
        total_slowness=total_slowness,
        robot_hours=sum(one.robot_hours for one in runs),
        no_trajectory=None if without is None else without.value,
        no_trajectory_95=None if without is None else (without.low, without.high),
        wall_contacts=sum(one.wall_contacts for one in runs),
        robot_contacts=sum(one.robot_contacts for one in runs),
        contacts=sum(one.contacts for one in runs),
        wall_gap=min(one.wall_gap for one in runs),
        robot_gap=gap if math.isfinite(gap) else None,
        digests=tuple(one.digest for one in runs),
    )


def _no_trajectory(runs: Sequence[RunFigures]) -> ConfidenceInterval | None:
    """Share of the robots' time without a valid trajectory; None if that time is not known of every run.

    The estimator of a ratio of sums, with its linearised variance (Cochran, Sampling Techniques, 1977,
    chapter 6): runs differ in how long they last.
    """
    lost = [one.no_trajectory_s / 3600 for one in runs if one.no_trajectory_s is not None]
    if len(lost) < len(runs):
        return None
    hours = [one.robot_hours for one in runs]
    share = sum(lost) / sum(hours)
    rest = average([(part - share * all_of) / mean(hours) for part, all_of in zip(lost, hours, strict=True)])
    return ConfidenceInterval(share, max(share + rest.low, 0.0), min(share + rest.high, 1.0))


def _slowness(reached: Sequence[Leg]) -> tuple[float, float] | tuple[None, None]:
    """How much longer than ideal the long ways took: the median, and over all together."""
    long = [(leg.seconds, leg.shortest / SPEED) for leg in reached if leg.shortest and leg.shortest >= LONG]
    if not long:
        return None, None
    total = sum(taken for taken, _ in long) / sum(ideal for _, ideal in long)
    return median(taken / ideal for taken, ideal in long), total


def _shown(figures: Sequence[NavigationFigures], untouched: bool) -> tuple[Table, str]:
    table = Table(
        *("map", "robots", "goals", "succeeded", "95 %", "aborted"),
        *("no trajectory", "95 %", "x shortest", "sums"),
        *("to walls", "to robots", "contacts/h: walls", "robots"),
    )
    for one in figures:
        table.add_row(*_row(one))
    return table, (
        "no trajectory: share of the robots' time without a valid one, - if not all of it was listed; "
        f"x shortest: time by that of the shortest way at {SPEED:g} m/s, over the ways of {LONG:g} m and more"
        f" that succeeded, median and of the sums; goal, no contact with a wall: "
        f"{'met' if untouched else 'MISSED'}"
    )


def _row(one: NavigationFigures) -> list[str]:
    share = proportion(one.succeeded, one.goals)
    gone = {**one.aborted, **({"unfinished": one.unfinished} if one.unfinished else {})}
    contacts = (one.wall_contacts, one.robot_contacts)
    return [
        one.map,
        str(one.robots),
        str(one.goals),
        f"{share.value:.1%}",
        f"{share.low:.1%} to {share.high:.1%}",
        ", ".join(f"{count} {reason}" for reason, count in gone.items()) or "none",
        "-" if one.no_trajectory is None else f"{one.no_trajectory:.1%}",
        "-" if one.no_trajectory_95 is None else "{:.1%} to {:.1%}".format(*one.no_trajectory_95),
        "-" if one.slowness is None else f"{one.slowness:.2f}",
        "-" if one.total_slowness is None else f"{one.total_slowness:.2f}",
        f"{one.wall_gap:.3f} m",
        "-" if one.robot_gap is None else f"{one.robot_gap:.3f} m",
        *(f"{count / one.robot_hours:.2f}" for count in contacts),
    ]
