"""The localisations that are compared, by what is varied of them."""

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Scan
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
from actors.robot.sweep import Sweeps
from benchmarks.localisation.course import ROBOT, Course
from benchmarks.localisation.metrics import EstimatedTrack

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


def replay(
    course: Course, localisation: Localisation, known: Sequence[tuple[Point, ...] | None] = ()
) -> EstimatedTrack:
    """Feed the whole course, a call per odometry pose; each with the newest scan made since the one before.

    `known`: per pose, the peers' positions to mask from then on, or None where they stay as they were.
    """
    sweeps = Sweeps(course.sensor)
    # the scan to go with each pose: the last one made by then
    newest = np.searchsorted(course.stamps, course.instants, side="right") - 1
    poses = course.odometry.tolist()
    track = np.empty((len(poses), 13))
    costs = np.empty(len(poses))
    taken = -1
    for step, here in enumerate(poses):
        if known and known[step] is not None:
            localisation.mask(known[step] or ())
        scan = None
        if newest[step] > taken:
            taken = int(newest[step])
            scan = Scan(int(course.stamps[taken]), course.scans[taken].astype("<u2").tobytes())
        sweep = sweeps.take(Instant(int(course.instants[step])), Pose(*here), scan)
        begun = time.process_time_ns()
        estimate = localisation.update(Pose(*here), sweep)
        costs[step] = (time.process_time_ns() - begun) / 1e9
        track[step] = *estimate.pose, *estimate.covariance, estimate.lost
    covariances = track[:, 3:12].reshape(-1, 3, 3)
    return EstimatedTrack(track[:, :3], covariances, track[:, 12], costs, localisation.outcome())
