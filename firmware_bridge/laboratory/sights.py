"""What the robots' lidars see: walls and other robots, from where each body is at the moment."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.messages import NO_ECHO_MM
from actors.robot_model import RobotModel
from actors.world.sensing import RangeSensors
from firmware_bridge.range_sensors.rplidar_emulator import EmulatedRplidarParameters, Sight

LIDAR: Final = EmulatedRplidarParameters(turns=5.5, samples=1980)
"""360 samples a turn, so that each lies on a whole degree, where a ray has been cast."""
_RAYS: Final = 360


class Sights:
    """The world's range sensors, with a lidar's rays in place of those of the robots' models.

    It is mounted as the model's sensor is, and as noisy.
    """

    def __init__(
        self, grid: OccupancyGrid, models: Sequence[RobotModel], generators: Sequence[Generator]
    ) -> None:
        """`generators`: one per robot, for the noise of its ranges."""
        lidars = [_with_lidar(model) for model in models]
        self._sensors = RangeSensors(grid, lidars, generators)
        self._first = lidars[0].sensor.first_angle if lidars else 0.0
        self.poses: NDArray[np.float64] = np.zeros((len(models), 3))
        """(n, 3): where the bodies are, m, rad, map frame."""
        self._obstacles: NDArray[np.float64] = np.empty((0, 3))

    def look(self, poses: Sequence[tuple[float, ...]], obstacles: NDArray[np.float64]) -> None:
        """From now on the bodies are there, and the obstacles: (n, 3), x, y and radius, m."""
        self.poses[:] = poses
        self._obstacles = obstacles

    def of(self, index: int) -> Sight:
        """What one robot's lidar sees."""

        def sight(angles: NDArray[np.float64]) -> NDArray[np.float64]:
            (ranges_mm,) = self._sensors.scan([index], self.poses, self._obstacles)
            rays = np.rint((angles - self._first) / (math.tau / _RAYS)).astype(np.intp) % _RAYS
            seen = ranges_mm[rays]
            ranges: NDArray[np.float64] = np.where(seen == NO_ECHO_MM, np.inf, seen / 1000)
            return ranges

        return sight


def _with_lidar(model: RobotModel) -> RobotModel:
    lidar = {
        "field_of_view_deg": 360.0,
        "rays": _RAYS,
        "range_min": LIDAR.range_min,
        "range_max": LIDAR.range_max,
        "rate": LIDAR.turns,
    }
    return replace(model, sensor=model.sensor.model_copy(update=lidar))
