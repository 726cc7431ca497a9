"""What is measured of the whole stack with one number of robots."""

from dataclasses import dataclass
from typing import Final

from benchmarks.swarm.budget import Line
from benchmarks.swarm.in_memory import MemoryFigures
from benchmarks.swarm.over_mesh import MeshFigures
from benchmarks.swarm.process_figures import KINDS

STEPS_PER_SECOND: Final = 10
"""Of simulated time, in the scenario that is measured."""


@dataclass(frozen=True)
class SwarmFigures:
    """Everything for one number of robots."""

    robots: int
    simulated_s: float
    """Of each run."""
    mesh: MeshFigures
    memory: MemoryFigures
    ping_pong_ms: float
    """CPU of a bare Zenoh ping-pong of as many processes, as many steps a second, per robot, ms."""
    load: float
    """The machine's load average over the last minute, before."""
    yardstick_ms: float
    """CPU of a fixed piece of work beside it: the same machine is not always equally fast."""
    lines: list[Line]
    """The budget over Zenoh: the parts as in memory, and what comes with processes and mesh."""

    @property
    def speed(self) -> float:
        """Simulated seconds per second over Zenoh."""
        return self.mesh.real_time_factor.median

    @property
    def cost_ms(self) -> float:
        """CPU per robot and simulated second over Zenoh, ms."""
        return self.mesh.ms.median

    @property
    def memory_rate(self) -> float:
        """Robot-steps per CPU second in memory, which is one core's."""
        return STEPS_PER_SECOND / self.memory.ms * 1e3

    @property
    def mesh_rate(self) -> float:
        """Robot-steps per second over Zenoh, on all cores."""
        return STEPS_PER_SECOND * self.robots * self.speed

    @property
    def start_s(self) -> float:
        """Until the first step over Zenoh."""
        return self.mesh.startup_s.median

    @property
    def robot_pss_mb(self) -> float:
        """Of a robot's process, on average."""
        them = self.mesh.memory[KINDS[-1]]
        return them.pss_mb / them.processes
