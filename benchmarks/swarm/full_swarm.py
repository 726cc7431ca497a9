"""The whole stack with many robots, over Zenoh and in memory: speed, CPU time by part, memory."""

import json
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from statistics import median
from typing import Any, Final

from rich.console import Console

from benchmarks.swarm import part_clock, speed_goals, steps, tables
from benchmarks.swarm.budget import with_processes
from benchmarks.swarm.figures import SwarmFigures
from benchmarks.swarm.in_memory import in_memory, profile
from benchmarks.swarm.over_mesh import over_mesh
from benchmarks.swarm.task import SwarmTask

BEYOND: Final = "processes and mesh"
"""What an actor costs as a process of its own beyond its parts in one process with all others."""
_YARDSTICK: Final = 300_007
"""Numbers; a prime, so that multiplication leads through many of them in no order a processor foresees."""


def run(task: SwarmTask | None = None, json_output: bool = False) -> dict[str, Any]:
    """Measure, print and give the figures."""
    task = task or SwarmTask()
    console = Console(stderr=True)
    figures = _figures(task, console)
    goals = speed_goals.judged(figures)
    missed = {robots for goal in goals if not goal.met for robots in goal.robots}
    profiles = {count: profile(count, task) for count in sorted(missed)[-1:]}  # it shows the most
    if json_output:
        sys.stdout.write(json.dumps(_plain(task, figures, goals, profiles)) + "\n")
    else:
        tables.show(task, figures, goals, profiles)
    return _plain(task, figures, goals, profiles)


def _plain(
    task: SwarmTask,
    figures: Sequence[SwarmFigures],
    goals: Sequence[speed_goals.SpeedGoal],
    profiles: Mapping[int, str],
) -> dict[str, Any]:
    return {
        "task": asdict(task) | {"scenario": str(task.scenario)},
        "cores": os.cpu_count(),
        "swarms": [asdict(one) for one in figures],
        "goals": [asdict(goal) for goal in goals],
        "profiles": profiles,
    }


def _figures(task: SwarmTask, console: Console) -> list[SwarmFigures]:
    """Over Zenoh first: what runs in memory leave behind would be the parent's memory."""
    clock_cost = part_clock.overhead()
    meshes, figures = {}, []
    for count in task.robots:
        console.print(f"{count} robots over Zenoh …", highlight=False)
        load, before = os.getloadavg()[0], yardstick()
        meshes[count] = (load, before, over_mesh(count, task), yardstick())
    for count, (load, before, mesh, after) in meshes.items():
        console.print(f"{count} robots in memory …", highlight=False)
        memory = in_memory(count, task, clock_cost)
        _, step_us = steps.ping_pong(count, round(task.simulated_s(count) * 10))
        figures.append(
            SwarmFigures(
                robots=count,
                simulated_s=task.simulated_s(count),
                mesh=mesh,
                memory=memory,
                ping_pong_ms=step_us * 10 / 1e3,  # ten steps a second
                load=load,
                yardstick_ms=median((before, after, yardstick())),
                lines=with_processes(memory.lines, mesh.by_actor, BEYOND),
            )
        )
    return figures


def yardstick() -> float:
    """CPU of a fixed piece of work in plain Python, on more memory than a core's own cache holds, ms."""
    numbers = list(range(_YARDSTICK))
    begun = time.thread_time_ns()
    place = 1
    for _ in range(_YARDSTICK):
        place = numbers[place * 48_271 % _YARDSTICK]
    return (time.thread_time_ns() - begun) / 1e6
