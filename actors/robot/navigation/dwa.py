"""Kernel of the dynamic window approach of ROS Indigo: the cheapest velocity of the dynamic window.

Fox, Burgard, Thrun, "The dynamic window approach to collision avoidance", IEEE Robotics & Automation Magazine
4(1), 1997, as implemented by ros-planning/navigation, branch indigo-devel: dwa_planner.cpp of
dwa_local_planner, and {simple_trajectory_generator,map_grid_cost_function,obstacle_cost_function,
costmap_model}.cpp of base_local_planner. Lengths are in cells of the window, positions relative to its
south-west corner; speeds, m/s, and turn rates have 32 bits as in the original, since the number of a
trajectory's steps depends on them.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from actors.array_types import Flags, Floats, Int16s, Int32s, Octets, Records, Singles
from actors.kernels import kernel
from actors.portable.compiled import cos_sin
from actors.robot.navigation.map_grid import Waves
from actors.robot.navigation.ray_tracing import cost_below

_ROUNDING: Final = 1e-3
"""Distance from its cell's border, cells, within which a point computed in closed form may be in another
cell."""


@kernel
def count_of(speed: float, turn: float, w: Any) -> int:
    """Return the number of points of a trajectory; `w`: of `dwa.CRITICS`, also below."""
    count = math.ceil(max(abs(speed) * w.horizon / w.stride, abs(turn) * w.horizon / w.turn_stride))
    return int(count)


@kernel
def start_of(pose: Floats) -> Floats:
    """Return cosine and sine of the initial heading of trajectories; `pose` as for `cheapest_velocity`."""
    c, s = cos_sin(float(np.float32(pose[2])))
    return np.array([c, s])


@kernel
def predict_end(
    point: Floats, pose: Floats, start: Floats, speed: float, turn: float, path: Int32s, w: Any
) -> bool:
    """Write a trajectory's end into `point`: x, y, cosine and sine; return True if its cell is certain.

    False near the border of a cell, and if centre or nose are outside the window.
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


@kernel
def _is_clear(place: float) -> bool:
    """Return True away from the borders of cells."""
    return abs(place - math.floor(place + 0.5)) > _ROUNDING


@kernel
def _is_inside(point: Floats, path: Int32s, nose: float) -> bool:
    """Return True if centre and nose are in the window."""
    x, y = point[0], point[1]
    nose_x, nose_y = x + nose * point[2], y + nose * point[3]
    rows, columns = path.shape
    beside = 0.0 <= x < columns and 0.0 <= nose_x < columns
    return bool(beside and 0.0 <= y < rows and 0.0 <= nose_y < rows)


@kernel
def simulate(
    points: Floats, pose: Floats, start: Floats, speed: float, turn: float, waves: Waves, w: Any
) -> int:
    """Write a trajectory's points, each x, y, cosine and sine; return their number.

    0 if a point or its nose is outside the window, or if a point is unreachable from path or goal; then the
    points are meaningless (MapGridCostFunction::scoreTrajectory).
    """
    path, goal = waves.path, waves.goal
    count = count_of(speed, turn, w)
    step = w.horizon / count
    turned_c, turned_s = cos_sin(turn * step)
    x, y, heading = np.float32(pose[0]), np.float32(pose[1]), np.float32(pose[2])
    exact, c, s = float(heading), start[0], start[1]
    for k in range(count):
        # correct the heading's rounding error, 1e-6 rad, to first order
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


INVALID: Final = -1.0
"""Cost of an invalid trajectory."""
_NEARLY: Final = 1e-4
"""Tolerance of the least speed (SimpleTrajectoryGenerator::generateTrajectory)."""
_BEYOND: Final = 2.7
"""Distance of a mark from the outline's corners, cells, beyond which they cannot meet: half a diagonal to the
centre of the robot's cell, the same for a corner's cell, and the deviation of a line of cells."""

_PARAMETERS: Final = (
    "obstacle", "front", "alignment", "path", "goal", "nose", "cell", "horizon", "stride", "turn_stride",
    "least_speed", "least_turn", "most_speed",
)  # fmt: skip
CRITICS: Final = np.dtype([(name, np.float64) for name in _PARAMETERS], align=True)
"""Scales of the critics, and parameters of a trajectory.

`nose`: distance of the nose from the centre, cells. `cell`: m. `horizon`: duration, s. `stride`, m,
`turn_stride`, rad: maximum spacing of points. `least_speed`, m/s, or `least_turn`, rad/s, is reached;
`most_speed`, m/s, is the highest speed.
"""


class CheapestVelocity(NamedTuple):
    """Velocity of the cheapest trajectory."""

    speed: float
    """Speed, m/s."""
    turn: float
    """Turn rate, rad/s."""
    cost: float
    """INVALID if there is no valid trajectory; then speed and turn are 0."""


def example() -> tuple[Int16s, Octets, Floats, Records]:
    """Return inputs for fingerprints: squared distances of a window, costs by them, outline, and critics."""
    row, column = np.indices((40, 40))
    squared = np.minimum(np.square(row - 3) + np.square(column - 30), 100).astype(np.int16)
    table = np.maximum(100 - np.arange(101), 0).astype(np.uint8)
    table[0], table[1:5] = 254, 253
    table.setflags(write=False)  # like that of the cost map, for which the kernel is compiled
    numbers = (0.05, 1.2, 3.2, 3.2, 1.2, 3.3, 0.1, 3.0, 0.05, 0.1, 0.1, 0.4, 0.5)
    corners = np.array([(2.0, 0.0), (0.0, 2.0), (-2.0, 0.0), (0.0, -2.0)])
    return squared, table, corners, np.array([numbers], CRITICS)


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    row, column = np.indices((40, 40))
    squared, table, corners, critics = example()
    steps = (np.abs(row - 30) + np.abs(column - 33)).astype(np.int32)
    around = squared, Waves(np.abs(row - 25).astype(np.int32), steps, steps)
    speeds, turns, barred = samples(-0.1, 0.5, 7), samples(-1.0, 1.0, 8), np.zeros(4, np.bool_)
    poses = [np.array([1.115, 2.52, heading, 0.5, 1.5]) for heading in (-3.0, 0.1, 1.4)]
    chosen = [
        cheapest_velocity(pose, speeds, turns, barred, *around, table, corners, critics) for pose in poses
    ]
    return b"".join(part.tobytes() for part in (np.array(chosen), speeds, turns))


