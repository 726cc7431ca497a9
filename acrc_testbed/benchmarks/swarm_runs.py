"""Runs of a swarm for benchmarks: in memory with CPU by package, over Zenoh with memory by process."""

import contextlib
import cProfile
import ctypes
import gc
import os
import re
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from statistics import median
from types import CodeType
from typing import Any, Final, Literal
from unittest.mock import patch

import numpy as np
from msgspec.structs import replace
from numba import carray, cfunc, types

from acrc_testbed.benchmarks.benchmark_result import final_note
from acrc_testbed.results.result import RunResult
from actors.array_types import Int64s
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.installation.repository import PACKAGES, REPOSITORY, SHIPPED
from actors.instant import in_seconds
from actors.messages import Progress
from actors.runtime.shell import MemoryBus, Shell, run_shells
from deploy.run import memory_swarm, swarm
from deploy.run.options import RunOptions
from deploy.run.plan import RunPlan
from deploy.scenario.resolve import LayoutError
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario

Function = tuple[str, int, str]
"""File, line and name, as in `pstats`; a built-in function has the file `~`."""
Entry = tuple[float, Mapping[Function, float]]
"""Calls, or seconds, of a function: all, and by caller."""
_ROUNDS: Final = 50
"""Longest chain of calls within packages that is attributed to a caller of this project."""
NO_PACKAGE: Final = "elsewhere"
_ADDRESS: Final = re.compile(r" at 0x[0-9a-f]+")
_OBJECTS: Final = 2
"""PYMEM_DOMAIN_OBJ of CPython."""


def entries(
    profile: cProfile.Profile, weight: Literal["callcount", "inlinetime"] = "callcount"
) -> dict[Function, Entry]:
    """Return calls, or seconds without callees, of every function; functions with equal labels are summed.

    `pstats` keeps only the last function of a label, such as `__new__` of named tuples.
    """
    totals: Counter[Function] = Counter()
    callers: defaultdict[Function, Counter[Function]] = defaultdict(Counter)
    for entry in profile.getstats():
        caller = _function_of(entry.code)
        totals[caller] += getattr(entry, weight)
        for callee in entry.calls or ():
            callers[_function_of(callee.code)][caller] += getattr(callee, weight)
    return {function: (value, callers[function]) for function, value in totals.items()}


def _function_of(code: CodeType | str) -> Function:
    return ("~", 0, code) if isinstance(code, str) else (code.co_filename, code.co_firstlineno, code.co_name)


def sum_by_package(called: Mapping[Function, Entry]) -> dict[str, float]:
    """Sum `called` by package folder.

    Functions outside this project are attributed to their callers in proportion; the total is preserved.
    """
    packages: defaultdict[str, float] = defaultdict(float)
    waiting = {function: calls for function, (calls, _) in called.items()}
    for _ in range(_ROUNDS):
        foreign: defaultdict[Function, float] = defaultdict(float)
        for function, calls in waiting.items():
            callers = called[function][1]
            total = sum(callers.values())
            if (package := package_of(function)) is not None or not total:
                packages[package or NO_PACKAGE] += calls
            else:
                for caller, times in callers.items():
                    foreign[caller] += calls * times / total
        waiting = foreign
    packages[NO_PACKAGE] += sum(waiting.values())
    return packages


def package_of(function: Function) -> str | None:
    """Return the package folder of a function of this project, with `/`; None for others."""
    path = Path(function[0])
    if not path.is_relative_to(REPOSITORY):
        return None
    inside = path.relative_to(REPOSITORY)
    return inside.parent.as_posix() if inside.parts[0] in PACKAGES else None


def display_name(function: Function) -> str:
    """Return file and name of a function for display."""
    file, _, name = function
    if file == "~":
        return _ADDRESS.sub("", name.strip("<>"))
    path = Path(file)
    if path.is_relative_to(REPOSITORY) and package_of(function):
        return f"{path.relative_to(REPOSITORY).as_posix()}: {name}"
    return f"{path.name}: {name}"


class _Allocator(ctypes.Structure):
    """PyMemAllocatorEx of CPython."""

    _fields_ = [(name, ctypes.c_void_p) for name in ("context", "malloc", "calloc", "realloc", "free")]


@contextmanager
def count_allocations() -> Iterator[Int64s]:
    """Count blocks requested from Python's allocator in the only element of an array, including freed ones.

    Objects from CPython's free lists (small tuples, floats) are not counted.
    """
    count, before = np.zeros(1, np.int64), _Allocator()
    ctypes.pythonapi.PyMem_GetAllocator(_OBJECTS, ctypes.byref(before))
    malloc = _count_calls(ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)(before.malloc))
    assert not before.context, "the context would not reach the original allocator"
    counting = _Allocator(int(count.ctypes.data), malloc.address, before.calloc, before.realloc, before.free)
    ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(counting))
    try:
        yield count
    finally:
        ctypes.pythonapi.PyMem_SetAllocator(_OBJECTS, ctypes.byref(before))


