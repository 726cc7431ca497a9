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
def start_of(pose: Floats) -> tuple[float, float]:
    """Return cosine and sine of the initial heading of trajectories; `pose` as for `cheapest_velocity`."""
    return cos_sin(float(np.float32(pose[2])))


@kernel
def arc_of(turn: float, count: int, w: Any) -> tuple[float, float, float, float]:
    """Return the end of `count` points at a turn rate: x, y for steps of 1, cosine and sine of its angle."""
    step, steps = w.horizon / count, count - 1
    end_c, end_s = cos_sin(steps * turn * step)
    half_c, half_s = cos_sin(0.5 * turn * step)
    right, up = float(steps), 0.0
    if half_s != 0.0:
        # the sum of exp(ikφ), k below n: (exp(inφ) - 1) / (exp(iφ) - 1);
        # exp(iφ) - 1 = 2i sin(φ/2) exp(iφ/2)
        right = 0.5 * (end_s * half_c - (end_c - 1.0) * half_s) / half_s
        up = 0.5 * ((1.0 - end_c) * half_c - end_s * half_s) / half_s
    return right, up, end_c, end_s


@kernel
def predict_end(
    begin: tuple[float, float, float, float],
    ahead: float,
    arc: tuple[float, float, float, float],
    nose: float,
    side: int,
) -> tuple[bool, float, float, float, float]:
    """Return whether the cells of a trajectory's end are certain, and x and y of its end and of its nose.

    Not certain near the border of a cell, and if centre or nose are outside the window. `begin`: x, y, cosine
    and sine. `ahead`: length of a step, cells. `arc`: of `arc_of`. `side`: of the window, cells.
    """
    x, y, c, s = begin
    right, up, end_c, end_s = arc
    x += ahead * (c * right - s * up)
    y += ahead * (s * right + c * up)
    nose_x, nose_y = x + nose * (c * end_c - s * end_s), y + nose * (s * end_c + c * end_s)
    # all of them, since branches would cost more
    clear = _is_clear(x) & _is_clear(y) & _is_clear(nose_x) & _is_clear(nose_y)
    return clear & _is_inside(x, y, nose_x, nose_y, side), x, y, nose_x, nose_y


@kernel
def _is_clear(place: float) -> bool:
    """Return True away from the borders of cells."""
    return abs(place - math.floor(place + 0.5)) > _ROUNDING


@kernel
def _is_inside(x: float, y: float, nose_x: float, nose_y: float, side: int) -> bool:
    """Return True if centre and nose are in the window."""
    return (min(x, y, nose_x, nose_y) >= 0.0) & (max(x, y, nose_x, nose_y) < side)


@kernel
def _is_reachable(row: int, column: int, path: Int32s, goal: Int32s) -> bool:
    """Return True if path and goal are reachable from a cell."""
    return bool(max(path[row, column], goal[row, column]) < path.size)


