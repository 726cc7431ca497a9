"""What is measured of the whole stack with one number of robots."""

from dataclasses import dataclass

from benchmarks.swarm.budget import Line
from benchmarks.swarm.in_memory import MemoryFigures
from benchmarks.swarm.over_mesh import MeshFigures


@dataclass(frozen=True)
class SwarmFigures:
    """Everything for one number of robots."""

    robots: int
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
