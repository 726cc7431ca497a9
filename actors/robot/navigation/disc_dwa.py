"""Kernel of our own dynamic window approach, for a disc.

Critics as in `dwa`, but trajectories are arcs, distances to marks are exact, and the footprint grows with
speed. Lengths are in cells of the window; positions are relative to its south-west corner.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from actors.array_types import Flags, Floats, Int16s, Octets, Records
from actors.kernels import kernel
from actors.portable.compiled import cos, cos_sin, sin
from actors.robot.navigation.map_grid import Waves, steps_at

INVALID: Final = -1.0
"""Score of an invalid trajectory."""
_NEARLY: Final = 1e-4
"""Tolerance of the least speed."""
_DIAGONAL: Final = math.sqrt(2.0)
"""Steps to one of four neighbours per cell along a diagonal."""
_FLANK_COSINE: Final = cos(math.radians(50))
_FLANK_SINE: Final = sin(math.radians(50))
"""Driving backward requires known floor below the stern and at 50° to both sides of it."""

_PARAMETERS: Final = (
    "path", "alignment", "goal", "front", "nose", "horizon", "stride", "turn_stride", "deceleration",
    "stop_buffer", "radius", "padding", "scaling_speed", "scaling_range", "scaling_factor", "least_speed",
    "least_turn", "goal_distance", "escape",
)  # fmt: skip
WEIGHTS: Final = np.dtype([(name, np.float64) for name in _PARAMETERS], align=True)
"""Weights of the critics per step, and parameters of a trajectory; lengths in cells.

`nose`: distance of the nose from the centre. `horizon`: duration, s; longer if stopping takes longer:
`stop_buffer`, s, and braking with `deceleration`. The trajectory ends after `goal_distance`, or after the
stopping distance if that is longer. It is checked every `stride`, or `turn_stride`, rad: the centre keeps
`radius` plus `padding` from marks; the radius grows by `scaling_factor` from `scaling_speed` over
`scaling_range`. `least_speed`, `least_turn`: at least one is reached. A centre that is too near by at most
`escape` may move unless the distance falls. A nose in an occupied cell counts as farther by its largest
possible distance from the centre in steps.
"""


class CriticFields(NamedTuple):
    """Inputs of the critics for the window's cells."""

    squared: Int16s
    """(rows, columns): squared distance to the nearest mark, cells²."""
    waves: Waves
    trusted: Octets
    """(rows, columns): 1 in cells over which the robot may drive backward."""


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    row, column = np.indices((40, 40))
    squared = np.minimum(np.square(row - 3) + np.square(column - 30), 100).astype(np.int16)
    steps = (np.abs(row - 30) + np.abs(column - 33)).astype(np.int32)
    waves = Waves(np.abs(row - 25).astype(np.int32), steps, steps)
    fields = CriticFields(squared, waves, np.ones((40, 40), np.uint8))
    numbers = [
        1.6, 1.6, 0.6, 0.6, 6.5, 3.0, 0.5, 0.1, 20.0, 0.2,
        3.5, 1.0, 5.0, 5.0, 0.2, 2.0, 0.4, 9.0, 0.5,
    ]  # fmt: skip
    weights = np.array([tuple(numbers)], WEIGHTS)
    table = np.linspace(6.0, 0.0, 101, dtype=np.float64)
    table.setflags(write=False)
    window, counts, barred = np.array([-2.0, 10.0, -1.0, 1.0]), (7, 8), np.zeros(4, np.bool_)
    bounds = np.array([[0.6, 0.8, 1.5]])
    poses = [np.array([12.3, 20.4, heading]) for heading in (-3.0, 0.1, 1.4)]
    chosen = [best_velocity(pose, window, counts, barred, bounds, fields, table, weights) for pose in poses]
    return (
        np.array(chosen).tobytes()
        + np.array([squared_at(squared, pose[0], pose[1]) for pose in poses]).tobytes()
    )


@kernel
def _is_known(trusted: Octets, x: float, y: float) -> bool:
    """Return True if a point's cell is trusted."""
    row, column = math.floor(y), math.floor(x)
    inside = 0 <= row < trusted.shape[0] and 0 <= column < trusted.shape[1]
    return inside and trusted[row, column] != 0


