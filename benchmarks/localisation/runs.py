"""Runs the courses of many cells, each once, on several processors; and what one update costs alone."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from actors.geometry import Pose
from actors.randomness import generator
from actors.robot.localisation import PRESETS, Amcl, likelihood_field
from actors.robot.sweep import Sweep
from benchmarks.localisation.cells import PRESETS as NAMES
from benchmarks.localisation.cells import CourseCell
from benchmarks.localisation.course import ROBOT, Course, CourseSetup, made
from benchmarks.localisation.crowd import reports
from benchmarks.localisation.filters import Arm, replay
from benchmarks.localisation.metrics import FilterRun, beside_truth
from benchmarks.statistics.runs import in_order

Key = tuple[CourseSetup, Arm]


@dataclass(frozen=True)
class CourseTask:
    """One course and the localisations that are fed with it."""

    course: CourseSetup
    arms: tuple[Arm, ...]


def tasks(cells: Iterable[CourseCell]) -> list[CourseTask]:
    """Every course that the cells need, once, with every arm that it is needed with, once."""
    needed: dict[CourseSetup, dict[Arm, None]] = {}
    for cell in cells:
        for seed in range(1, cell.runs + 1):
            needed.setdefault(replace(cell.course, seed=seed), {})[cell.arm] = None
    return [CourseTask(course, tuple(arms)) for course, arms in needed.items()]


def drive(task: CourseTask) -> list[FilterRun]:
    """The runs of a task, in the order of its arms. Depends on the task only, but for the CPU times."""
    course = made(task.course)
    seed = task.course.seed
    known = reports(course.peers, generator(seed, "localisation/reports", ROBOT))
    runs = []
    for arm in task.arms:
        localisation = arm.localisation(course, seed)
        track = replay(course, localisation, known if arm.masked else ())
        runs.append(beside_truth(seed, course.truth, course.odometry, track))
    return runs


def run_all(
    todo: Sequence[CourseTask], workers: int | None, tell: Callable[[int], None]
) -> Mapping[Key, FilterRun]:
    """Every run by course and arm; `tell` is called with the number of courses done, after each."""
    runs: dict[Key, FilterRun] = {}
    for done, (task, its) in enumerate(zip(todo, in_order(drive, todo, workers), strict=True), start=1):
        runs |= {(task.course, arm): run for arm, run in zip(task.arms, its, strict=True)}
        tell(done)
    return runs


PARTICLES: Final = 500
BEAMS: Final = 60
GOAL_US: Final = 150.0


@dataclass(frozen=True)
class UpdateCost:
    """One preset, but with PARTICLES and BEAMS."""

    preset: str
    updates: int
    """In one pass over a course, all of which move, weigh and resample."""
    min_us: float
    """CPU time per update in the fastest pass, µs."""
    mean_us: float
    """The same over all passes."""
    goal_met: bool
    """True with at most GOAL_US in the fastest."""


def update_costs(corridor: str, repeats: int = 15, seconds: float = 60.0) -> list[UpdateCost]:
    """The cost with each preset, on a course with nobody near, 360°, Kobuki's odometry."""
    course = made(CourseSetup(corridor, 1, base="kobuki", seconds=seconds))
    return [_cost(preset, course, repeats) for preset in NAMES]


def _cost(preset: str, course: Course, repeats: int) -> UpdateCost:
    parameters = replace(
        PRESETS[preset], min_particles=PARTICLES, max_particles=PARTICLES, beams=BEAMS,
        update_angle=1e-6, resample_interval=1,  # every scan counts: the heading is never at rest
    )  # fmt: skip
    field = likelihood_field(course.grid, parameters.max_distance)
    every = 6  # as far apart as an update_distance of 0.25 m has them
    steps = [
        (Pose(*pose), Sweep(np.frombuffer(scan.tobytes(), "<u2"), Pose(*pose)))
        for pose, scan in zip(course.odometry[every::every].tolist(), course.scans[every::every], strict=True)
    ]
    passes = []
    for _ in range(repeats + 1):
        draws = generator(1, "localisation/filter", ROBOT)
        filtered = Amcl(field, course.sensor, course.origin, draws, parameters)
        begun = time.process_time()
        for here, sweep in steps:
            filtered.update(here, sweep)
        passes.append((time.process_time() - begun) / len(steps) * 1e6)
    counted = passes[1:]  # the first one compiles
    return UpdateCost(preset, len(steps), min(counted), float(np.mean(counted)), min(counted) <= GOAL_US)
