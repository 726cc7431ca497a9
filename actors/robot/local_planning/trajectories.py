"""Kernels: the points of a trajectory, as SimpleTrajectoryGenerator of ROS Indigo puts them.

ros-planning/navigation, branch indigo-devel, base_local_planner/src/simple_trajectory_generator.cpp: small
straight steps, positions and headings of 32 bits, in m in the odometry frame. Which cell a point is in now
and then depends on that rounding, and the choice among trajectories on the cell. Points here are in cells of
the window, from its south-west corner.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import cos_sin

Floats = NDArray[np.float64]
Steps = NDArray[np.int32]

_ROUNDING: Final = 1e-3
"""So near to a border of its cell, cells, a point that was not made step by step may be in another one."""


@njit(cache=True)  # type: ignore[untyped-decorator]
def count_of(speed: float, turn: float, w: Any) -> int:
    """How many points a trajectory has; `w`: of `dwa.CRITICS`, here as below."""
    count = math.ceil(max(abs(speed) * w.horizon / w.stride, abs(turn) * w.horizon / w.turn_stride))
    return int(count)


@njit(cache=True)  # type: ignore[untyped-decorator]
def start_of(pose: Floats) -> Floats:
    """Cosine and sine of the heading with which all trajectories begin; `pose` as for `cheapest`."""
    c, s = cos_sin(float(np.float32(pose[2])))
    return np.array([c, s])


@njit(cache=True)  # type: ignore[untyped-decorator]
def foresee(
    point: Floats, pose: Floats, start: Floats, speed: float, turn: float, path: Steps, w: Any
) -> bool:
    """Write where a trajectory will end into `point`: x, y, cosine and sine; True if that can be relied on.

    Not so near to a border of its cell, and not where centre or nose are off the window.
    """
    count = count_of(speed, turn, w)
    step = w.horizon / count
    ahead, steps = speed * step / w.cell, count - 1
    end_c, end_s = cos_sin(steps * turn * step)
    half_c, half_s = cos_sin(0.5 * turn * step)
    right, up = float(steps), 0.0
    if half_s != 0.0:
        # the sum of exp(ikφ), k below n: (exp(inφ) - 1) / (exp(iφ) - 1);
        # exp(iφ) - 1 = 2i sin(φ/2) exp(iφ/2)
        right = 0.5 * (end_s * half_c - (end_c - 1.0) * half_s) / half_s
        up = 0.5 * ((1.0 - end_c) * half_c - end_s * half_s) / half_s
    c, s = start
    point[0] = (pose[0] - pose[3]) / w.cell + ahead * (c * right - s * up)
    point[1] = (pose[1] - pose[4]) / w.cell + ahead * (s * right + c * up)
    point[2], point[3] = c * end_c - s * end_s, s * end_c + c * end_s
    nose_x, nose_y = point[0] + w.nose * point[2], point[1] + w.nose * point[3]
    clear = _is_clear(point[0]) and _is_clear(point[1]) and _is_clear(nose_x) and _is_clear(nose_y)
    return bool(clear and _is_inside(point, path, w.nose))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_clear(place: float) -> bool:
    """True away from the borders of cells."""
    return abs(place - math.floor(place + 0.5)) > _ROUNDING


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_inside(point: Floats, path: Steps, nose: float) -> bool:
    """True if centre and nose are in the window."""
    x, y = point[0], point[1]
    nose_x, nose_y = x + nose * point[2], y + nose * point[3]
    rows, columns = path.shape
    beside = 0.0 <= x < columns and 0.0 <= nose_x < columns
    return bool(beside and 0.0 <= y < rows and 0.0 <= nose_y < rows)


@njit(cache=True)  # type: ignore[untyped-decorator]
def drive(
    points: Floats, pose: Floats, start: Floats, speed: float, turn: float, path: Steps, goal: Steps, w: Any
) -> int:
    """Write a trajectory's points, each x, y, cosine and sine; how many they are.

    0 if one or its nose is off the window, or if one cannot reach path or goal; then the points mean nothing
    (MapGridCostFunction::scoreTrajectory).
    """
    count = count_of(speed, turn, w)
    step = w.horizon / count
    turned_c, turned_s = cos_sin(turn * step)
    x, y, heading = np.float32(pose[0]), np.float32(pose[1]), np.float32(pose[2])
    exact, c, s = float(heading), start[0], start[1]
    for k in range(count):
        # the heading's rounding, a millionth of a radian, to first order
        off = float(heading) - exact
        rounded_c, rounded_s = c - s * off, s + c * off
        point = points[k]
        point[0], point[1] = (float(x) - pose[3]) / w.cell, (float(y) - pose[4]) / w.cell
        point[2], point[3] = rounded_c, rounded_s
        if not _is_inside(point, path, w.nose):
            return 0
        row, column = int(point[1]), int(point[0])
        if path[row, column] >= path.size or goal[row, column] >= goal.size:
            return 0
        x = np.float32(float(x) + speed * rounded_c * step)
        y = np.float32(float(y) + speed * rounded_s * step)
        heading = np.float32(float(heading) + turn * step)
        exact += turn * step
        c, s = c * turned_c - s * turned_s, s * turned_c + c * turned_s
    return int(count)
