"""What a full swarm over Zenoh is to keep to on two cores, and whether it does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

SPEED: Final = {4: 40.0, 20: 8.0, 50: 3.0}
"""Simulated seconds per second, at least, by the number of robots."""
COST_MS: Final = {20: 6.0}
"""CPU per robot and simulated second, ms, at most."""
FEW: Final = 4
MANY: Final = 50
GROWTH: Final = 1.6
"""How many times the CPU per robot and second of FEW robots each of MANY may take."""


@dataclass(frozen=True)
class SpeedGoal:
    """One goal, beside what was measured."""

    words: str
    robots: tuple[int, ...]
    """The swarms that it is about."""
    figure: float
    goal: float
    met: bool


class Measured(Protocol):
    """One swarm, as far as the goals go."""

    @property
    def robots(self) -> int:
        """How many."""

    @property
    def speed(self) -> float:
        """Simulated seconds per second over Zenoh."""

    @property
    def cost_ms(self) -> float:
        """CPU per robot and simulated second over Zenoh, ms."""


def judged(swarms: Sequence[Measured]) -> list[SpeedGoal]:
    """The goals for the swarms that were measured."""
    by_robots = {swarm.robots: swarm for swarm in swarms}
    goals = []
    for robots, goal in SPEED.items():
        if robots in by_robots:
            speed = by_robots[robots].speed
            words = f"{robots} robots: simulated seconds per second, at least {goal:g}"
            goals.append(SpeedGoal(words, (robots,), speed, goal, speed >= goal))
    for robots, goal in COST_MS.items():
        if robots in by_robots:
            cost = by_robots[robots].cost_ms
            words = f"{robots} robots: CPU ms per robot and second, at most {goal:g}"
            goals.append(SpeedGoal(words, (robots,), cost, goal, cost <= goal))
    if FEW in by_robots and MANY in by_robots:
        factor = by_robots[MANY].cost_ms / by_robots[FEW].cost_ms
        words = f"{MANY} robots: CPU per robot and second as with {FEW}, times at most {GROWTH:g}"
        goals.append(SpeedGoal(words, (MANY,), factor, GROWTH, factor <= GROWTH))
    return goals
