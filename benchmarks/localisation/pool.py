"""Runs the courses of many cells, each once, on several processors."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from actors.randomness import generator
from benchmarks.localisation.cells import CourseCell
from benchmarks.localisation.course import ROBOT, CourseSetup, made
from benchmarks.localisation.filters import Arm
from benchmarks.localisation.metrics import Run, beside_truth
from benchmarks.localisation.peer_reports import reports
from benchmarks.localisation.replay import replay
from benchmarks.statistics.pool import in_order

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


def drive(task: CourseTask) -> list[Run]:
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
) -> Mapping[Key, Run]:
    """Every run by course and arm; `tell` is called with the number of courses done, after each."""
    runs: dict[Key, Run] = {}
    for done, (task, its) in enumerate(zip(todo, in_order(drive, todo, workers), strict=True), start=1):
        runs |= {(task.course, arm): run for arm, run in zip(task.arms, its, strict=True)}
        tell(done)
    return runs