def _count_calls(plain: Any) -> Any:
    """Compile a malloc that increments the count at its context's address, then calls `plain`."""

    @cfunc(types.voidptr(types.voidptr, types.uintp))  # type: ignore[untyped-decorator]
    def malloc(context: Any, size: int) -> Any:
        carray(context, 1, np.int64)[0] += 1
        return plain(context, size)

    return malloc


KINDS: Final = ("world", "radio", "robots")
"""Kinds of processes of a run; world and radio are one process each."""
_CLEARANCE: Final = 0.22
_DISTANCE: Final = 0.42
"""Clearance and distance if the scenario's are too large, m; a TurtleBot is 0.354 m wide."""
_MEMORY_REPEATS: Final = 2


@dataclass(frozen=True)
class SwarmTask:
    """Sizes and length of the runs of one benchmark."""

    robots: tuple[int, ...] = (4, 20, 50, 100)
    seconds: float = 60.0
    """Maximum simulated time of each run, s."""
    robot_seconds: float | None = 800.0
    """Limit of robots times simulated seconds of each run; None: no limit.
    Own choice: less than five minutes for the default swarms on two cores."""
    repeat: int = 3
    """Measured runs over Zenoh, after one that reads memory and warms up the machine."""
    scenario: Path = SHIPPED / "scenarios" / "chapter.toml"
    seed: int | None = None
    """None: the scenario's."""

    def simulated_s(self, robots: int) -> float:
        """Return the simulated time of a run of `robots` robots; at least 2 s."""
        if self.robot_seconds is None:
            return self.seconds
        return min(self.seconds, max(2.0, float(self.robot_seconds // robots)))


@dataclass(frozen=True)
class Range:
    """Median, minimum and maximum over some runs."""

    median: float
    least: float
    greatest: float

    @staticmethod
    def of(values: Sequence[float]) -> "Range":
        """Return the range of at least one value."""
        return Range(median(values), min(values), max(values))


@contextmanager
def plan_run(count: int, task: SwarmTask, bus: str) -> Iterator[RunPlan]:
    """Plan a run in a temporary folder, which is deleted afterwards."""
    overrides = Overrides(robots=count, duration=task.simulated_s(count), seed=task.seed)
    with tempfile.TemporaryDirectory(prefix="acrc-") as folder:
        options = RunOptions(Path(folder) / "out", bus=bus, json=True, record="lean")
        scenario = load_scenario(task.scenario, overrides)
        try:
            plan = swarm.plan(scenario, options)
        except LayoutError:  # with starts 0.6 m apart the corridor fits about 140 robots
            plan = swarm.plan(_dense_scenario(scenario, count), options)
        yield plan


def _dense_scenario(scenario: Scenario, count: int) -> Scenario:
    """Return the scenario with random starts at minimum distances from walls and each other."""
    grid = load_map(scenario.map)
    rng = np.random.default_rng(scenario.run.seed)
    points = draw_points(grid, count, rng=rng, clearance=_CLEARANCE, apart=_DISTANCE)
    starts = tuple((point.x, point.y, 0.0) for point in points)
    return replace(scenario, robots=replace(scenario.robots, start=starts))


@dataclass(frozen=True)
class MemoryFigures:
    """Figures of a swarm in one process."""

    real_time_factor: float
    ms: float
    """CPU per robot and simulated second, ms."""
    packages: dict[str, float]
    """`ms` by package, in the proportions of a profiled run."""
    simulated_s: float
    frames: dict[str, int]
    """Outcomes of frames, as in `RunResult.frames`."""
    node: dict[str, int]
    """Sums of the counters of all robots' nodes."""


def measure_in_memory(count: int, task: SwarmTask) -> MemoryFigures:
    """Return the figures of the fastest of several runs in memory, and profile another one."""
    runs = [_run_timed(count, task) for _ in range(min(task.repeat, _MEMORY_REPEATS))]
    ms, result = min(runs, key=itemgetter(0))
    packages = sum_by_package(entries(profile_run(count, task, MemoryBus())[0], "inlinetime"))
    total = sum(packages.values())
    return MemoryFigures(
        real_time_factor=result.real_time_factor,
        ms=ms,
        packages={package: ms * share / total for package, share in packages.items()},
        simulated_s=result.simulated_s,
        frames=result.frames,
        node=result.deeco.counters,
    )


def memory_ms(count: int, task: SwarmTask) -> float:
    """Return the CPU of one run per robot and simulated second, ms."""
    return _run_timed(count, task)[0]


def _run_timed(count: int, task: SwarmTask) -> tuple[float, RunResult]:
    """Run in memory; return the CPU from the first step to the last, ms per robot-second, and the result."""
    spent: list[int] = []

    def timed(shells: Sequence[Shell], hold: Callable[[Shell], None]) -> None:
        began = time.thread_time_ns()
        run_shells(shells, hold)
        spent.append(time.thread_time_ns() - began)

    with plan_run(count, task, "memory") as plan, patch.object(memory_swarm, "run_shells", timed):
        result = swarm.run_in_memory(plan, lambda progress: None)
    return spent[0] / count / result.simulated_s / 1e6, result


def profile_run(count: int, task: SwarmTask, bus: MemoryBus) -> tuple[cProfile.Profile, dict[str, float]]:
    """Profile a run in memory; return the profile and the bytes recorded by kind of actor."""
    with plan_run(count, task, "memory") as plan:
        profile = cProfile.Profile()
        gc.collect()  # otherwise the profile contains garbage collection of earlier runs
        profile.runcall(swarm.run_in_memory, plan, lambda progress: None, bus)
        return profile, recorded_bytes(plan.out)


def process_kind(actor: str) -> str:
    """Return the kind of process of an actor."""
    return actor if actor in KINDS else KINDS[-1]


def recorded_bytes(out: Path) -> dict[str, float]:
    """Return the size of a run's recordings by kind of actor."""
    sizes: defaultdict[str, float] = defaultdict(float)
    for file in out.glob("*/*.mcap"):
        sizes[process_kind(file.stem)] += file.stat().st_size
    return sizes


PARENT: Final = "parent"
_PROC: Final = Path("/proc")
_ENDLESS_S: Final = 36_000.0
"""Longer than any swarm takes to finish all places, s."""


@dataclass(frozen=True)
class MemoryUsage:
    """Memory of all processes of one kind, MB."""

    processes: int
    rss_mb: float
    """Resident; shared pages count fully in each process."""
    pss_mb: float
    """Proportional: a page that n processes share counts 1/n in each."""
    private_mb: float
    """Pages of one process only."""

    @property
    def mean_pss_mb(self) -> float:
        """Mean proportional memory of one process, MB."""
        return self.pss_mb / self.processes


@dataclass(frozen=True)
class MeshFigures:
    """Figures of a swarm over Zenoh."""

    real_time_factor: Range
    ms: Range
    """CPU of all processes from the first step to the last, per robot and simulated second, ms."""
    startup_s: Range
    startup_cpu_s: Range
    """CPU before the first step, of all processes but the forkserver, s."""
    by_actor: dict[str, float]
    """`ms` by kind of process; medians."""
    memory: dict[str, MemoryUsage]


@dataclass(frozen=True)
class _MeshRun:
    result: RunResult
    by_actor: dict[str, float]
    """CPU from the first step to the last, s."""
    startup_cpu_s: float


def measure_over_mesh(count: int, task: SwarmTask) -> MeshFigures:
    """Read the memory of one run and time `task.repeat` others."""
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
    with plan_run(count, task, "zenoh") as plan:
        result = swarm.run_processes(plan, "forkserver", lambda progress: parent.append(time.process_time()))
        finals = {path.stem: final_note(path) for path in plan.out.glob("*/*.mcap")}
    by_actor = dict.fromkeys(KINDS, 0.0)
    for actor, final in finals.items():
        by_actor[process_kind(actor)] += final.cpu_s - final.startup_cpu_s
    by_actor[PARENT] = parent[-1] - parent[0]
    return _MeshRun(result, by_actor, sum(final.startup_cpu_s for final in finals.values()))


class _MemoryRead(Exception):  # noqa: N818  # ends a run early
    """Signal that memory has been read."""


def _memory_of_run(count: int, task: SwarmTask) -> dict[str, MemoryUsage]:
    """Read memory by kind of process during the run, at the task's simulated time."""
    memory: dict[str, MemoryUsage] = {}

    def read_memory(progress: Progress) -> None:
        if in_seconds(progress.instant) < task.simulated_s(count):
            return
        pids = process_ids(plan.out) | {PARENT: [os.getpid()]}
        pids["forkserver"] = [int(_stat(pids["world"][0])[1])]
        memory.update({name: memory_usage(each) for name, each in pids.items()})
        raise _MemoryRead

    endless = SwarmTask((count,), _ENDLESS_S, None, task.repeat, task.scenario, task.seed)
    with plan_run(count, endless, "zenoh") as plan, contextlib.suppress(_MemoryRead):
        swarm.run_processes(plan, "forkserver", read_memory)
    return memory


def process_ids(out: Path) -> dict[str, list[int]]:
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
            pids[process_kind(log.stem)].append(int(entry.name))
    return pids


def _stat(pid: int) -> list[str]:
    """Return the fields of proc_pid_stat(5) after the process name."""
    return (_PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()


def memory_usage(pids: Sequence[int]) -> MemoryUsage:
    """Return the memory of these processes, from their files smaps_rollup (proc_pid_smaps(5))."""
    kib: Counter[str] = Counter()
    for pid in pids:
        rows = (line.split() for line in (_PROC / str(pid) / "smaps_rollup").read_text().splitlines()[1:])
        kib.update({row[0].removesuffix(":"): int(row[1]) for row in rows})
    private = kib["Private_Clean"] + kib["Private_Dirty"]
    return MemoryUsage(len(pids), kib["Rss"] / 1024, kib["Pss"] / 1024, private / 1024)
