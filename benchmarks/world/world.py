"""How fast physics, collisions and scans alone are, in one process, beside navground and given figures."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from actors.floor.grid import OccupancyGrid, outline
from actors.floor.map_file import load_map
from actors.installation.repository import SHIPPED
from actors.world.physics import Arena
from actors.world.sensing import RangeSensors
from benchmarks.statistics.measured import Measured, SpeedGoal, at_least, table_of
from benchmarks.statistics.runs import best
from benchmarks.world import plain_swarm, scan
from benchmarks.world.plain_swarm import strewn, turtlebot, wishes

_CORRIDOR: Final = SHIPPED / "maps" / "corridor.yaml"
STAGE: Final = {
    (640, 4): 71.0,
    (640, 20): 9.3,
    (640, 50): 3.5,
    (640, 100): 1.9,
    (60, 4): 422.0,
    (60, 20): 61.0,
    (60, 50): 24.0,
    (60, 100): 9.6,
}
"""Simulated seconds per CPU second by rays and robots, given: Stage 4.3, one core of such a machine."""


@dataclass(frozen=True)
class WorldTask:
    """What is measured."""

    robots: tuple[int, ...] = (4, 20, 50, 100)
    rays: tuple[int, ...] = (640, 60)
    seconds_long: int = 10
    """Simulated time of a run; steps of 0.1 s, a scan of each robot per step."""
    repeats: int = 3
    """The fastest counts."""
    seed: int = 1
    stage_goal: float = 20.0
    """How many times as fast as Stage with 640 rays and 20 robots; nowhere slower than Stage or navground."""


@dataclass(frozen=True)
class WorldSpeed:
    """One number of robots and rays; speeds in simulated seconds per CPU second."""

    robots: int
    rays: int
    speed: float
    stage: float
    """Given."""
    ratio: float
    navground: float | None
    """None if navground is not installed."""
    substep_us: float
    """CPU time per sub-step of 10 ms, physics alone, µs."""
    scan_us: float
    """CPU time per scan, the rest, µs."""
    contacts: int


def measure(map_file: Path = _CORRIDOR, task: WorldTask | None = None) -> Measured:
    """The speeds for each number of robots and rays on that map, and those of scans beside pymunk's."""
    task = task or WorldTask()
    grid = load_map(map_file)
    speeds = [_measure(grid, robots, rays, task) for rays in task.rays for robots in task.robots]
    goals, peer, scans = _judged(speeds, task), plain_swarm.version(), scan.measure(map_file)
    figures = {
        "task": asdict(task),
        "navground": peer,
        "speeds": [asdict(speed) for speed in speeds],
        "goals": [asdict(goal) for goal in goals],
        "scans": scans.figures,
    }
    beside = "navground is not installed: it was NOT measured."
    if peer is not None:
        beside = f"navground {peer}: steps of 0.1 s, no masses and no pushing, the same scans."
    shown = (
        table_of(list(map(_row, speeds)), f"physics and scans on {map_file.name}: simulated s per CPU s"),
        "Stage: given figures of Stage 4.3, one core of such a machine.",
        beside,
        *map(str, goals),
        *scans.shown,
    )
    return Measured(figures, shown)


def _judged(speeds: list[WorldSpeed], task: WorldTask) -> list[SpeedGoal]:
    """Each goal that can be judged from what was measured."""
    dense = [speed.ratio for speed in speeds if (speed.rays, speed.robots) == (640, 20)]
    goals = [at_least("times Stage with 640 rays and 20 robots", dense[0], task.stage_goal)] if dense else []
    goals.append(at_least("times Stage everywhere", min(speed.ratio for speed in speeds), 1))
    beside = [speed.speed / speed.navground for speed in speeds if speed.navground is not None]
    return [*goals, at_least("times navground everywhere", min(beside), 1)] if beside else goals


def _row(one: WorldSpeed) -> dict[str, str]:
    return {
        "rays": str(one.rays),
        "robots": str(one.robots),
        "speed": f"{one.speed:,.0f}",
        "Stage": f"{one.stage:g}",
        "ratio": f"{one.ratio:.1f}",
        "navground": "-" if one.navground is None else f"{one.navground:,.1f}",
        "µs/sub-step": f"{one.substep_us:.1f}",
        "µs/scan": f"{one.scan_us:.1f}",
        "bumps": str(one.contacts),
    }


def _measure(grid: OccupancyGrid, robots: int, rays: int, task: WorldTask) -> WorldSpeed:
    def swarm() -> _WanderingSwarm:
        return _WanderingSwarm(grid, robots, rays, task)

    contacts: list[int] = []
    whole = best(swarm, lambda it: contacts.append(it.wander(scanning=True)), task.repeats)
    physics = best(swarm, lambda it: it.wander(scanning=False), task.repeats)
    speed, stage = task.seconds_long / whole, STAGE[rays, robots]
    return WorldSpeed(
        robots=robots,
        rays=rays,
        speed=speed,
        stage=stage,
        ratio=speed / stage,
        navground=plain_swarm.speed(grid, robots, rays, task.seconds_long, task.repeats, task.seed),
        substep_us=physics / (task.seconds_long * 100) * 1e6,
        scan_us=(whole - physics) / (task.seconds_long * 10 * robots) * 1e6,
        contacts=contacts[0],
    )


class _WanderingSwarm:
    """Robots that wander and scan."""

    def __init__(self, grid: OccupancyGrid, robots: int, rays: int, task: WorldTask) -> None:
        rng = np.random.default_rng(task.seed)
        models = [turtlebot(rays)] * robots
        names = [f"r{index}" for index in range(robots)]
        self.arena = Arena(outline(grid), names, models, strewn(grid, robots, rng))
        self.sensors = RangeSensors(grid, models, rng.spawn(robots))
        self.wishes = wishes(robots, task.seconds_long, task.seed)

    def wander(self, scanning: bool) -> int:
        """Drive, and scan, in steps of 0.1 s, with new wishes every second; gives how many contacts began."""
        arena, everyone = self.arena, range(len(self.arena))
        for twists in self.wishes:
            for _ in range(10):
                for index, twist in enumerate(twists):
                    arena.command(index, twist, arena.now)
                arena.advance(10)
                if scanning:
                    self.sensors.scan(everyone, arena.poses, arena.obstacles)
        return arena.contacts
