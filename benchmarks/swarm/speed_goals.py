"""What a full swarm is to keep to on two cores, and whether it does."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

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

    @property
    def memory_rate(self) -> float:
        """Robot-steps per CPU second in memory, which is one core's."""

    @property
    def mesh_rate(self) -> float:
        """Robot-steps per second over Zenoh, on all cores."""

    @property
    def start_s(self) -> float:
        """Until the first step over Zenoh."""

    @property
    def robot_pss_mb(self) -> float:
        """Of a robot's process, on average."""


def judged(swarms: Sequence[Measured]) -> list[SpeedGoal]:
    """The goals for the swarms that were measured."""
    by_robots = {swarm.robots: swarm for swarm in swarms}
    goals = [
        _least("simulated seconds per second over Zenoh", robots, by_robots[robots].speed, goal)
        for robots, goal in SPEED.items()
        if robots in by_robots
    ]
    if FEW in by_robots and MANY in by_robots:
        factor = by_robots[MANY].cost_ms / by_robots[FEW].cost_ms
        goals.append(_most(f"CPU per robot and second as with {FEW}, times", MANY, factor, GROWTH))
    goals += [
        _least(
            "robot-steps per second of one core in memory, as over Zenoh on all",
            swarm.robots,
            swarm.memory_rate,
            swarm.mesh_rate,
        )
        for swarm in swarms
    ]
    if MANY in by_robots:
        many = by_robots[MANY]
        goals.append(_most("s until the first step", MANY, many.start_s, START_S))
        goals.append(_most("MB of memory (PSS) for each robot's process", MANY, many.robot_pss_mb, PSS_MB))
    return goals


def _least(what: str, robots: int, figure: float, goal: float) -> SpeedGoal:
    return SpeedGoal(
        f"{robots} robots: {what}, at least {goal:,.5g}", (robots,), figure, goal, figure >= goal
    )


def _most(what: str, robots: int, figure: float, goal: float) -> SpeedGoal:
    return SpeedGoal(f"{robots} robots: {what}, at most {goal:g}", (robots,), figure, goal, figure <= goal)
