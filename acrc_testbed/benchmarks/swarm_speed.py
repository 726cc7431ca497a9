"""`acrc bench swarm`: speed of the whole stack with many robots, over Zenoh and in memory."""

import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import median
from typing import Final

from rich.table import Table

from acrc_testbed.benchmarks.benchmark_result import (
    BenchmarkResult,
    SpeedGoal,
    make_table,
    max_goal,
    min_goal,
)
from acrc_testbed.benchmarks.swarm_runs import (
    KINDS,
    MemoryFigures,
    MeshFigures,
    Range,
    SwarmTask,
    measure_in_memory,
    measure_over_mesh,
    memory_ms,
    mesh_ms,
)
from actors.console import create_console
from actors.runtime.errors import AcrcError

ROBOTS: Final = KINDS[-1]
STEPS_PER_SECOND: Final = 10
"""Steps of the measured scenarios per simulated second."""
SPEED_GOALS: Final = {4: 100.0, 20: 16.0, 50: 6.0, 100: 2.0}
"""Goal: simulated seconds per second over Zenoh, by the number of robots."""
FEW: Final = 4
MANY: Final = 100
MAX_GROWTH: Final = 1.3
"""Goal: CPU per robot and second of MANY robots, relative to FEW."""
MAX_START_S: Final = 6.0
"""Goal: time until the first step of MANY robots."""
MAX_PSS_MB: Final = 25.0
"""Goal: mean memory (PSS) of the processes of MANY robots, MB."""
_IDLE: Final = Path(__file__).with_name("idle.toml")
_YARDSTICK: Final = 300_007
"""Length of the list of the yardstick; a prime, so that accesses are irregular."""


@dataclass(frozen=True)
class Traffic:
    """Radio traffic, each per robot and simulated second."""

    published: float
    """Packets of the robot's own knowledge."""
    frames: float
    """Frames sent, including relayed ones."""
    copies: float
    """Copies of frames at other transceivers that the medium computes, received or not."""
    heard: float
    """Frames received."""
    packets: float
    """Packets received, including those of the robot's own knowledge."""
    stale: float
    """Received packets without news: outdated, or the robot's own."""


@dataclass(frozen=True)
class SwarmFigures:
    """All figures for one number of robots. CPU is per robot and simulated second."""

    robots: int
    simulated_s: float
    """Simulated length of each run."""
    mesh: MeshFigures | None
    """None if so many processes cannot run here."""
    memory: MemoryFigures
    idle_ms: float | None
    """CPU of idle robots over Zenoh: step protocol, recording and isolation; None as `mesh`."""
    idle_memory_ms: float
    traffic: Traffic
    load: float
    """Load average of the machine before the runs."""
    yardstick_ms: float
    """CPU of a fixed workload, to compare machines, ms."""


def measure(
    robots: Sequence[int] | None = None, duration: float | None = None, repeat: int = SwarmTask.repeat
) -> BenchmarkResult:
    """Measure each number of robots for `duration` simulated s; report medians of `repeat` runs over Zenoh.

    Without `duration` the benchmark takes a few minutes.
    """
    task = SwarmTask(tuple(robots or SwarmTask.robots), repeat=repeat)
    if duration is not None:
        task = replace(task, seconds=duration, robot_seconds=None)
    swarms = list(_measure(task))
    goals = speed_goals(swarms)
    figures = {
        "task": asdict(task) | {"scenario": str(task.scenario)},
        "cores": os.cpu_count(),
        "swarms": [asdict(one) for one in swarms],
        "goals": [asdict(goal) for goal in goals],
    }
    return BenchmarkResult(figures, _output(task, swarms, goals))


def _measure(task: SwarmTask) -> Iterator[SwarmFigures]:
    """Measure over Zenoh first: in-memory runs enlarge this process, the parent of the others."""
    console = create_console(stderr=True)
    idle_task = replace(task, scenario=_IDLE)
    meshes = []
    for count in task.robots:
        console.print(f"{count} robots over Zenoh …")
        load, before = os.getloadavg()[0], measure_yardstick()
        mesh = _try_mesh(count, task)
        meshes.append((count, load, before, mesh, None if mesh is None else mesh_ms(count, idle_task)))
    for count, load, before, mesh, idle_ms in meshes:
        console.print(f"{count} robots in memory …")
        memory = measure_in_memory(count, task)
        yield SwarmFigures(
            robots=count,
            simulated_s=task.simulated_s(count),
            mesh=mesh,
            memory=memory,
            idle_ms=idle_ms,
            idle_memory_ms=memory_ms(count, idle_task),
            traffic=_traffic(count, memory),
            load=load,
            yardstick_ms=median((before, measure_yardstick(), measure_yardstick())),
        )


def _try_mesh(robots: int, task: SwarmTask) -> MeshFigures | None:
    try:
        return measure_over_mesh(robots, task)
    except AcrcError as error:
        sys.stderr.write(f"acrc: run of {robots} robots over Zenoh failed: {error}\n")
        return None


def measure_yardstick() -> float:
    """Return the CPU of irregular accesses to more memory than a core's cache, ms."""
    numbers = list(range(_YARDSTICK))
    began = time.thread_time_ns()
    place = 1
    for _ in range(_YARDSTICK):
        place = numbers[place * 48_271 % _YARDSTICK]
    return (time.thread_time_ns() - began) / 1e6