@kernel
def _is_rear_known(trusted: Octets, x: float, y: float, c: float, s: float, radius: float) -> bool:
    """Return True if the floor below the stern of a body at (x, y) is trusted; c, s: of its heading."""
    for side in (-1, 0, 1):
        along = _FLANK_COSINE if side else 1.0
        across = side * _FLANK_SINE
        if not _is_known(
            trusted, x - radius * (along * c - across * s), y - radius * (along * s + across * c)
        ):
            return False
    return True


@kernel
def _min_clearance(speed: float, w: Any) -> float:
    """Return the squared distance from marks that is required at a speed, cells²."""
    growth = max(0.0, abs(speed) - w.scaling_speed) / w.scaling_range * w.scaling_factor
    reach = w.radius * (1.0 + growth) + w.padding
    return float(reach * reach)


@kernel
def squared_at(squared: Int16s, x: float, y: float) -> float:
    """Return the squared distance from a point to the centre of the nearest marked cell, cells².

    The point is at least half a cell inside the window. Between four centres the squared distance to one mark
    is their bilinear mean less the last two terms; if the four have different nearest marks, the result is a
    lower bound.
    """
    right, up = x - 0.5, y - 0.5
    column, row = np.uintp(right), np.uintp(up)
    after, over = column + np.uintp(1), row + np.uintp(1)
    right -= column
    up -= row
    below = squared[row, column] + right * (squared[row, after] - squared[row, column])
    above = squared[over, column] + right * (squared[over, after] - squared[over, column])
    return float(below + up * (above - below) - right * (1.0 - right) - up * (1.0 - up))


@kernel
def _least_clearance(
    x: float,
    y: float,
    c: float,
    s: float,
    speed: float,
    turn: float,
    fields: CriticFields,
    fleeing: bool,
    w: Any,
) -> tuple[float, float, float, float, float]:
    """Return the least squared distance along a trajectory, or INVALID; x, y, cosine and sine at its end."""
    squared = fields.squared
    time = max(w.horizon, abs(speed) / w.deceleration + w.stop_buffer)
    count = max(1, math.ceil(max(abs(speed) * time / w.stride, abs(turn) * time / w.turn_stride)))
    if speed == 0.0:
        count = 1  # a disc that turns on the spot does not move
    angle = turn * time / count
    rotate_c, rotate_s = cos(angle), sin(angle)
    half_c, half_s = cos(0.5 * angle), sin(0.5 * angle)
    chord = speed * time / count
    if 0.5 * angle != 0.0:  # half of the smallest float is 0
        chord *= half_s / (0.5 * angle)
    limit = _min_clearance(speed, w)
    if count * abs(chord) > w.goal_distance:
        stopping = abs(speed) * (w.stop_buffer + 0.5 * abs(speed) / w.deceleration)
        count = min(count, math.ceil(max(w.goal_distance, stopping) / abs(chord)))
    least = before = squared_at(squared, x, y)
    if before <= limit and not fleeing:
        return INVALID, x, y, c, s
    for _ in range(count):
        x += chord * (c * half_c - s * half_s)
        y += chord * (s * half_c + c * half_s)
        c, s = c * rotate_c - s * rotate_s, s * rotate_c + c * rotate_s
        if x < 0.5 or y < 0.5 or x >= squared.shape[1] - 0.5 or y >= squared.shape[0] - 0.5:
            return INVALID, x, y, c, s
        if speed < 0.0 and not _is_rear_known(fields.trusted, x, y, c, s, w.radius):
            return INVALID, x, y, c, s
        here = squared_at(squared, x, y)
        if here <= limit and here < before:
            return INVALID, x, y, c, s
        before = here
        least = min(least, here)
    return least, x, y, c, s


@kernel
def _score(
    least: float, x: float, y: float, c: float, s: float, waves: Waves, table: Floats, too_near: bool, w: Any
) -> float:
    """Return the sum of the critics' scores of a trajectory and its end, or INVALID.

    `too_near`: start and end are both too near to marks; then steps are unknown, and trajectories that lead
    out are preferred.
    """
    path = waves.path
    to_path, to_goal = min(steps_at(path, x, y), path.size), min(steps_at(waves.goal, x, y), path.size)
    if max(to_path, to_goal) == path.size and not too_near:
        return INVALID
    row, column = math.floor(y + w.nose * s), math.floor(x + w.nose * c)
    if row < 0 or column < 0 or row >= path.shape[0] or column >= path.shape[1]:
        return INVALID
    nose_to_path, nose_to_front = float(path[row, column]), float(waves.front[row, column])
    if nose_to_path >= path.size:
        nose_to_path = to_path + _DIAGONAL * w.nose
    if nose_to_front >= path.size:
        nose_to_front = to_goal + _DIAGONAL * w.nose
    away = float(path.size) if too_near else 0.0
    return float(
        away
        + table[min(int(least), table.size - 1)]
        + w.path * to_path
        + w.alignment * nose_to_path
        + w.goal * to_goal
        + w.front * nose_to_front
    )


