"""`acrc bench world`: speed of physics and scans, compared with pymunk and published figures of Stage."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final, TypeVar

import numpy as np
import pymunk
from numpy.random import Generator

from acrc_testbed.benchmarks.benchmark_result import (
    BenchmarkResult,
    SpeedGoal,
    make_table,
    max_goal,
    min_goal,
)
from actors.array_types import Floats
from actors.floor.grid import OccupancyGrid, outline
from actors.floor.map_file import load_map
from actors.floor.placement import draw_points
from actors.geometry import Pose, Twist
from actors.installation.repository import SHIPPED
from actors.messages import NO_ECHO_MM
from actors.robot_model import RobotModel, load_model, scan_angles
from actors.world.physics import Arena
from actors.world.sensing import RangeSensors

T = TypeVar("T")


def fastest_s(prepare: Callable[[], T], work: Callable[[T], object], repeats: int) -> float:
    """Return the CPU time of the fastest repeat of `work`, after a warm-up, s.

    Each repeat gets a new result of `prepare`, which is not timed.
    """
    work(prepare())
    times = []
    for _ in range(repeats):
        prepared = prepare()
        began = time.process_time()
        work(prepared)
        times.append(time.process_time() - began)
    return min(times)


def turtlebot(rays: int) -> RobotModel:
    """Return the chapter's robot with this number of rays."""
    return load_model("turtlebot2", "chapter").with_sensor(rays=rays)


def random_poses(grid: OccupancyGrid, count: int, rng: Generator) -> list[Pose]:
    """Draw poses on the largest region of the map, apart from each other and from walls."""
    points = draw_points(grid, count, rng=rng, clearance=0.25, apart=0.5)
    return [Pose(x, y, rng.uniform(-np.pi, np.pi)) for x, y in points]


@dataclass(frozen=True)
class ScanTask:
    """Size of a measurement."""

    rays: tuple[int, ...] = (64, 128, 640)
    robots: int = 20
    repeats: int = 15
    """Number of runs, of which the fastest counts."""
    peer_repeats: int = 3
    """Number of runs of pymunk."""
    seed: int = 1
    ratio_goal: float = 20.0
    difference_goal_mm: float = 5.0


def measure_scans(map_file: Path, task: ScanTask | None = None) -> BenchmarkResult:
    """Measure the speed of scans on a map for each number of rays."""
    task = task or ScanTask()
    speeds = [_measure_scan(map_file, rays, task) for rays in task.rays]
    goals = []
    for speed in speeds:
        rays = f"pymunk with {speed['rays']} rays"
        goals.append(min_goal(f"speed relative to {rays}", speed["ratio"], task.ratio_goal))
        goals.append(max_goal(f"mm from {rays}", speed["median_difference_mm"], task.difference_goal_mm))
    figures = {"task": asdict(task), "speeds": speeds, "goal_met": all(goal.met for goal in goals)}
    title = f"scans by {task.robots} robots on {map_file.name}; disagreements: share of rays beyond 5 mm"
    return BenchmarkResult(figures, (make_table(speeds, title, ".4g"), *map(str, goals)))


def _measure_scan(map_file: Path, rays: int, task: ScanTask) -> dict[str, float]:
    """Return scans per CPU second here and in pymunk (one query per ray), and the differences of ranges."""
    grid, model = load_map(map_file), turtlebot(rays)
    rng = np.random.default_rng(task.seed)
    poses = random_poses(grid, task.robots, rng)
    everyone, where, nothing = range(task.robots), np.array(poses), np.empty((0, 3))
    sensors = RangeSensors(grid, [model] * task.robots, rng.spawn(task.robots))
    sensor, radius = model.sensor, model.footprint.circumradius
    peer = _PymunkScene(outline(grid), poses, radius, scan_angles(sensor), sensor.x, sensor.range_max)
    ours = task.robots / fastest_s(
        lambda: sensors, lambda it: it.scan(everyone, where, nothing), task.repeats
    )
    theirs = task.robots / fastest_s(lambda: peer, lambda it: list(map(it.scan, everyone)), task.peer_repeats)
    scans = np.array(sensors.scan(everyone, where, nothing), np.float64)
    scans[scans == NO_ECHO_MM] = np.inf
    others = np.array([peer.scan(k) for k in everyone]) * 1000
    with np.errstate(invalid="ignore"):
        difference = np.abs(scans - others)
    both = np.isfinite(scans) & np.isfinite(others)
    neither = np.isinf(scans) & np.isinf(others)
    agreeing = neither | (both & (difference <= 5.0))
    return {
        "rays": rays,
        "scans_per_second": ours,
        "pymunk_scans_per_second": theirs,
        "ratio": ours / theirs,
        "median_difference_mm": median(difference[both].tolist()),
        "disagreements": 1 - float(agreeing.mean()),
    }


