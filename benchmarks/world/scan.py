"""How fast scans are computed, and how exactly, beside pymunk's own segment queries in the same run."""

from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

import numpy as np
import pymunk
from numpy.typing import NDArray

from actors.floor.grid import outline
from actors.floor.map_file import load_map
from actors.geometry import Pose
from actors.messages import NO_ECHO_MM
from actors.robot_model import scan_angles
from actors.world.sensing import RangeSensors
from benchmarks.statistics.measured import Measured, at_least, at_most, table_of
from benchmarks.statistics.runs import best
from benchmarks.world.plain_swarm import strewn, turtlebot


@dataclass(frozen=True)
class ScanSpeed:
    """One number of rays."""

    rays: int
    scans_per_second: float
    """Of CPU time, all robots of the swarm in one call."""
    pymunk_scans_per_second: float
    """Of CPU time, one segment_query_first per ray."""
    ratio: float
    median_difference_mm: float
    """Between both, over all rays of all robots that met something in both."""
    disagreements: float
    """Share of the rays that differ by more than 5 mm, or where one of both met nothing."""


@dataclass(frozen=True)
class ScanTask:
    """What is measured."""

    rays: tuple[int, ...] = (64, 128, 640)
    robots: int = 20
    repeats: int = 15
    """The fastest counts."""
    peer_repeats: int = 3
    """The same for pymunk."""
    seed: int = 1
    ratio_goal: float = 20.0
    difference_goal_mm: float = 5.0


def measure(map_file: Path, task: ScanTask | None = None) -> Measured:
    """The speeds for each number of rays on that map."""
    task = task or ScanTask()
    speeds = [_measure(map_file, rays, task) for rays in task.rays]
    goals = [
        goal
        for speed in speeds
        for goal in (
            at_least(f"times pymunk with {speed.rays} rays", speed.ratio, task.ratio_goal),
            at_most(
                f"mm from pymunk with {speed.rays} rays", speed.median_difference_mm, task.difference_goal_mm
            ),
        )
    ]
    figures = {
        "task": asdict(task),
        "speeds": [asdict(speed) for speed in speeds],
        "goal_met": all(goal.met for goal in goals),
    }
    title = f"scans by {task.robots} robots on {map_file.name}"
    return Measured(figures, (table_of(list(map(_row, speeds)), title), *map(str, goals)))


def _row(one: ScanSpeed) -> dict[str, str]:
    return {
        "rays": str(one.rays),
        "scans per CPU second": f"{one.scans_per_second:,.0f}",
        "pymunk": f"{one.pymunk_scans_per_second:,.0f}",
        "ratio": f"{one.ratio:.0f}",
        "median difference": f"{one.median_difference_mm:.2f} mm",
        "beyond 5 mm": f"{one.disagreements:.2%}",
    }


def _measure(map_file: Path, rays: int, task: ScanTask) -> ScanSpeed:
    grid, model = load_map(map_file), turtlebot(rays)
    rng = np.random.default_rng(task.seed)
    poses = strewn(grid, task.robots, rng)
    everyone, where, nothing = range(task.robots), np.array(poses), np.empty((0, 3))
    sensors = RangeSensors(grid, [model] * task.robots, rng.spawn(task.robots))
    sensor, radius = model.sensor, model.footprint.circumradius
    peer = _PymunkScene(outline(grid), poses, radius, scan_angles(sensor), sensor.x, sensor.range_max)
    ours = task.robots / best(lambda: sensors, lambda it: it.scan(everyone, where, nothing), task.repeats)
    theirs = task.robots / best(lambda: peer, lambda it: list(map(it.scan, everyone)), task.peer_repeats)
    scans = np.array(sensors.scan(everyone, where, nothing), np.float64)
    scans[scans == NO_ECHO_MM] = np.inf
    others = np.array([peer.scan(k) for k in everyone]) * 1000
    with np.errstate(invalid="ignore"):
        difference = np.abs(scans - others)
    both = np.isfinite(scans) & np.isfinite(others)
    neither = np.isinf(scans) & np.isinf(others)
    agreeing = neither | (both & (difference <= 5.0))
    return ScanSpeed(
        rays, ours, theirs, ours / theirs, median(difference[both].tolist()), 1 - float(agreeing.mean())
    )


class _PymunkScene:
    """The same scene in pymunk, asked ray by ray."""

    def __init__(
        self,
        segments: NDArray[np.float64],
        poses: list[Pose],
        radius: float,
        angles: NDArray[np.float64],
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
        self.space.step(1e-6)  # so that the shapes are where their bodies are

    def scan(self, robot: int) -> list[float]:
        """Ranges, m; inf where nothing was met. Where the rays end was computed beforehand."""
        start, ends = self.rays[robot]
        hits = [self.space.segment_query_first(start, end, 0.0, self.filters[robot]) for end in ends]
        return [hit.alpha * self._reach if hit else np.inf for hit in hits]
