"""Where courses are driven: a floor plan with what is computed once from it, in each process."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid, largest_region
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.robot.navigation.planning import Planner, ground
from actors.robot_model import RobotModel, load_model

GOAL_CLEARANCE: Final = 0.3
"""Goals and starts are at least so far from walls, m."""


@dataclass(frozen=True, eq=False)
class Site:
    """A floor plan as a driver of one robot model needs it."""

    grid: OccupancyGrid
    model: RobotModel

    @cached_property
    def planner(self) -> Planner:
        """Finds ways for the model's body."""
        return Planner(ground(self.grid, self.model.footprint.circumradius))

    @cached_property
    def _cells(self) -> NDArray[np.intp]:
        """(n, 2) row and column of the cells where goals may lie."""
        region = largest_region(self.grid, self.model.footprint.circumradius + 0.05)
        return np.argwhere(region & (self.grid.clearance >= GOAL_CLEARANCE))

    def point(self, generator: Generator) -> Point:
        """A point that the robot gets to, uniform over the cells with GOAL_CLEARANCE. Takes three numbers."""
        which, east, north = generator.random(3).tolist()
        row, column = self._cells[int(which * len(self._cells))].tolist()
        x, y = self.grid.origin
        return Point(x + (column + east) * self.grid.resolution, y + (row + north) * self.grid.resolution)


@lru_cache(maxsize=8)
def site(plan: str, sensor: str) -> Site:
    """That map file with a TurtleBot 2 with that sensor, made once per process. Raises MapError."""
    return Site(load_map(plan), load_model("turtlebot2", sensor))
