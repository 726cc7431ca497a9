"""The whole stack with many robots, over Zenoh and in memory: speed, CPU time by part, traffic, memory."""

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from statistics import median
from typing import Final

from actors.console import screen
from actors.runtime.errors import AcrcError
from benchmarks.statistics.measured import Measured
from benchmarks.swarm import part_clock, tables
from benchmarks.swarm.in_memory import in_memory, plain_ms
from benchmarks.swarm.over_mesh import MeshFigures, over_mesh, plain_mesh_ms
from benchmarks.swarm.part_clock import with_processes
from benchmarks.swarm.ping_pong.players import played
from benchmarks.swarm.tables import IdleFigures, SwarmFigures, judged, traffic
from benchmarks.swarm.task import SwarmTask

BEYOND: Final = "processes and mesh"
"""What an actor costs as a process of its own beyond its parts in one process with all others."""
_IDLE: Final = Path(__file__).with_name("idle.toml")
_YARDSTICK: Final = 300_007
"""Numbers; a prime, so that multiplication leads through many of them in no order a processor foresees."""


def measure(
    robots: Sequence[int] | None = None,
    duration: float | None = None,
    repeat: int = SwarmTask.repeat,
) -> Measured:
    """Each number of robots for so many simulated s, and the median of so many runs over Zenoh.

    `duration`: None: as long as fits into minutes.
    """
    task = SwarmTask(tuple(robots or SwarmTask.robots), repeat=repeat)
    if duration is not None:
        task = replace(task, seconds=duration, robot_seconds=None)
    swarms = measured(task)
    goals = judged(swarms)
    figures = {
        "task": asdict(task) | {"scenario": str(task.scenario)},
        "cores": os.cpu_count(),
        "swarms": [asdict(one) for one in swarms],
        "goals": [asdict(goal) for goal in goals],
    }
    return Measured(figures, tables.shown(task, swarms, goals))


def measured(task: SwarmTask) -> list[SwarmFigures]:
    """Over Zenoh first: what runs in memory leave behind would be the parent's memory."""
    say = screen(stderr=True)
    clock_cost = part_clock.overhead()
    idle_task = replace(task, scenario=_IDLE)
    meshes, found = {}, []
    for count in task.robots:
        say.print(f"{count} robots over Zenoh …")
        load, before = os.getloadavg()[0], yardstick()
        mesh = _mesh(count, task)
        idle_ms = None if mesh is None else plain_mesh_ms(count, idle_task)
        meshes[count] = (load, before, mesh, idle_ms, yardstick())
    for count, (load, before, mesh, idle_ms, after) in meshes.items():
        say.print(f"{count} robots in memory …")
        memory = in_memory(count, task, clock_cost)
        found.append(
            SwarmFigures(
                robots=count,
                simulated_s=task.simulated_s(count),
                mesh=mesh,
                memory=memory,
                idle=None if idle_ms is None else IdleFigures(idle_ms, plain_ms(count, idle_task)),
                traffic=traffic(count, memory),
                ping_pong=played(count, round(task.simulated_s(count) * 10)),
                load=load,
                yardstick_ms=median((before, after, yardstick())),
                lines=memory.lines if mesh is None else with_processes(memory.lines, mesh.by_actor, BEYOND),
            )
        )
    return found


def _mesh(robots: int, task: SwarmTask) -> MeshFigures | None:
    try:
        return over_mesh(robots, task)
    except AcrcError as error:
        sys.stderr.write(f"acrc: {robots} robots do not run over Zenoh: {error}\n")
        return None


def yardstick() -> float:
    """CPU of a fixed piece of work in plain Python, on more memory than a core's own cache holds, ms."""
    numbers = list(range(_YARDSTICK))
    begun = time.thread_time_ns()
    place = 1
    for _ in range(_YARDSTICK):
        place = numbers[place * 48_271 % _YARDSTICK]
    return (time.thread_time_ns() - begun) / 1e6
