"""Motion model of a differential drive.

`sample_motion_model_odometry` of Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 5.6, in the
two forms of ros-planning/navigation, amcl_odom.cpp: "diff-corrected" is the book's, "diff" uses the variances
as standard deviations (its issue 20).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats
from actors.geometry import Pose, wrap
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import atan2, cos, hypot, sin
from actors.robot.localisation.parameters import AmclParameters

_TURN_ON_THE_SPOT: Final = 0.01
"""Distance below which the direction of a step is meaningless, m (amcl_odom.cpp)."""


class OdometryStep(NamedTuple):
    """A step of the odometry: initial turn, translation, final turn."""

    turn: float
    """Initial turn, rad."""
    distance: float
    """Translation, m, ≥ 0; backing is a translation between two turns by π."""
    last_turn: float
    """Final turn, rad."""


_SEVERAL: Final = 5
"""Length of a step above which it is divided, in update distances; own choice."""
_MOST_STEPS: Final = 1000
"""Maximum number of parts of a step: 200 m in steps of 0.2 m."""


class StepSpread(NamedTuple):
    """Standard deviations of a step's parts: rad, m, rad."""

    turn: float
    distance: float
    last_turn: float


def odometry_step(before: Pose, after: Pose) -> OdometryStep:
    """Return the step between two odometry poses."""
    moved = before.relative(after)
    distance = hypot(moved.x, moved.y)
    turn = atan2(moved.y, moved.x) if distance >= _TURN_ON_THE_SPOT else 0.0
    return OdometryStep(turn, distance, wrap(moved.heading - turn))


def step_spread(made: OdometryStep, parameters: AmclParameters) -> StepSpread:
    """Return the standard deviations of a step. Backing is as certain as driving forward."""
    turn, last_turn = _sharpness(made.turn), _sharpness(made.last_turn)
    distance = made.distance * made.distance
    variances = (
        parameters.alpha1 * turn * turn + parameters.alpha2 * distance,
        parameters.alpha3 * distance + parameters.alpha4 * (turn * turn + last_turn * last_turn),
        parameters.alpha1 * last_turn * last_turn + parameters.alpha2 * distance,
    )
    if parameters.odometry_model == "diff":
        return StepSpread(*variances)
    return StepSpread(*map(math.sqrt, variances))


def sample_around(pose: Pose, spread: tuple[float, float, float], normals: Floats) -> Floats:
    """Return poses around one, (3, n), from standard deviations, m, m, rad, and normal draws (3, n)."""
    return np.array([pose]).T + np.array([spread]).T * normals


def step_count(before: Pose, after: Pose, parameters: AmclParameters) -> int:
    """Return the number of steps into which to divide the straight line between two odometry poses, ≥ 1.

    1 up to _SEVERAL update distances, otherwise the length in update distances.
    """
    moved = before.relative(after)
    parts = hypot(moved.x, moved.y) / max(parameters.update_distance, _TURN_ON_THE_SPOT)
    return math.ceil(min(parts, _MOST_STEPS)) if parts > _SEVERAL else 1


def _sharpness(turn: float) -> float:
    return min(abs(turn), abs(wrap(turn - math.pi)))


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    poses = np.linspace(-3.0, 3.0, 60, dtype=np.float64).reshape(3, 20)
    normals = arrays.cos(np.arange(60.0)).reshape(3, 20)
    move(poses, 19, OdometryStep(0.3, 0.25, -0.1), StepSpread(0.1, 0.05, 0.1), normals)
    return poses.tobytes()


@kernel
def move(poses: Floats, count: int, made: OdometryStep, spread: StepSpread, normals: Floats) -> None:
    """Move the first `count` of `poses`, (3, capacity), each by a random sample of a step.

    `normals`: (3, ≥ count), standard normal. Resulting headings are in [−π, π].
    """
    for i in range(count):
        bearing = poses[2, i] + made.turn + spread.turn * normals[0, i]
        gone = made.distance + spread.distance * normals[1, i]
        poses[0, i] += gone * cos(bearing)
        poses[1, i] += gone * sin(bearing)
        heading = bearing + made.last_turn + spread.last_turn * normals[2, i]
        poses[2, i] = heading - 2 * math.pi * np.rint(heading / (2 * math.pi))
