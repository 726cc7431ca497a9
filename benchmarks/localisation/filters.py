"""The localisations that are compared, by what is varied of them."""

import dataclasses
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from actors.grid import OccupancyGrid
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
"""Decays of the slow and the fast average where recovery is on, and the preset has none of its own;
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
    """Whether new poses are tried once scans fit badly; None: as the preset has it."""

    @property
    def parameters(self) -> AmclParameters:
        """The filter's. Raises KeyError for the odometry, which has none."""
        parameters = PRESETS[self.preset]
        if self.recovery is None:
            return parameters
        own = parameters.recovery_slow, parameters.recovery_fast
        slow, fast = (own if all(own) else RECOVERY) if self.recovery else (0.0, 0.0)
        return dataclasses.replace(parameters, recovery_slow=slow, recovery_fast=fast)

    def localisation(self, course: Course, seed: int) -> Localisation:
        """A new one for that course; its own chance depends on the seed."""
        if self.preset == "odometry":
            return DeadReckoning(course.origin)
        draws = generator(seed, "localisation/filter", ROBOT)
        field = _field(course.grid, self.parameters.max_distance)
        start = course.origin if self.placed else None
        return Amcl(field, course.sensor, start, draws, self.parameters)


@lru_cache(maxsize=8)
def _field(grid: OccupancyGrid, max_distance: float) -> LikelihoodField:
    return likelihood_field(grid, max_distance)
