"""Helpers for tests: in-memory runs, process pools, waiting, nightly seeds, small disks."""

import multiprocessing
import os
import socket
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import pytest

from acrc_testbed.results.result import RunResult
from acrc_testbed.results.seal import seal
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.tables import Scenario

Task = TypeVar("Task")
Result = TypeVar("Result")
_MOUNT = 'size=$1 folder=$2; shift 2; mount -t tmpfs -o size="$size" none "$folder" && exec "$@"'


@contextmanager
def in_memory(scenario: Scenario) -> Iterator[tuple[RunPlan, RunResult]]:
    """Run a scenario in this process, in a temporary folder. Raises AcrcError."""
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        plan = swarm.plan(scenario, RunOptions(Path(folder) / "run", bus="memory", json=True))
        result = swarm.run_in_memory(plan, lambda progress: None)
        seal(plan.out)
        yield plan, result


def in_order(
    work: Callable[[Task], Result], tasks: Sequence[Task], workers: int | None = None
) -> Iterator[Result]:
    """Yield the results of `work`, a module-level function, for each task in order.

    `workers`: None: one per processor; 1: in this process.
    """
    workers = min(workers or os.cpu_count() or 1, len(tasks))
    if workers <= 1:
        yield from map(work, tasks)
        return
    with ProcessPoolExecutor(workers, multiprocessing.get_context("forkserver")) as pool:
        yield from pool.map(work, tasks)


def until(condition: Callable[[], object], patience_s: float = 30.0, pause_s: float = 0.005) -> None:
    """Poll until the condition holds; fail after `patience_s`."""
    deadline = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < deadline, f"condition not met within {patience_s:g} s"
        time.sleep(pause_s)


def sampled(seeds: Iterable[int], every_day: Collection[int]) -> Any:
    """Return the seeds as parameters; those not in `every_day` run nightly."""
    return [pytest.param(seed, marks=() if seed in every_day else pytest.mark.nightly) for seed in seeds]


def on_small_disk(folder: Path, size: str, words: Sequence[str]) -> list[str]:
    """Return a command that runs `words` with `folder` on a disk of `size`, such as `64k`."""
    folder.mkdir(exist_ok=True)
    return ["unshare", "--map-root-user", "--mount", "sh", "-c", _MOUNT, "sh", size, str(folder), *words]


def free_port() -> int:
    """Return an unused TCP port of this computer."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
