"""The same swarm in navground (IDSIA), if it is installed: a simulator of crowds and robots in C++."""

import importlib.util
from importlib import metadata
from typing import Any

import numpy as np

from actors.floor.grid import OccupancyGrid, outline
from actors.geometry import Pose, Twist
from benchmarks.statistics.cpu_time import best
from benchmarks.world.plain_swarm import strewn, turtlebot, wishes


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
