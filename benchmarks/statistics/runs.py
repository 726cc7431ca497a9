"""Runs in memory, independent ones on all processors; CPU time of a piece of work."""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.tables import Scenario
from observation.results.result import RunResult
from observation.results.seal import seal

Task = TypeVar("Task")
Result = TypeVar("Result")


@contextmanager
def in_memory(scenario: Scenario) -> Iterator[tuple[RunPlan, RunResult]]:
    """Run a scenario in this process, in a folder that is gone afterwards. Raises AcrcError."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        plan = swarm.plan(scenario, RunOptions(Path(folder) / "run", bus="memory", json=True))
        result = swarm.run_in_memory(plan, lambda progress: None)
        seal(plan.out)
        yield plan, result


def in_order(
    work: Callable[[Task], Result], tasks: Sequence[Task], workers: int | None = None
) -> Iterator[Result]:
    """What `work`, a function of a module, makes of each task, in the order of the tasks.

    `workers`: None: one per processor; 1: in this process.
    """
    workers = min(workers or os.cpu_count() or 1, len(tasks))
    if workers <= 1:
        yield from map(work, tasks)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("forkserver")) as pool:
        yield from pool.map(work, tasks)


T = TypeVar("T")


def best(prepare: Callable[[], T], work: Callable[[T], object], repeats: int) -> float:
    """CPU seconds of the fastest of several repeats of `work`, after one that does not count.

    Each gets a new result of `prepare`, whose own time is left out.
    """
    work(prepare())
    times = []
    for _ in range(repeats):
        thing = prepare()
        begun = time.process_time()
        work(thing)
        times.append(time.process_time() - begun)
    return min(times)
