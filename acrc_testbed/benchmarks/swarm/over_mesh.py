"""A full swarm over Zenoh, a process for each actor: speed, CPU, start-up and memory."""

import contextlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Final

import msgspec

from acrc_testbed.benchmarks.swarm.runs import KINDS, Range, SwarmTask, kind, planned
from acrc_testbed.results.result import RunResult
from actors.instant import in_seconds
from actors.messages import Progress
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from deploy.run import swarm

PARENT: Final = "parent"
_PROC: Final = Path("/proc")
_ENDLESS_S: Final = 36_000.0
"""Longer than any swarm takes to settle all places."""


@dataclass(frozen=True)
class Memory:
    """Memory of all processes of one kind, MB."""

    processes: int
    rss_mb: float
    """Resident; shared pages count fully in each process."""
    pss_mb: float
    """Proportional: a page that n processes share counts 1/n in each."""
    private_mb: float
    """Pages of one process only."""


@dataclass(frozen=True)
class MeshFigures:
    """Figures of a swarm over Zenoh."""

    real_time_factor: Range
    ms: Range
    """CPU of all processes from the first step to the last, per robot and simulated second, ms."""
    startup_s: Range
    startup_cpu_s: Range
    """CPU before the first step of all processes but the forkserver, s."""
    by_actor: dict[str, float]
    """`ms` by kind of process; medians."""
    memory: dict[str, Memory]


@dataclass(frozen=True)
class _MeshRun:
    result: RunResult
    by_actor: dict[str, float]
    """CPU from the first step to the last, s."""
    startup_cpu_s: float


def over_mesh(count: int, task: SwarmTask) -> MeshFigures:
    """Read the memory of one run, and time `task.repeat` others."""
    memory = _memory_of_run(count, task)
    runs = [_mesh_run(count, task) for _ in range(task.repeat)]
    robot_s = count * runs[0].result.simulated_s
    return MeshFigures(
        real_time_factor=Range.of([run.result.real_time_factor for run in runs]),
        ms=Range.of([sum(run.by_actor.values()) / robot_s * 1e3 for run in runs]),
        startup_s=Range.of([run.result.startup_s for run in runs]),
        startup_cpu_s=Range.of([run.startup_cpu_s for run in runs]),
        by_actor={
            actor: median(run.by_actor[actor] for run in runs) / robot_s * 1e3 for actor in runs[0].by_actor
        },
        memory=memory,
    )


def mesh_ms(count: int, task: SwarmTask) -> float:
    """Return the CPU of all processes of one run per robot and simulated second, ms."""
    run = _mesh_run(count, task)
    return sum(run.by_actor.values()) / count / run.result.simulated_s * 1e3


def _mesh_run(count: int, task: SwarmTask) -> _MeshRun:
    parent: list[float] = []
    with planned(count, task, "zenoh") as plan:
        result = swarm.run_processes(plan, "forkserver", lambda progress: parent.append(time.process_time()))
        finals = {
            path.stem: msgspec.json.decode(read_notes(path)["final"], type=FinalNote)
            for path in plan.out.glob("*/*.mcap")
        }
    by_actor = dict.fromkeys(KINDS, 0.0)
    for actor, final in finals.items():
        by_actor[kind(actor)] += final.cpu_s - final.startup_cpu_s
    by_actor[PARENT] = parent[-1] - parent[0]
    return _MeshRun(result, by_actor, sum(final.startup_cpu_s for final in finals.values()))


class _MemoryRead(Exception):  # noqa: N818  # ends a run early
    """Memory has been read."""


def _memory_of_run(count: int, task: SwarmTask) -> dict[str, Memory]:
    """Read memory by kind of process at the task's simulated time, while the run goes on."""
    memory: dict[str, Memory] = {}

    def look(progress: Progress) -> None:
        if in_seconds(progress.instant) < task.simulated_s(count):
            return
        pids = actors_of(plan.out) | {PARENT: [os.getpid()]}
        pids["forkserver"] = [int(_stat(pids["world"][0])[1])]
        memory.update({name: memory_of(them) for name, them in pids.items()})
        raise _MemoryRead

    endless = replace(task, seconds=_ENDLESS_S, robot_seconds=None)
    with planned(count, endless, "zenoh") as plan, contextlib.suppress(_MemoryRead):
        swarm.run_processes(plan, "forkserver", look)
    return memory


def actors_of(out: Path) -> dict[str, list[int]]:
    """Return the process ids of a run by kind; an actor is identified by its log file."""
    pids: dict[str, list[int]] = {name: [] for name in KINDS}
    for entry in _PROC.iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            log = (entry / "fd" / "1").readlink()
        except OSError:  # the process has exited, or belongs to another user
            continue
        if log.parent.parent == out:
            pids[kind(log.stem)].append(int(entry.name))
    return pids


def _stat(pid: int) -> list[str]:
    """Return the fields of proc_pid_stat(5) after the name, which may contain anything."""
    return (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()


def memory_of(pids: Sequence[int]) -> Memory:
    """Return the memory of these processes."""
    sizes = [_sizes((_PROC / str(pid) / "smaps_rollup").read_text()) for pid in pids]
    return Memory(len(pids), *(sum(size[index] for size in sizes) for index in range(3)))


def _sizes(text: str) -> tuple[float, float, float]:
    """Return RSS, PSS and private memory, MB, from a file smaps_rollup (proc_pid_smaps(5))."""
    rows = (line.split() for line in text.splitlines()[1:])
    kib = {row[0].removesuffix(":"): int(row[1]) for row in rows}
    private = kib["Private_Clean"] + kib["Private_Dirty"]
    return kib["Rss"] / 1024, kib["Pss"] / 1024, private / 1024
