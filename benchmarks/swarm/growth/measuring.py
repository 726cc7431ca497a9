"""Swarms of many sizes, each run for as long: in memory by part, over Zenoh as a whole."""

import os
import sys
from dataclasses import dataclass

from rich.console import Console

from actors.runtime.errors import AcrcError
from benchmarks.swarm import part_clock
from benchmarks.swarm.budget import Line, whole
from benchmarks.swarm.in_memory import MemoryFigures, in_memory
from benchmarks.swarm.over_mesh import MeshFigures, over_mesh
from benchmarks.swarm.process_figures import KINDS, Memory
from benchmarks.swarm.task import SwarmTask


@dataclass(frozen=True)
class Traffic:
    """What goes through the air, each per robot and simulated second."""

    published: float
    """Packets of the robot's own knowledge."""
    frames: float
    """On the air, relayed ones included."""
    copies: float
    """Frames at other transceivers, heard or not: what the medium computes."""
    heard: float
    """Frames received."""
    packets: float
    """Packets out of them, those of the robot's own knowledge included."""
    stale: float
    """Of these, no news: as old as what is known, or the robot's own."""

    @property
    def news(self) -> float:
        """Packets that say something new."""
        return self.packets - self.stale


@dataclass(frozen=True)
class MeshTotals:
    """Over Zenoh, a process for each actor."""

    ms: float
    """CPU per robot and simulated second."""
    real_time_factor: float
    start_s: float
    memory: dict[str, Memory]
    """By kind of process, at the run's end."""


@dataclass(frozen=True)
class SizeFigures:
    """One number of robots."""

    robots: int
    ms: float
    """CPU per robot and simulated second in memory, nothing measured inside."""
    lines: list[Line]
    """The same by part, of another run."""
    traffic: Traffic
    mesh: MeshTotals | None
    """None if so many processes do not run here."""
    load: float
    """Load average over the last minute, before."""

    def of(self, actor: str) -> float:
        """All parts of a kind of actor, ms."""
        return whole([line for line in self.lines if line.actor == actor])


def measured(task: SwarmTask) -> list[SizeFigures]:
    """Every size; over Zenoh first, for what runs in memory leave behind would be the parent's memory."""
    say = Console(stderr=True)
    clock_cost = part_clock.overhead()
    loads, meshes, found = {}, {}, []
    for robots in task.robots:
        say.print(f"{robots} robots over Zenoh …", highlight=False)
        loads[robots] = os.getloadavg()[0]
        meshes[robots] = _mesh(robots, task)
    for robots in task.robots:
        say.print(f"{robots} robots in memory …", highlight=False)
        memory = in_memory(robots, task, clock_cost)
        size = SizeFigures(
            robots, memory.ms, memory.lines, traffic(robots, memory), meshes[robots], loads[robots]
        )
        found.append(size)
    return found


def _mesh(robots: int, task: SwarmTask) -> MeshTotals | None:
    try:
        mesh: MeshFigures = over_mesh(robots, task)
    except AcrcError as error:
        sys.stderr.write(f"acrc: {robots} robots do not run over Zenoh: {error}\n")
        return None
    return MeshTotals(mesh.ms.median, mesh.real_time_factor.median, mesh.startup_s.median, dict(mesh.memory))


def traffic(robots: int, run: MemoryFigures) -> Traffic:
    """What a run's counters come to per robot and second."""
    robot_s = robots * run.simulated_s
    frames, node = run.frames, run.node
    copies = sum(count for name, count in frames.items() if name.startswith("copies_"))
    stale = node.get("packets_old", 0) + node.get("packets_own", 0)
    return Traffic(
        published=node.get("published", 0) / robot_s,
        frames=frames["frames_sent"] / robot_s,
        copies=copies / robot_s,
        heard=frames["copies_heard"] / robot_s,
        packets=node.get("packets", 0) / robot_s,
        stale=stale / robot_s,
    )


def memory_mb(memory: dict[str, Memory], kind: str) -> float:
    """Of one process of the kind, its share of common pages included, MB."""
    return memory[kind].pss_mb / memory[kind].processes


ROBOTS = KINDS[-1]
