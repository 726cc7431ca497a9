"""What one update costs with exactly 500 particles and 60 beams, one process alone."""

import time
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from actors.geometry import Pose
from actors.randomness import generator
from actors.robot.localisation import PRESETS, Amcl, likelihood_field
from actors.robot.sweep import Sweep
from benchmarks.localisation.cells import PRESETS as NAMES
from benchmarks.localisation.course import ROBOT, Course, CourseSetup, made

PARTICLES: Final = 500
BEAMS: Final = 60
GOAL_US: Final = 150.0


@dataclass(frozen=True)
class UpdateCost:
    """One preset, but with PARTICLES and BEAMS."""

    preset: str
    updates: int
    """In one pass over a course, all of which move, weigh and resample."""
    min_us: float
    """CPU time per update in the fastest pass, µs."""
    mean_us: float
    """The same over all passes."""
    goal_met: bool
    """True with at most GOAL_US in the fastest."""


def update_costs(corridor: str, repeats: int = 15, seconds: float = 60.0) -> list[UpdateCost]:
    """The cost with each preset, on a course with nobody near, 360°, Kobuki's odometry."""
    course = made(CourseSetup(corridor, 1, base="kobuki", seconds=seconds))
    return [_cost(preset, course, repeats) for preset in NAMES]


def _cost(preset: str, course: Course, repeats: int) -> UpdateCost:
    parameters = replace(
        PRESETS[preset], min_particles=PARTICLES, max_particles=PARTICLES, beams=BEAMS,
        update_angle=1e-6, resample_interval=1,  # every scan counts: the heading is never at rest
    )  # fmt: skip
    field = likelihood_field(course.grid, parameters.max_distance)
    every = 6  # as far apart as an update_distance of 0.25 m has them
    steps = [
        (Pose(*pose), Sweep(np.frombuffer(scan.tobytes(), "<u2"), Pose(*pose)))
        for pose, scan in zip(course.odometry[every::every].tolist(), course.scans[every::every], strict=True)
    ]
    passes = []
    for _ in range(repeats + 1):
        draws = generator(1, "localisation/filter", ROBOT)
        filtered = Amcl(field, course.sensor, course.origin, draws, parameters)
        begun = time.process_time()
        for here, sweep in steps:
            filtered.update(here, sweep)
        passes.append((time.process_time() - begun) / len(steps) * 1e6)
    counted = passes[1:]  # the first one compiles
    return UpdateCost(preset, len(steps), min(counted), float(np.mean(counted)), min(counted) <= GOAL_US)