@kernel
def samples(low: float, high: float, count: int) -> Singles:
    """Return `count` equidistant values from `low` to `high`, of 32 bits, plus 0 if it is between two.

    One value if both are equal (velocity_iterator.h of base_local_planner).
    """
    values = np.empty(count + 1, np.float32)
    if low == high:
        values[0] = low
        return values[:1]
    size, step, current = 0, (high - low) / (count - 1), low
    for _ in range(count - 1):
        following = current + step
        values[size] = current
        size += 1
        if current < 0.0 < following:
            values[size] = 0.0
            size += 1
        current = following
    values[size] = high
    return values[: size + 1]


@kernel
def _is_barred(speed: float, turn: float, barred: Flags, w: Any) -> bool:
    """Return True for no motion, one that is too slow or too fast, or one that would be an oscillation."""
    if speed == 0.0 and turn == 0.0:
        return True
    if abs(speed) + _NEARLY < w.least_speed and abs(turn) + _NEARLY < w.least_turn:
        return True
    along = (speed > 0.0 and barred[0]) or (speed < 0.0 and barred[1])
    across = (turn > 0.0 and barred[2]) or (turn < 0.0 and barred[3])
    return bool(along or across or abs(speed) - _NEARLY > w.most_speed)


@kernel
def _collides(
    points: Floats, count: int, far: float, squared: Int16s, table: Octets, outline: Floats
) -> bool:
    """Return True if the body's outline meets a mark at one of the first `count` points."""
    for k in range(count):
        x, y = points[k, 0], points[k, 1]
        inside = far <= min(x, y) and max(x, y) < squared.shape[0] - far
        if inside and squared[int(y), int(x)] > far * far:
            continue
        if cost_below(squared, table, x, y, points[k, 2], points[k, 3], outline) < 0:
            return True
    return False


@kernel
def _cost(obstacle: float, point: Floats, waves: Waves, w: Any) -> float:
    """Return the sum of the critics' costs at a trajectory's last point, in the original's order."""
    x, y = point[0], point[1]
    row, column = int(y), int(x)
    ahead, beside = int(y + w.nose * point[3]), int(x + w.nose * point[2])
    cost = w.obstacle * obstacle
    cost += w.front * waves.front[ahead, beside]
    if w.alignment != 0.0:
        cost += w.alignment * waves.path[ahead, beside]
    cost += w.path * waves.path[row, column]
    cost += w.goal * waves.goal[row, column]
    return float(cost)


@kernel
def cheapest_velocity(
    pose: Floats,
    speeds: Singles,
    turns: Singles,
    barred: Flags,
    squared: Int16s,
    waves: Waves,
    table: Octets,
    outline: Floats,
    critics: Records,
) -> tuple[float, float, float]:
    """Return the fields of `CheapestVelocity`: the valid trajectory of the lowest cost, the first of equals.

    `pose`: x and y, m, and heading, rad, of the body; x and y, m, of the window's corner. `speeds`, `turns`:
    samples, m/s and rad/s; all pairs are tried, speeds in the outer loop. `barred`: (4,), True if forward,
    backward, left turn, right turn is barred. `squared`: (rows, columns), squared distance to the nearest
    mark, cells². `table`: cost by squared distance. `outline`: (n, 2), corners of the body in its frame,
    cells. `critics`: (1,) of CRITICS.
    """
    w = critics[0]
    start = start_of(pose)
    far = 0.0
    for corner in range(outline.shape[0]):
        far = max(
            far, math.sqrt(outline[corner, 0] * outline[corner, 0] + outline[corner, 1] * outline[corner, 1])
        )
    far += _BEYOND
    most = count_of(max(abs(speeds[0]), abs(speeds[-1])), max(abs(turns[0]), abs(turns[-1])), w)
    points = np.empty((most + 1, 4))
    best_speed, best_turn, lowest = 0.0, 0.0, INVALID
    for speed_sample in speeds:
        for turn_sample in turns:
            speed, turn = float(speed_sample), float(turn_sample)
            if _is_barred(speed, turn, barred, w):
                continue
            # the centre's cost is a lower bound: skip most trajectories without simulating them
            if lowest >= 0.0 and predict_end(points[0], pose, start, speed, turn, waves.path, w):
                centre = table[squared[int(points[0, 1]), int(points[0, 0])]]
                if _cost(centre, points[0], waves, w) >= lowest:
                    continue
            count = simulate(points, pose, start, speed, turn, waves, w)
            if count == 0:
                continue
            last = points[count - 1]
            if _collides(points, count, far, squared, table, outline):
                continue
            below = cost_below(squared, table, last[0], last[1], last[2], last[3], outline)
            cost = _cost(max(below, table[squared[int(last[1]), int(last[0])]]), last, waves, w)
            if lowest < 0.0 or cost < lowest:
                best_speed, best_turn, lowest = speed, turn, cost
    return best_speed, best_turn, lowest