@kernel
def _is_barred(speed: float, turn: float, barred: Flags, w: Any) -> bool:
    """Return True for a motion that is too slow or would be an oscillation."""
    if abs(speed) + _NEARLY < w.least_speed and abs(turn) + _NEARLY < w.least_turn:
        return True
    along = (speed > 0.0 and barred[0]) or (speed < 0.0 and barred[1])
    return along or (turn > 0.0 and barred[2]) or (turn < 0.0 and barred[3])


@kernel
def _can_stop_within(bounds: Floats, speed: float, turn: float, c: float, s: float, w: Any) -> bool:
    """Return True if a body that brakes after `stop_buffer` stays within all bounds."""
    if bounds.shape[0] == 0 or speed == 0.0:
        return True
    length = speed * (w.stop_buffer + 0.5 * abs(speed) / w.deceleration)
    half = 0.5 * turn * length / speed
    half_c, half_s = cos(half), sin(half)
    if half != 0.0:
        length *= half_s / half
    x, y = length * (c * half_c - s * half_s), length * (s * half_c + c * half_s)
    within = True
    for k in range(bounds.shape[0]):
        within = within and x * bounds[k, 0] + y * bounds[k, 1] <= bounds[k, 2]
    return within


@kernel
def _samples(low: float, high: float, count: int) -> Floats:
    """Return `count` equidistant values from `low` to `high`, plus 0 if it is between two of them.

    One value if both are equal. As velocity_iterator.h of base_local_planner.
    """
    if low == high:
        return np.array([low])
    values = np.empty(count + 1)
    size = 0
    for k in range(count):
        value = min(low + (high - low) * k / (count - 1), high)
        if value > 0.0 and size > 0 and values[size - 1] < 0.0:
            values[size] = 0.0
            size += 1
        values[size] = value
        size += 1
    return values[:size]


@kernel
def best_velocity(
    pose: Floats,
    window: Floats,
    counts: tuple[int, int],
    barred: Flags,
    bounds: Floats,
    fields: CriticFields,
    table: Floats,
    weights: Records,
) -> tuple[float, float, float]:
    """Return speed, cells/s, turn rate, rad/s, and score of the valid trajectory with the lowest score.

    The first of equal ones; 0, 0 and INVALID if there is none. `pose`: x and y, cells, heading, rad.
    `window`: lowest and highest speed, cells/s, and turn rate, rad/s. `counts`, each ≥ 2: number of samples
    of both, in ascending order, speeds in the outer loop. `barred`: (4,), True if forward, backward, left
    turn, right turn is barred. `bounds`: (k, 3), unit vector and maximum stopping distance along it, cells.
    `table`: weighted cost by squared distance. `weights`: (1,) of WEIGHTS.
    """
    w = weights[0]
    c, s = cos_sin(pose[2])
    least_allowed, start = _min_clearance(0.0, w), squared_at(fields.squared, pose[0], pose[1])
    nearest = max(w.radius + w.padding - w.escape, 0.0)
    fleeing = nearest * nearest <= start <= least_allowed
    speeds = _samples(window[0], window[1], counts[0])
    turns = _samples(window[2], window[3], counts[1])
    best_speed, best_turn, lowest = 0.0, 0.0, INVALID
    for speed in speeds:
        for turn in turns:
            if _is_barred(speed, turn, barred, w) or not _can_stop_within(bounds, speed, turn, c, s, w):
                continue
            least, x, y, end_c, end_s = _least_clearance(
                pose[0], pose[1], c, s, speed, turn, fields, fleeing, w
            )
            if least < 0.0:
                continue
            too_near = fleeing and squared_at(fields.squared, x, y) <= least_allowed
            score = _score(least, x, y, end_c, end_s, fields.waves, table, too_near, w)
            if score >= 0.0 and (lowest < 0.0 or score < lowest):
                best_speed, best_turn, lowest = speed, turn, score
    return best_speed, best_turn, lowest