def _traffic(robots: int, run: MemoryFigures) -> Traffic:
    """Divide a run's counters by robots and seconds."""
    frames, node = run.frames, Counter(run.node)
    counts = {
        "published": node["published"],
        "frames": frames["frames_sent"],
        "copies": sum(count for name, count in frames.items() if name.startswith("copies_")),
        "heard": frames["copies_heard"],
        "packets": node["packets"],
        "stale": node["packets_old"] + node["packets_own"],
    }
    return Traffic(**{name: count / (robots * run.simulated_s) for name, count in counts.items()})


def speed_goals(swarms: Sequence[SwarmFigures]) -> list[SpeedGoal]:
    """Compare the figures of swarms that ran over Zenoh with the performance goals."""
    meshes = {one.robots: one.mesh for one in swarms if one.mesh}
    speed, rate = "simulated seconds per second over Zenoh", "robot-steps per second of one core in memory"
    goals = [
        min_goal(f"{robots} robots: {speed}", meshes[robots].real_time_factor.median, goal)
        for robots, goal in SPEED_GOALS.items()
        if robots in meshes
    ]
    goals += [
        min_goal(
            f"{one.robots} robots: {rate}, rate over Zenoh on all cores",
            STEPS_PER_SECOND / one.memory.ms * 1e3,
            STEPS_PER_SECOND * one.robots * one.mesh.real_time_factor.median,
        )
        for one in swarms
        if one.mesh
    ]
    if (many := meshes.get(MANY)) is None:
        return goals
    if FEW in meshes:
        factor = many.ms.median / meshes[FEW].ms.median
        goals.append(
            max_goal(f"{MANY} robots: CPU per robot and second, times that of {FEW}", factor, MAX_GROWTH)
        )
    size = many.memory[ROBOTS].mean_pss_mb
    return [
        *goals,
        max_goal(f"{MANY} robots: s until the first step", many.startup_s.median, MAX_START_S),
        max_goal(f"{MANY} robots: MB of memory (PSS) per robot process", size, MAX_PSS_MB),
    ]


def _output(task: SwarmTask, swarms: Sequence[SwarmFigures], goals: Sequence[SpeedGoal]) -> list[Table | str]:
    speeds = (
        f"{task.scenario.name}, over Zenoh: median (least-greatest) of {task.repeat}; CPU ms per robot and "
        "simulated second;\nyardstick: CPU ms of fixed work"
    )
    air = [{"robots": str(one.robots), **_traffic_row(one.traffic)} for one in swarms]
    tables = [
        make_table([_speed_row(one) for one in swarms], speeds),
        _package_table(swarms),
        make_table(air, "radio traffic per robot and simulated second", ".2f"),
    ]
    if rows := [row for one in swarms if one.mesh for row in _process_rows(one.robots, one.mesh)]:
        title = "processes: CPU ms per robot and simulated second; MB of memory, sum by kind"
        tables.append(make_table(rows, title))
    return [*tables, *map(str, goals)]


def _speed_row(one: SwarmFigures) -> dict[str, str]:
    mesh, memory = one.mesh, one.memory
    return {
        "robots": str(one.robots),
        "simulated s": f"{one.simulated_s:g}",
        "x real time": _range_text(mesh.real_time_factor, 1) if mesh else "-",
        "x, in memory": f"{memory.real_time_factor:.1f}",
        "CPU ms": _range_text(mesh.ms, 2) if mesh else "-",
        "CPU, in memory": f"{memory.ms:.2f}",
        "idle": "-" if one.idle_ms is None else f"{one.idle_ms:.2f}",
        "idle, in memory": f"{one.idle_memory_ms:.2f}",
        "start s": f"{mesh.startup_s.median:.1f}" if mesh else "-",
        "its CPU s": f"{mesh.startup_cpu_s.median:.1f}" if mesh else "-",
        "load": f"{one.load:.1f}",
        "yardstick": f"{one.yardstick_ms:.1f}",
    }


def _range_text(spread: Range, digits: int) -> str:
    return f"{spread.median:.{digits}f} ({spread.least:.{digits}f}-{spread.greatest:.{digits}f})"


def _package_table(swarms: Sequence[SwarmFigures]) -> Table:
    """Return a table of packages by number of robots, the most expensive first."""
    title = "CPU by package in memory, ms per robot and simulated second, in the proportions of a profile"
    table = Table("package", *(f"{one.robots} robots" for one in swarms), title=title)
    names = dict.fromkeys(package for one in swarms for package in one.memory.packages)
    for name in sorted(names, key=lambda name: -swarms[-1].memory.packages.get(name, 0.0)):
        table.add_row(name, *(f"{one.memory.packages.get(name, 0.0):.3f}" for one in swarms))
    table.add_row("all", *(f"{one.memory.ms:.3f}" for one in swarms), style="bold")
    return table


def _traffic_row(radio: Traffic) -> dict[str, float]:
    return {
        "published": radio.published, "frames sent": radio.frames, "copies computed": radio.copies,
        "frames heard": radio.heard, "packets": radio.packets, "new": radio.packets - radio.stale,
        "stale": radio.stale,
    }  # fmt: skip


def _process_rows(robots: int, mesh: MeshFigures) -> Iterator[dict[str, str]]:
    for name, usage in mesh.memory.items():
        yield {
            "robots": str(robots), "kind": name, "processes": str(usage.processes),
            "CPU ms": f"{mesh.by_actor[name]:.3f}" if name in mesh.by_actor else "-",
            "RSS": f"{usage.rss_mb:.1f}", "PSS": f"{usage.pss_mb:.1f}", "private": f"{usage.private_mb:.1f}",
            "PSS of one": f"{usage.mean_pss_mb:.1f}",
        }  # fmt: skip
