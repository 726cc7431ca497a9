"""Kernels: what the scan shows that the map does not, and where to head to get around it."""

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.messages import NO_ECHO_MM
from actors.robot.aim import aim, in_sight, room

FREE: Final = 0
RIGHT: Final = -1
LEFT: Final = 1
SHUT: Final = 2
"""What came of looking for a heading: none is needed, one to the right, one to the left, there is none."""

REJOIN: Final = 32
"""Four of so many points of the path, behind what is in the way, are looked for from a line's end: 1.6 m with
cells of 5 cm."""


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((60, 60))
    clearance = 0.05 * np.minimum(np.minimum(row, 59 - row), np.minimum(column, 59 - column))
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    ranges = np.frombuffer((900 + 400 * np.sin(5 * angles)).astype("<u2").tobytes(), "<u2")
    for shared in (clearance, ranges):
        shared.setflags(write=False)  # as in the robot: this compiles the very variants that it calls
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    mount, moved, frame = np.array([-0.1, 0.0]), np.array([0.01, -0.02, 0.1]), np.array([0.0, 0.0, 0.05])
    found = strangers(ranges, rays, mount, moved, 1.0, 1.5, 0.3, clearance, frame, 0.1, 1.2)
    way = np.column_stack((np.linspace(1.0, 2.7, 34), np.full(34, 1.5)))
    seen = np.array([[1.9, 1.4], [1.9, 1.6], [2.0, 1.5]])
    chosen = swerve(
        seen, way, 0, 1.0, 1.5, 1.5, 1.5, 0.3, 2.0, 0.6, 0.05, 1.6, 0.3, 0.5, clearance, frame, 0.2
    )
    first: bytes = found.tobytes()
    return first + np.array(chosen).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def strangers(
    ranges_mm: NDArray[np.uint16],
    rays: NDArray[np.float64],
    mount: NDArray[np.float64],
    moved: NDArray[np.float64],
    x: float,
    y: float,
    heading: float,
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    wall: float,
    view: float,
) -> NDArray[np.float64]:
    """Points of the scan within `view`, m, that are no walls of the map: (k, 2), m, map frame.

    A wall is where the map's clearance is less than `wall`, m. `ranges_mm`, `rays`, `mount` and `moved` as
    for `free_arc`; `x`, `y`, `heading`: the body's pose now; `clearance` and `frame` as for `aim`.
    """
    c, s = math.cos(heading), math.sin(heading)
    sensor_x = x + c * moved[0] - s * moved[1]
    sensor_y = y + s * moved[0] + c * moved[1]
    c, s = math.cos(heading + moved[2]), math.sin(heading + moved[2])
    sensor_x += c * mount[0] - s * mount[1]
    sensor_y += s * mount[0] + c * mount[1]
    found = np.empty((ranges_mm.size, 2))
    count = 0
    for ray in range(ranges_mm.size):
        distance = ranges_mm[ray] * 1e-3
        if ranges_mm[ray] == NO_ECHO_MM or distance > view:
            continue
        to_x = sensor_x + distance * (c * rays[ray, 0] - s * rays[ray, 1])
        to_y = sensor_y + distance * (s * rays[ray, 0] + c * rays[ray, 1])
        if room(clearance, frame, to_x, to_y) >= wall:
            found[count, 0], found[count, 1] = to_x, to_y
            count += 1
    return found[:count].copy()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_free(points: NDArray[np.float64], x: float, y: float, to_x: float, to_y: float, berth: float) -> bool:
    """True if the line comes no nearer than `berth` to any point but those that it leads away from."""
    dx, dy = to_x - x, to_y - y
    squared = dx * dx + dy * dy
    for i in range(points.shape[0]):
        px, py = points[i, 0] - x, points[i, 1] - y
        along = px * dx + py * dy
        if along > 0.0:
            part = min(1.0, along / squared)
            if math.hypot(px - part * dx, py - part * dy) < berth:
                return False
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def _free_way(
    points: NDArray[np.float64],
    way: NDArray[np.float64],
    index: int,
    x: float,
    y: float,
    to_x: float,
    to_y: float,
    berth: float,
    view: float,
) -> float:
    """How far from x, y the way by to_x, to_y keeps `berth`, m; inf if that is beyond `view`."""
    if not _is_free(points, x, y, to_x, to_y, berth):
        nearest = math.inf
        for i in range(points.shape[0]):
            nearest = min(nearest, math.hypot(points[i, 0] - x, points[i, 1] - y))
        return max(0.0, nearest - berth)
    reached = math.hypot(to_x - x, to_y - y)
    for i in range(index + 1, way.shape[0]):
        apart = math.hypot(way[i, 0] - x, way[i, 1] - y)
        if apart > view:
            break
        begin_x, begin_y = way[i - 1, 0], way[i - 1, 1]
        if apart > reached and not _is_free(points, begin_x, begin_y, way[i, 0], way[i, 1], berth):
            return apart
    return math.inf


