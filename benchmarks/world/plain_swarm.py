"""The swarm that the world's benchmarks measure: TurtleBots strewn over a map, wandering at random."""

import dataclasses

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.floor.placement import draw_points
from actors.geometry import Pose, Twist
from actors.robot_model import RobotModel, load_model


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