@kernel
def simulate(
    points: Floats, pose: Floats, start: tuple[float, float], speed: float, turn: float, waves: Waves, w: Any
) -> int:
    """Write a trajectory's points, each x, y, cosine and sine; return their number.

    0 if a point or its nose is outside the window, or if a point is unreachable from path or goal; then the
    points are meaningless (MapGridCostFunction::scoreTrajectory).
    """
    path, goal, side = waves.path, waves.goal, waves.path.shape[0]
    count = count_of(speed, turn, w)
    step = w.horizon / count
    turned_c, turned_s = cos_sin(turn * step)
    x, y, heading = np.float32(pose[0]), np.float32(pose[1]), np.float32(pose[2])
    exact, c, s = float(heading), start[0], start[1]
    for k in range(count):
        # correct the heading's rounding error, 1e-6 rad, to first order
        off = float(heading) - exact
        rounded_c, rounded_s = c - s * off, s + c * off
        column, row = (float(x) - pose[3]) / w.cell, (float(y) - pose[4]) / w.cell
        points[k, 0], points[k, 1], points[k, 2], points[k, 3] = column, row, rounded_c, rounded_s
        if not _is_inside(column, row, column + w.nose * rounded_c, row + w.nose * rounded_s, side):
            return 0
        if not _is_reachable(int(row), int(column), path, goal):
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
_BEYOND: Final = 2.0
"""Distance of a mark from the outline's corners, cells, beyond which they cannot meet: half a diagonal to the
centre of the robot's cell, the same for a corner's cell, and half a cell of deviation of a line of cells."""

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
def _cost(
    obstacle: float,
    x: float,
    y: float,
    nose_x: float,
    nose_y: float,
    path: Int32s,
    goal: Int32s,
    front: Int32s,
    w: Any,
) -> float:
    """Return the sum of the critics' costs at a trajectory's end, in the original's order.

    The fields of `Waves` one by one, since numba counts references to arrays that it takes from a tuple.
    """
    row, column, ahead, beside = int(y), int(x), int(nose_y), int(nose_x)
    cost = w.obstacle * obstacle
    cost += w.front * front[ahead, beside]
    if w.alignment != 0.0:
        cost += w.alignment * path[ahead, beside]
    cost += w.path * path[row, column]
    cost += w.goal * goal[row, column]
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
    far = _BEYOND
    for corner in range(outline.shape[0]):
        x, y = outline[corner, 0], outline[corner, 1]
        far = max(far, _BEYOND + math.sqrt(x * x + y * y))
    most = count_of(max(abs(speeds[0]), abs(speeds[-1])), max(abs(turns[0]), abs(turns[-1])), w)
    points = np.empty((most + 1, 4))
    bounds = _lower_bounds(pose, speeds, turns, barred, squared, waves, table, w)
    path, goal, front = waves
    first, lowest = -1, INVALID
    for trial in range(-_FIRST_TRIALS, bounds.size):
        # the first ones are those with the lowest bounds, whose costs rule out most of the others
        k = trial if trial >= 0 else int(bounds.argmin())
        bound = bounds[k]
        if bound == math.inf or (first >= 0 and (bound > lowest or (bound == lowest and k > first))):
            continue
        bounds[k] = math.inf
        speed, turn = float(speeds[k // turns.size]), float(turns[k % turns.size])
        count = simulate(points, pose, start, speed, turn, waves, w)
        if count == 0:
            continue
        x, y, c, s = points[count - 1, 0], points[count - 1, 1], points[count - 1, 2], points[count - 1, 3]
        below = cost_below(squared, table, x, y, c, s, outline)
        highest = max(below, table[squared[int(y), int(x)]])
        cost = _cost(highest, x, y, x + w.nose * c, y + w.nose * s, path, goal, front, w)
        cheaper = first < 0 or cost < lowest or (cost == lowest and k < first)
        if below >= 0 and cheaper and not _collides(points, count - 1, far, squared, table, outline):
            first, lowest = k, cost
    if first < 0:
        return 0.0, 0.0, INVALID
    return float(speeds[first // turns.size]), float(turns[first % turns.size]), lowest


_FIRST_TRIALS: Final = 3
"""Number of trajectories with the lowest bounds that are tried first."""


@kernel
def _lower_bounds(
    pose: Floats,
    speeds: Singles,
    turns: Singles,
    barred: Flags,
    squared: Int16s,
    waves: Waves,
    table: Octets,
    w: Any,
) -> Floats:
    """Return lower bounds of the costs of all trajectories, speeds in the outer loop; inf if invalid.

    The bound has the cost of the end's centre instead of that below the body; -inf if the end is uncertain.
    """
    begin = (pose[0] - pose[3]) / w.cell, (pose[1] - pose[4]) / w.cell, *start_of(pose)
    path, goal, front = waves
    bounds = np.full((speeds.size, turns.size), math.inf)
    for i in range(speeds.size):
        for j in range(turns.size):
            speed, turn = float(speeds[i]), float(turns[j])
            if _is_barred(speed, turn, barred, w):
                continue
            count = count_of(speed, turn, w)
            arc, ahead = arc_of(turn, count, w), speed * (w.horizon / count) / w.cell
            certain, x, y, nose_x, nose_y = predict_end(begin, ahead, arc, w.nose, path.shape[0])
            if not certain:
                bounds[i, j] = -math.inf
            elif _is_reachable(int(y), int(x), path, goal):
                centre = table[squared[int(y), int(x)]]
                bounds[i, j] = _cost(centre, x, y, nose_x, nose_y, path, goal, front, w)
    return bounds.ravel()
