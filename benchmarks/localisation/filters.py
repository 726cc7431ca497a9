"""The localisations that are compared, by what is varied of them."""

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from actors.floor.grid import OccupancyGrid
from actors.geometry import Pose
from actors.randomness import generator
from actors.robot.localisation import (
    PRESETS,
    Amcl,
    AmclParameters,
    DeadReckoning,
    LikelihoodField,
    Localisation,
    likelihood_field,
)
from benchmarks.localisation.course import ROBOT, Course

Preset = Literal["chapter", "robust", "odometry"]
"""A preset of the filter, or the odometry alone."""
RECOVERY = (0.001, 0.1)
"""Decays of the slow and the fast average where recovery is on, and the preset neither has them nor searches;
wiki.ros.org/amcl advises them."""


@dataclass(frozen=True)
class Arm:
    """One localisation."""

    preset: Preset
    masked: bool = False
    """It is told where the others are."""
    placed: bool = True
    """It is told where the robot starts, else it may be anywhere on the map."""
    recovery: bool | None = None
    """Whether the robot is looked for elsewhere once scans fit badly; None: as the preset has it."""

    @property
    def parameters(self) -> AmclParameters:
        """The filter's. Raises KeyError for the odometry, which has none."""
        parameters = PRESETS[self.preset]
        if self.recovery is None:
            return parameters
        if not self.recovery:
            return dataclasses.replace(parameters, recovery_slow=0.0, recovery_fast=0.0, search_poses=0)
        if parameters.search_poses or parameters.recovers:
            return parameters
        slow, fast = RECOVERY
        return dataclasses.replace(parameters, recovery_slow=slow, recovery_fast=fast)

    def localisation(self, course: Course, seed: int) -> Localisation:
        """A new one for that course; its own chance depends on the seed."""
        if self.preset == "odometry":
            return DeadReckoning(course.origin)
        draws = generator(seed, "localisation/filter", ROBOT)
        field = _field(course.grid, self.parameters.max_distance)
        start = course.start if self.placed else None
        first = Pose(*course.odometry[0].tolist())
        return Amcl(field, course.sensor, start, draws, self.parameters, origin=first)


@lru_cache(maxsize=8)
def _field(grid: OccupancyGrid, max_distance: float) -> LikelihoodField:
    return likelihood_field(grid, max_distance)
