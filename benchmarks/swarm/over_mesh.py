"""A full swarm over Zenoh, a process for each actor: how fast, by which processes, and how large they are."""

import contextlib
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Final

import msgspec

from actors.instant import in_seconds
from actors.messages import Progress
from actors.runtime.process import FinalNote
from actors.runtime.recording import read_notes
from benchmarks.swarm import process_figures
from benchmarks.swarm.process_figures import Activity, Memory
from benchmarks.swarm.task import Range, SwarmTask, all_cpu_s, planned
from deploy.run import swarm
from observation.results.result import RunResult

PARENT: Final = "parent"
_ENDLESS_S: Final = 36_000.0
"""Longer than any swarm takes to settle all places, or than anybody waits."""


@dataclass(frozen=True)
class MeshFigures:
    """A swarm over Zenoh, a process for each actor."""

    real_time_factor: Range
    ms: Range
    """CPU of all processes per robot and simulated second, ms; from the first step to the last."""
    startup_s: Range
    startup_cpu_s: Range
    """CPU before the first step, of all processes but the forkserver, s: imports, kernels, maps."""
    by_actor: dict[str, float]
    """`ms` by kind of process; medians."""
    system: dict[str, float]
    """The share of the kernel in it."""
    switches: dict[str, float]
    """Context switches per robot and step."""
    memory: dict[str, Memory]
    others: Range
    """Cores that were busy with something else meanwhile."""


@dataclass(frozen=True)
class _MeshRun:
    result: RunResult
    by_actor: dict[str, float]
    """CPU from the first step to the last, s."""
    startup_cpu_s: float
    others: float


def over_mesh(count: int, task: SwarmTask) -> MeshFigures:
    """Weigh one run, and measure as many others as the task says."""
    memory, activity = _weigh(count, task)
    rates = process_figures.rates(*activity)
    runs = [_mesh_run(count, task) for _ in range(task.repeat)]
    robot_s = count * runs[0].result.simulated_s
    by_actor = {
        actor: median(run.by_actor[actor] for run in runs) / robot_s * 1e3 for actor in runs[0].by_actor
    }
    return MeshFigures(
        real_time_factor=Range.of([run.result.real_time_factor for run in runs]),
        ms=Range.of([sum(run.by_actor.values()) / robot_s * 1e3 for run in runs]),
        startup_s=Range.of([run.result.startup_s for run in runs]),
        startup_cpu_s=Range.of([run.startup_cpu_s for run in runs]),
        by_actor=by_actor,
        system={actor: share for actor, (share, _) in rates.items()},
        switches={actor: rate * by_actor[actor] / 10 for actor, (_, rate) in rates.items()},
        memory=memory,
        others=Range.of([run.others for run in runs]),
    )


def plain_mesh_ms(count: int, task: SwarmTask) -> float:
    """CPU of all processes per robot and simulated second of one run, ms."""
    run = _mesh_run(count, task)
    return sum(run.by_actor.values()) / count / run.result.simulated_s * 1e3


def _mesh_run(count: int, task: SwarmTask) -> _MeshRun:
    parent: list[float] = []

    def note(progress: Progress) -> None:
        parent.append(time.process_time())

    with planned(count, task, "zenoh") as plan:
        load, own = process_figures.Load(), all_cpu_s()
        result = swarm.run_processes(plan, "forkserver", note)
        others = load.others(all_cpu_s() - own)
        finals = {path.stem: _final(path) for path in plan.out.glob("*/*.mcap")}
    by_actor = dict.fromkeys(process_figures.KINDS, 0.0)
    for actor, final in finals.items():
        by_actor[process_figures.kind(actor)] += final.cpu_s - final.startup_cpu_s
    by_actor[PARENT] = parent[-1] - parent[0]
    startup_cpu_s = sum(final.startup_cpu_s for final in finals.values())
    return _MeshRun(result, by_actor, startup_cpu_s, others)


def _final(recording: Path) -> FinalNote:
    return msgspec.json.decode(read_notes(recording)["final"], type=FinalNote)


class _Weighed(Exception):  # noqa: N818  # ends a run that has served its purpose
    """The processes have been weighed."""


def _weigh(
    count: int, task: SwarmTask
) -> tuple[dict[str, Memory], tuple[Mapping[str, Activity], Mapping[str, Activity]]]:
    """Memory by kind of process once the task's time is over, and activity early and then.

    The run would go on: what has ended could not be looked at.
    """
    seen: list[dict[str, Activity]] = []
    memory: dict[str, Memory] = {}

    def look(progress: Progress) -> None:
        late = in_seconds(progress.instant) >= task.simulated_s(count)
        if seen and not late:
            return
        pids = process_figures.actors_of(plan.out) | {PARENT: [os.getpid()]}
        seen.append({kind: process_figures.activity(them) for kind, them in pids.items()})
        if late and len(seen) > 1:
            pids["forkserver"] = [process_figures.parent_of(pids["world"][0])]
            memory.update({kind: process_figures.memory(them) for kind, them in pids.items()})
            raise _Weighed

    endless = replace(task, seconds=_ENDLESS_S, robot_seconds=None)
    with planned(count, endless, "zenoh") as plan, contextlib.suppress(_Weighed):
        swarm.run_processes(plan, "forkserver", look)
    return memory, (seen[0], seen[1])