class _PymunkScene:
    """The same scene in pymunk, with one query per ray."""

    def __init__(
        self,
        segments: Floats,
        poses: list[Pose],
        radius: float,
        angles: Floats,
        mount: float,
        reach: float,
    ) -> None:
        self._reach = reach
        self.space = pymunk.Space()
        for x0, y0, x1, y1 in segments.tolist():
            self.space.add(pymunk.Segment(self.space.static_body, (x0, y0), (x1, y1), 0.0))
        self.filters, self.rays = [], []
        for index, pose in enumerate(poses):
            body = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
            body.position = pose.x, pose.y
            disc = pymunk.Circle(body, radius)
            disc.filter = pymunk.ShapeFilter(group=index + 1)
            self.space.add(body, disc)
            self.filters.append(disc.filter)
            x, y, heading = pose.compose(Pose(mount, 0.0, 0.0))
            ends = np.stack([np.cos(heading + angles), np.sin(heading + angles)], axis=1) * reach
            self.rays.append(((x, y), (ends + np.array([x, y])).tolist()))
        self.space.step(1e-6)  # moves shapes to their bodies

    def scan(self, robot: int) -> list[float]:
        """Return ranges, m; inf without a hit."""
        start, ends = self.rays[robot]
        hits = [self.space.segment_query_first(start, end, 0.0, self.filters[robot]) for end in ends]
        return [hit.alpha * self._reach if hit else np.inf for hit in hits]


_CORRIDOR: Final = SHIPPED / "maps" / "corridor.yaml"
STAGE_SPEEDS: Final = {
    **{(640, 4): 71.0, (640, 20): 9.3, (640, 50): 3.5, (640, 100): 1.9},
    **{(60, 4): 422.0, (60, 20): 61.0, (60, 50): 24.0, (60, 100): 9.6},
}
"""Simulated seconds per CPU second by rays and robots of Stage 4.3, one core of such a machine."""


@dataclass(frozen=True)
class WorldTask:
    """Size of a measurement."""

    robots: tuple[int, ...] = (4, 20, 50, 100)
    rays: tuple[int, ...] = (640, 60)
    seconds_long: int = 10
    """Simulated time of a run; steps of 0.1 s, a scan of each robot per step."""
    repeats: int = 3
    """Number of runs, of which the fastest counts."""
    seed: int = 1
    stage_goal: float = 20.0
    """Speed relative to Stage with 640 rays and 20 robots; elsewhere at least 1."""


def measure(map_file: Path = _CORRIDOR, task: WorldTask | None = None) -> BenchmarkResult:
    """Measure physics and scans for each number of robots and rays, and scans compared with pymunk."""
    task = task or WorldTask()
    grid = load_map(map_file)
    speeds = [_measure(grid, robots, rays, task) for rays in task.rays for robots in task.robots]
    goals, scans = _goals(speeds, task), measure_scans(map_file)
    figures = {
        "task": asdict(task),
        "speeds": speeds,
        "goals": [asdict(goal) for goal in goals],
        "scans": scans.figures,
    }
    shown = (
        make_table(speeds, f"physics and scans on {map_file.name}: simulated s per CPU s", ".4g"),
        "Stage: published figures of Stage 4.3, one core of such a machine.",
        *map(str, goals),
        *scans.shown,
    )
    return BenchmarkResult(figures, shown)


def _goals(speeds: list[dict[str, Any]], task: WorldTask) -> list[SpeedGoal]:
    """Return the goals of the measured speeds."""
    goals = [
        min_goal("speed relative to Stage with 640 rays and 20 robots", speed["ratio"], task.stage_goal)
        for speed in speeds
        if (speed["rays"], speed["robots"]) == (640, 20)
    ]
    goals.append(min_goal("minimum speed relative to Stage", min(speed["ratio"] for speed in speeds), 1))
    return goals


def _measure(grid: OccupancyGrid, robots: int, rays: int, task: WorldTask) -> dict[str, Any]:
    """Return speeds, simulated s per CPU s, and CPU time of a sub-step of 10 ms and of a scan, µs."""

    def swarm() -> _WanderingSwarm:
        return _WanderingSwarm(grid, robots, rays, task)

    contacts: list[int] = []
    whole = fastest_s(swarm, lambda it: contacts.append(it.wander(scanning=True)), task.repeats)
    physics = fastest_s(swarm, lambda it: it.wander(scanning=False), task.repeats)
    speed, stage = task.seconds_long / whole, STAGE_SPEEDS[rays, robots]
    return {
        "robots": robots,
        "rays": rays,
        "speed": speed,
        "stage": stage,
        "ratio": speed / stage,
        "substep_us": physics / (task.seconds_long * 100) * 1e6,
        "scan_us": (whole - physics) / (task.seconds_long * 10 * robots) * 1e6,
        "contacts": contacts[0],
    }


class _WanderingSwarm:
    """Robots that wander and scan."""

    def __init__(self, grid: OccupancyGrid, robots: int, rays: int, task: WorldTask) -> None:
        rng = np.random.default_rng(task.seed)
        models = [turtlebot(rays)] * robots
        names = [f"r{index}" for index in range(robots)]
        self.arena = Arena(outline(grid), names, models, random_poses(grid, robots, rng))
        self.sensors = RangeSensors(grid, models, rng.spawn(robots))
        self.velocities: Floats = np.random.default_rng(task.seed).uniform(
            (0.0, 0.0, -1.0), (0.5, 0.0, 1.0), (task.seconds_long, robots, 3)
        )

    def wander(self, scanning: bool) -> int:
        """Drive in steps of 0.1 s with a new velocity every second; return the number of contacts.

        `scanning`: each robot also scans in each step.
        """
        arena, everyone = self.arena, range(len(self.arena))
        for second in self.velocities.tolist():
            twists = [Twist(*velocity) for velocity in second]
            for _ in range(10):
                for index, twist in enumerate(twists):
                    arena.command(index, twist, arena.now)
                arena.advance(10)
                if scanning:
                    self.sensors.scan(everyone, arena.poses, arena.obstacles)
        return arena.contacts
