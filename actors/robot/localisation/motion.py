"""The motion model of a differential drive: what a step of the odometry may have been in truth.

`sample_motion_model_odometry` of Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 5.6, in the
two forms that ros-planning/navigation, amcl_odom.cpp, has: "diff-corrected" is the book's, "diff" hands the
variances on as standard deviations (its issue 20).
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
"""With less of a way than this, m, its direction says nothing (amcl_odom.cpp)."""


class OdometryStep(NamedTuple):
    """A step of the odometry: a turn towards where it leads, the way there, and the turn left to do."""

    turn: float
    """rad."""
    way: float
    """m, ≥ 0: a robot that backs has turned by π before and turns by π after."""
    last_turn: float
    """rad."""


_SEVERAL: Final = 5
"""Scans that count come after each step of the usual length, or the next; own choice."""
_MOST_STEPS: Final = 1000
"""Of so many steps a way is at most taken to consist: 200 m in steps of 0.2 m."""


class StepSpread(NamedTuple):
    """Standard deviations of a step's parts: rad, m, rad."""

    turn: float
    way: float
    last_turn: float


def step(before: Pose, after: Pose) -> OdometryStep:
    """The step that leads from one pose of the odometry to the other."""
    moved = before.relative(after)
    way = hypot(moved.x, moved.y)
    turn = atan2(moved.y, moved.x) if way >= _TURN_ON_THE_SPOT else 0.0
    return OdometryStep(turn, way, wrap(moved.heading - turn))


def spread(made: OdometryStep, parameters: AmclParameters) -> StepSpread:
    """How uncertain the parts of a step are. Backing is no less certain than driving ahead."""
    turn, last_turn = _sharpness(made.turn), _sharpness(made.last_turn)
    way = made.way * made.way
    variances = (
        parameters.alpha1 * turn * turn + parameters.alpha2 * way,
        parameters.alpha3 * way + parameters.alpha4 * (turn * turn + last_turn * last_turn),
        parameters.alpha1 * last_turn * last_turn + parameters.alpha2 * way,
    )
    if parameters.odometry_model == "diff":
        return StepSpread(*variances)
    return StepSpread(*map(math.sqrt, variances))


def around(pose: Pose, spread: tuple[float, float, float], normals: Floats) -> Floats:
    """Poses about one, (3, n), by standard deviations, m, m, rad, and standard normal draws (3, n)."""
    return np.array([pose]).T + np.array([spread]).T * normals


def parts_of(before: Pose, after: Pose, parameters: AmclParameters) -> int:
    """In how many steps the straight way from one pose of the odometry to the other is best taken; ≥ 1.

    One, unless it is as long as several after which scans count: then so many.
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
    """Move the first `count` of `poses`, (3, capacity), each by its own sample of a step.

    `normals`: (3, ≥ count), standard normal. Headings end up in [−π, π].
    """
    for i in range(count):
        bearing = poses[2, i] + made.turn + spread.turn * normals[0, i]
        gone = made.way + spread.way * normals[1, i]
        poses[0, i] += gone * cos(bearing)
        poses[1, i] += gone * sin(bearing)
        heading = bearing + made.last_turn + spread.last_turn * normals[2, i]
        poses[2, i] = heading - 2 * math.pi * np.rint(heading / (2 * math.pi))
