"""What is measured of a whole swarm, the goals that it is judged by, and its tables."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich.table import Table

from benchmarks.statistics.measured import SpeedGoal, at_least, at_most, table_of
from benchmarks.swarm.in_memory import MemoryFigures
from benchmarks.swarm.over_mesh import MeshFigures
from benchmarks.swarm.part_clock import BudgetLine, whole
from benchmarks.swarm.ping_pong.players import PingPong
from benchmarks.swarm.process_figures import KINDS, Memory
from benchmarks.swarm.task import Range, SwarmTask

ROBOTS: Final = KINDS[-1]
STEPS_PER_SECOND: Final = 10
"""Of simulated time, in the scenarios that are measured."""
SPEED: Final = {4: 100.0, 20: 16.0, 50: 6.0, 100: 2.0}
"""Simulated seconds per second over Zenoh, at least, by the number of robots."""
FEW: Final = 4
MANY: Final = 100
GROWTH: Final = 1.3
"""How many times the CPU per robot and second of FEW robots each of MANY may take."""
START_S: Final = 6.0
"""Until MANY robots take their first step, at most."""
PSS_MB: Final = 25.0
"""Of each of MANY robots' processes, on average, at most."""


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
class IdleFigures:
    """Robots that do nothing: the step protocol, recording and isolation. CPU as of `SwarmFigures`, ms."""

    ms: float
    """Over Zenoh."""
    memory_ms: float


@dataclass(frozen=True)
class SwarmFigures:
    """Everything for one number of robots. CPU is per robot and simulated second."""

    robots: int
    simulated_s: float
    """Of each run."""
    mesh: MeshFigures | None
    """None if so many processes do not run here."""
    memory: MemoryFigures
    idle: IdleFigures | None
    """None as `mesh`."""
    traffic: Traffic
    ping_pong: PingPong
    """A bare Zenoh ping-pong of as many processes, as many steps a second."""
    load: float
    """The machine's load average over the last minute, before."""
    yardstick_ms: float
    """CPU of a fixed piece of work beside it: the same machine is not always equally fast."""
    lines: list[BudgetLine]
    """The budget over Zenoh: the parts as in memory, and what comes with processes and mesh."""

    @property
    def ping_pong_ms(self) -> float:
        """CPU of the ping-pong, ms."""
        return self.ping_pong.cpu_us * STEPS_PER_SECOND / 1e3


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


