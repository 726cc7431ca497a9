"""Small floor plans and robots for the tests of the world."""

import math

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Pose, Twist
from actors.robot_model import RobotModel, load_model
from actors.world.physics import Arena, disc, gap, smallest_gap, wall_gap

TURTLEBOT = load_model("turtlebot2")
OMNIBOX = load_model("omnibox")
AHEAD = Twist(0.5, 0.0, 0.0)


def with_sensor(model: RobotModel, **fields: float) -> RobotModel:
    return model.with_sensor(**fields)


def room(side: float = 5.0) -> NDArray[np.float64]:
    a, b = -side, side
    return np.array([[a, a, b, a], [a, b, b, b], [a, a, a, b], [b, a, b, b]])


def room_with_door(width: float = 0.9) -> NDArray[np.float64]:
    w = width / 2
    return np.concatenate(
        [
            room(),
            [[0, -5, 0, -w], [0.1, -5, 0.1, -w], [0, -w, 0.1, -w]],
            [[0, w, 0, 5], [0.1, w, 0.1, 5], [0, w, 0.1, w]],
        ]
    )


def arena(*poses: Pose, model: RobotModel = TURTLEBOT, walls: NDArray[np.float64] | None = None) -> Arena:
    names = [f"r{index}" for index in range(len(poses))]
    return Arena(room() if walls is None else walls, names, [model] * len(poses), poses)


def overlap(world: Arena) -> float:
    """Return the deepest overlap of robots, walls and obstacles, m, from poses and outlines."""
    shapes = list(world._shapes())
    obstacles = [disc(*obstacle) for obstacle in world.obstacles.tolist()]
    gaps = [min(wall_gap(shape, world._walls), smallest_gap(shape, obstacles)) for shape in shapes]
    reach = [2 * model.footprint.circumradius for model in world._models]
    apart = np.hypot(*(world.poses[:, None, :2] - world.poses[None, :, :2]).T)
    close = np.argwhere(np.triu(apart < max(reach, default=0.0), k=1)).tolist()
    gaps += [gap(shapes[a], shapes[b]) for a, b in close]
    return max(0.0, -min(gaps, default=0.0))


def towards(x: float, y: float, from_x: float, from_y: float) -> Pose:
    return Pose(from_x, from_y, math.atan2(y - from_y, x - from_x))


def clutter(seed: int, rows: int = 40, columns: int = 60, share: float = 0.08) -> OccupancyGrid:
    rng = np.random.default_rng(seed)
    cells = np.where(rng.random((rows, columns)) < share, OCCUPIED, FREE).astype(np.uint8)
    cells[rows // 2 - 6 : rows // 2 + 6, columns // 2 - 6 : columns // 2 + 6] = FREE
    return OccupancyGrid(cells, 0.05, origin=type(OccupancyGrid.origin)(-0.7, 0.3))
