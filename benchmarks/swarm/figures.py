"""What is measured of the whole stack with one number of robots, and the goals that it is judged by."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from benchmarks.swarm.budget import Line
from benchmarks.swarm.in_memory import MemoryFigures
from benchmarks.swarm.over_mesh import MeshFigures
from benchmarks.swarm.ping_pong.players import PingPong
from benchmarks.swarm.process_figures import KINDS, Memory

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
    lines: list[Line]
    """The budget over Zenoh: the parts as in memory, and what comes with processes and mesh."""

    @property
    def ping_pong_ms(self) -> float:
        """CPU of the ping-pong, ms."""
        return self.ping_pong.cpu_us * STEPS_PER_SECOND / 1e3


@dataclass(frozen=True)
class SpeedGoal:
    """One goal, beside what was measured."""

    words: str
    figure: float
    goal: float
    met: bool


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
    goals = [
        _goal(robots, "simulated seconds per second over Zenoh", meshes[robots].real_time_factor.median, goal)
        for robots, goal in SPEED.items()
        if robots in meshes
    ]
    goals += [goal for one in swarms if one.mesh for goal in _in_memory(one, one.mesh)]
    many = meshes.get(MANY)
    if many and FEW in meshes:
        factor = many.ms.median / meshes[FEW].ms.median
        goals.append(
            _goal(MANY, f"CPU per robot and second as with {FEW}, times", factor, GROWTH, least=False)
        )
    if many:
        goals.append(_goal(MANY, "s until the first step", many.startup_s.median, START_S, least=False))
        size = memory_mb(many.memory, ROBOTS)
        goals.append(_goal(MANY, "MB of memory (PSS) for each robot's process", size, PSS_MB, least=False))
    return goals


def _in_memory(one: SwarmFigures, mesh: MeshFigures) -> Iterator[SpeedGoal]:
    what = "robot-steps per second of one core in memory, as over Zenoh on all"
    rate = STEPS_PER_SECOND * one.robots * mesh.real_time_factor.median
    yield _goal(one.robots, what, STEPS_PER_SECOND / one.memory.ms * 1e3, rate)


def _goal(robots: int, what: str, figure: float, goal: float, *, least: bool = True) -> SpeedGoal:
    words = f"{robots} robots: {what}, at {'least' if least else 'most'} {goal:,.5g}"
    return SpeedGoal(words, figure, goal, figure >= goal if least else figure <= goal)