@njit(cache=True)  # type: ignore[untyped-decorator]
def _rejoins(
    way: NDArray[np.float64],
    behind: int,
    x: float,
    y: float,
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    need: float,
) -> bool:
    """True if from x, y the way is in sight where it goes on from its point `behind`."""
    for i in range(behind, min(behind + REJOIN, way.shape[0]), REJOIN // 4):
        if in_sight(clearance, frame, x, y, way[i, 0], way[i, 1], need):
            return True
    return False


@njit(cache=True)  # type: ignore[untyped-decorator]
def _fan(
    points: NDArray[np.float64],
    way: NDArray[np.float64],
    behind: int,
    x: float,
    y: float,
    centre: float,
    turn: float,
    turns: int,
    spare: int,
    length: float,
    berth: float,
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    need: float,
) -> tuple[int, int]:
    """The first multiple of `turn` from `centre`, rad, with a free line of `length`, and the one to take.

    From the line's end the way must be in sight, or it would lead into a niche beside a door. Taken is up
    to twice the first, at most `spare` more, as long as all up to it are free. −1, −1 if none is.
    """
    first, taken = -1, -1
    for k in range(turns):
        if first >= 0 and k > first + min(first, spare):
            break
        to_x, to_y = x + length * math.cos(centre + k * turn), y + length * math.sin(centre + k * turn)
        out = _is_free(points, x, y, to_x, to_y, berth) and in_sight(clearance, frame, x, y, to_x, to_y, need)
        if out and _rejoins(way, behind, to_x, to_y, clearance, frame, need):
            first, taken = k if first < 0 else first, k
        elif first >= 0:
            break
    return first, taken


@njit(cache=True)  # type: ignore[untyped-decorator]
def swerve(
    points: NDArray[np.float64],
    way: NDArray[np.float64],
    index: int,
    x: float,
    y: float,
    to_x: float,
    to_y: float,
    berth: float,
    view: float,
    beyond: float,
    turn: float,
    widest: float,
    spare: float,
    left: float,
    clearance: NDArray[np.float64],
    frame: NDArray[np.float64],
    need: float,
) -> tuple[int, float, float]:
    """FREE, RIGHT, LEFT or SHUT, and the point x, y, m, to head for: to_x, to_y unless RIGHT or LEFT.

    FREE: the way by to_x, to_y comes no nearer than `berth` to `points` within `view`, m. Else headings are
    tried, `turn` apart, up to `widest` from that of the way, rad: lines that end `beyond` where the way
    ceases to be free, m. Of the free ones see `_fan`, with `spare`, rad. Left is taken if right is more than
    `left` wider, rad; never if that is inf. `way`, `index`, `clearance`, `frame`, `need` as for `aim`.
    """
    free = _free_way(points, way, index, x, y, to_x, to_y, berth, view)
    if free == math.inf:
        return FREE, to_x, to_y
    _, far_x, far_y = aim(way, index, x, y, view, clearance, frame, need)
    centre = math.atan2(far_y - y, far_x - x)
    need = min(need, room(clearance, frame, x, y))
    length = min(view, free + beyond)
    behind = index
    while behind < way.shape[0] - 1 and math.hypot(way[behind, 0] - x, way[behind, 1] - y) < length:
        behind += 1
    turns, more = int(widest / turn), int(spare / turn)
    side, angle = SHUT, 0.0
    first, taken = _fan(
        points, way, behind, x, y, centre, -turn, turns, more, length, berth, clearance, frame, need
    )
    limit = math.inf
    if first >= 0:
        side, angle, limit = RIGHT, centre - taken * turn, first * turn
    if left < limit:
        first, taken = _fan(
            points, way, behind, x, y, centre, turn, turns, more, length, berth, clearance, frame, need
        )
        if first >= 0 and first * turn + left < limit:
            side, angle = LEFT, centre + taken * turn
    if side == SHUT:
        return side, to_x, to_y
    return side, x + length * math.cos(angle), y + length * math.sin(angle)
