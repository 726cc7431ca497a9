"""Runs: in memory, independent ones on all processors, by the command line; CPU time of a piece of work."""

import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Final, TypeVar

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.tables import Scenario
from observation.results.result import RunResult
from observation.results.seal import seal

ACRC: Final = (sys.executable, "-P", "-m", "command_line")
_LAST_WORDS: Final = 300
"""Characters of what a failed command said."""


def answer(*words: str, patience_s: float | None = None) -> str:
    """What a command writes on its standard output; AcrcError with its last words where it fails."""
    done = subprocess.run(
        [*ACRC, *words], cwd=REPOSITORY, capture_output=True, text=True, timeout=patience_s, check=False
    )
    if done.returncode != 0:
        raise AcrcError(f"acrc {words[0]} fails: {done.stderr.strip()[-_LAST_WORDS:]}")
    return done.stdout


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