def judged(swarms: Sequence[SwarmFigures]) -> list[SpeedGoal]:
    """The goals for the swarms that were measured over Zenoh."""
    meshes = {one.robots: one.mesh for one in swarms if one.mesh}
    speed, rate = "simulated seconds per second over Zenoh", "robot-steps per second of one core in memory"
    goals = [
        at_least(f"{robots} robots: {speed}", meshes[robots].real_time_factor.median, goal)
        for robots, goal in SPEED.items()
        if robots in meshes
    ]
    goals += [
        at_least(
            f"{one.robots} robots: {rate}, as over Zenoh on all",
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
        goals.append(at_most(f"{MANY} robots: CPU per robot and second as with {FEW}, times", factor, GROWTH))
    size = memory_mb(many.memory, ROBOTS)
    return [
        *goals,
        at_most(f"{MANY} robots: s until the first step", many.startup_s.median, START_S),
        at_most(f"{MANY} robots: MB of memory (PSS) for each robot's process", size, PSS_MB),
    ]


def shown(task: SwarmTask, swarms: Sequence[SwarmFigures], goals: Sequence[SpeedGoal]) -> list[Table | str]:
    """Everything."""
    meshes = {one.robots: one.mesh for one in swarms if one.mesh}
    tables: list[Table | str] = [_speeds(swarms, task), _budget(swarms), _traffic(swarms)]
    if meshes:
        tables += [_processes(meshes), _memory(meshes)]
    return [*tables, *map(str, goals)]


def _speeds(swarms: Sequence[SwarmFigures], task: SwarmTask) -> Table:
    title = (
        f"{task.scenario.name}, over Zenoh: median (least-greatest) of {task.repeat}; CPU ms per robot and "
        "simulated second;\nothers: cores busy with something else; yardstick: CPU ms of fixed work"
    )
    return table_of([_speed(one) for one in swarms], title)


def _speed(one: SwarmFigures) -> dict[str, str]:
    mesh, memory, idle = one.mesh, one.memory, one.idle
    return {
        "robots": str(one.robots),
        "simulated s": f"{one.simulated_s:g}",
        "x real time": _spread(mesh.real_time_factor, 1) if mesh else "-",
        "x, in memory": f"{memory.real_time_factor:.1f}",
        "CPU ms": _spread(mesh.ms, 2) if mesh else "-",
        "CPU, in memory": f"{memory.ms:.2f}",
        "idle": f"{idle.ms:.2f}" if idle else "-",
        "idle, in memory": f"{idle.memory_ms:.2f}" if idle else "-",
        "ping-pong": f"{one.ping_pong_ms:.2f}",
        "start s": f"{mesh.startup_s.median:.1f}" if mesh else "-",
        "its CPU s": f"{mesh.startup_cpu_s.median:.1f}" if mesh else "-",
        "load": f"{one.load:.1f}",
        "others": f"{mesh.others.median:.1f}" if mesh else "-",
        "yardstick": f"{one.yardstick_ms:.1f}",
    }


def _spread(spread: Range, digits: int) -> str:
    return f"{spread.median:.{digits}f} ({spread.least:.{digits}f}-{spread.greatest:.{digits}f})"


def _budget(swarms: Sequence[SwarmFigures]) -> Table:
    """Every line for every number of robots, and what they add up to."""
    title = "CPU by part, ms per robot and simulated second, over Zenoh"
    table = Table("", "part", *(f"{one.robots} robots" for one in swarms), title=title)
    by_key = [{(line.actor, line.part): line.ms for line in one.lines} for one in swarms]
    actors = dict.fromkeys(line.actor for one in swarms for line in one.lines)
    for actor in actors:
        keys = dict.fromkeys(key for table_of in by_key for key in table_of if key[0] == actor)
        rows = [(key[1], [of.get(key, 0.0) for of in by_key]) for key in keys]
        for name, values in sorted(rows, key=lambda row: -row[1][-1]):
            table.add_row("", name, *(f"{value:.3f}" for value in values))
        sums = [whole([line for line in one.lines if line.actor == actor]) for one in swarms]
        table.add_row(actor, "all", *(f"{value:.3f}" for value in sums), style="bold")
        table.add_section()
    table.add_row("all", "", *(f"{whole(one.lines):.3f}" for one in swarms), style="bold")
    return table


def _traffic(swarms: Sequence[SwarmFigures]) -> Table:
    names = ("published", "frames sent", "copies computed", "frames heard", "packets", "news", "no news")
    table = Table("robots", *names, title="the air, per robot and simulated second")
    for one in swarms:
        of = one.traffic
        rates = (of.published, of.frames, of.copies, of.heard, of.packets, of.news, of.stale)
        table.add_row(str(one.robots), *(f"{rate:.2f}" for rate in rates))
    return table


def _processes(meshes: dict[int, MeshFigures]) -> Table:
    title = "processes: CPU ms per robot and simulated second, the kernel's share, context switches"
    table = Table("robots", "kind", "CPU ms", "kernel", "switches per robot and step", title=title)
    for robots, mesh in meshes.items():
        for actor, ms in mesh.by_actor.items():
            share, switches = mesh.system[actor], mesh.switches[actor]
            table.add_row(str(robots), actor, f"{ms:.3f}", f"{share:.0%}", f"{switches:.2f}")
        table.add_section()
    return table


def _memory(meshes: dict[int, MeshFigures]) -> Table:
    columns = ("robots", "kind", "processes", "RSS MB", "PSS MB", "private MB")
    table = Table(*columns, title="memory, all of a kind; a robot: PSS of one")
    for robots, mesh in meshes.items():
        for name, of in mesh.memory.items():
            sizes = (of.rss_mb, of.pss_mb, of.private_mb)
            table.add_row(str(robots), name, str(of.processes), *(f"{size:.1f}" for size in sizes))
        total = mesh.memory.values()
        sums = (sum(of.pss_mb for of in total), sum(of.private_mb for of in total))
        number = str(sum(of.processes for of in total))
        table.add_row(str(robots), "all", number, "", *(f"{size:.1f}" for size in sums), style="bold")
        table.add_row(str(robots), "a robot", "1", "", f"{memory_mb(mesh.memory, ROBOTS):.1f}", "")
        table.add_section()
    return table
