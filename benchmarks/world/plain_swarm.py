"""The swarm that the world's benchmarks measure: TurtleBots strewn over a map, wandering at random."""

import dataclasses
import importlib.util
from importlib import metadata
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid, outline
from actors.floor.placement import draw_points
from actors.geometry import Pose, Twist
from actors.robot_model import RobotModel, load_model
from benchmarks.statistics.runs import best


def turtlebot(rays: int) -> RobotModel:
    """The chapter's robot with so many rays."""
    model = load_model("turtlebot2", "chapter")
    return dataclasses.replace(model, sensor=model.sensor.model_copy(update={"rays": rays}))


def strewn(grid: OccupancyGrid, count: int, rng: Generator) -> list[Pose]:
    """So many poses on the largest region of the map, apart from each other and from the walls."""
    points = draw_points(grid, count, rng=rng, clearance=0.25, apart=0.5)
    return [Pose(x, y, rng.uniform(-np.pi, np.pi)) for x, y in points]


def wishes(count: int, seconds_long: int, seed: int) -> list[list[Twist]]:
    """A new random velocity for each robot and second: forward up to 0.5 m/s, turning up to 1 rad/s."""
    draws: NDArray[np.float64] = np.random.default_rng(seed).uniform(
        (0.0, 0.0, -1.0), (0.5, 0.0, 1.0), (seconds_long, count, 3)
    )
    return [[Twist(*draw) for draw in second] for second in draws.tolist()]


def version() -> str | None:
    """Of the installed navground; None if there is none."""
    return metadata.version("navground") if importlib.util.find_spec("navground") else None


def speed(
    grid: OccupancyGrid, robots: int, rays: int, seconds_long: int, repeats: int, seed: int
) -> float | None:
    """Simulated seconds per CPU second; None if it is not installed."""
    if version() is None:
        return None
    steps = wishes(robots, seconds_long, seed)
    return seconds_long / best(
        lambda: _Swarm(grid, robots, rays, seed), lambda swarm: swarm.simulate(steps), repeats
    )


class _Swarm:
    """Robots with lidars among walls."""

    def __init__(self, grid: OccupancyGrid, robots: int, rays: int, seed: int) -> None:
        self.core, self.sim = (importlib.import_module(f"navground.{name}") for name in ("core", "sim"))
        self.model = turtlebot(rays)
        self.world = self.sim.World()
        for x0, y0, x1, y1 in outline(grid).tolist():
            self.world.add_wall(self.sim.Wall((x0, y0), (x1, y1)))
        poses = strewn(grid, robots, np.random.default_rng(seed))
        self.robots = [self._robot(pose) for pose in poses]

    def simulate(self, steps: list[list[Twist]]) -> None:
        """Drive and scan in steps of 0.1 s, with new wishes every second."""
        for twists in steps:
            for (agent, _, _), twist in zip(self.robots, twists, strict=True):
                wish = self.core.Twist2((twist.vx, 0.0), twist.omega, self.core.Frame.relative)
                agent.behavior.target = self.core.Target.Twist(wish)
            for _ in range(10):
                self.world.run(1, 0.1)
                for agent, lidar, scan in self.robots:  # by hand: its agents scan for learned behaviours only
                    lidar.update(agent, self.world, scan)

    def _robot(self, pose: Pose) -> tuple[Any, Any, Any]:
        """An agent, its lidar, and what that writes to."""
        drive = self.core.kinematics.TwoWheelsDifferentialDriveKinematics(
            max_speed=self.model.drive.speed * 2, wheel_axis=0.23, max_forward_speed=self.model.drive.speed
        )
        agent = self.sim.Agent(
            radius=self.model.footprint.circumradius,
            behavior=self.core.Behavior.make_type("Dummy"),
            kinematics=drive,
            control_period=0.1,
        )
        agent.pose = self.core.Pose2((pose.x, pose.y), pose.heading)
        self.world.add_agent(agent)
        sensor = self.model.sensor
        lidar = self.sim.state_estimations.LidarStateEstimation(
            range=sensor.range_max, resolution=sensor.rays, position=(sensor.x, sensor.y)
        )
        scan = self.core.SensingState()
        lidar.prepare_state(scan)
        return agent, lidar, scan
