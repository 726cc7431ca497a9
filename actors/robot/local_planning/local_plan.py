"""Kernel: what of the global plan the local planner goes by, as cells of its window.

As ros-planning/navigation, branch indigo-devel: transformGlobalPlan in
base_local_planner/src/goal_functions.cpp, MapGrid::adjustPlanResolution, setTargetCells and setLocalGoal in
map_grid.cpp, and DWAPlanner::updatePlanAndLocalCosts in dwa_local_planner/src/dwa_planner.cpp.
"""

import math

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable.compiled import cos_sin, hypot
from actors.robot.local_planning.dwa import INVALID, Costs, Squares, cheapest, example, samples
from actors.robot.local_planning.map_grid import wavefront

Floats = NDArray[np.float64]
Cells = NDArray[np.int32]


def _local_plan_fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    way = np.column_stack((np.linspace(0.1, 5.0, 90), 0.8 + np.square(np.linspace(0, 1.5, 90))))
    estimate, here = np.array([0.4, 0.8, 0.3]), np.array([0.9, 0.7, 0.6])
    cells, goal, front, far = local_plan(way, estimate, here, np.array([-0.1, -0.3]), 0.05, 40, 0.325)
    assert cells.size
    return bytes(cells.tobytes() + goal.tobytes() + front.tobytes() + bytes([far]))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _part(way: Floats, robot: Floats, reach: float) -> tuple[int, int]:
    """Indices of the first point of it and of the one after its last."""
    first = 0
    while first < way.shape[0]:
        dx, dy = robot[0] - way[first, 0], robot[1] - way[first, 1]
        if dx * dx + dy * dy <= reach * reach:
            break
        first += 1
    last = first
    while last < way.shape[0]:
        dx, dy = robot[0] - way[last, 0], robot[1] - way[last, 1]
        last += 1
        if dx * dx + dy * dy > reach * reach:
            break
    return first, last


@njit(cache=True)  # type: ignore[untyped-decorator]
def _cells(points: Floats, cell: float, corner: Floats, side: int, cells: Cells) -> int:
    """Write the cells of the points, m, and of others between them if they are more than a cell apart.

    From the first that is in the window to the last before one that is not; given is how many.
    """
    count = 0
    for k in range(points.shape[0]):
        steps = 1
        if k > 0:
            dx, dy = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
            if dx * dx + dy * dy > cell * cell:
                steps = math.ceil(math.sqrt(dx * dx + dy * dy) / cell)
        for step in range(1, steps + 1):
            x, y = points[k, 0], points[k, 1]
            if step < steps:
                x = points[k - 1, 0] + step * (dx / steps)
                y = points[k - 1, 1] + step * (dy / steps)
            x, y = (x - corner[0]) / cell, (y - corner[1]) / cell
            inside = 0.0 <= x < side and 0.0 <= y < side
            if not inside and count > 0:
                return count
            if inside and count < cells.shape[0]:
                cells[count, 0], cells[count, 1] = int(y), int(x)
                count += 1
    return count


@njit(cache=True)  # type: ignore[untyped-decorator]
def _moved(way: Floats, estimate: Floats, here: Floats) -> Floats:
    """The points in the odometry frame."""
    c, s = cos_sin(here[2] - estimate[2])
    x = here[0] - (c * estimate[0] - s * estimate[1])
    y = here[1] - (s * estimate[0] + c * estimate[1])
    points = np.empty_like(way)
    for k in range(way.shape[0]):
        points[k, 0] = c * way[k, 0] - s * way[k, 1] + x
        points[k, 1] = s * way[k, 0] + c * way[k, 1] + y
    return points


@njit(cache=True)  # type: ignore[untyped-decorator]
def local_plan(
    way: Floats, estimate: Floats, here: Floats, corner: Floats, cell: float, side: int, nose: float
) -> tuple[Cells, Cells, Cells, bool]:
    """The part of `way` from its first point within half a window of the robot to the first one beyond.

    Given are, as rows and columns: (k, 2) cells that it leads through, k = 0 where it is not in the window;
    (1, 2) the last of them; (1, 2) the last one of a plan that ends farther away from the robot, where its
    nose is drawn to; and whether its end is farther away than the nose is ahead. For k = 0 the rest is
    meaningless.

    `way`: (n, 2), n ≥ 1, m, map frame. `estimate`, `here`: x, y, m, and heading, rad, of the robot in the map
    frame and in the odometry frame; `corner`: x and y, m, of the window's in the latter. `cell`: m. `side`:
    of the window, cells. `nose`: so far ahead of the centre the nose is, m.
    """
    first, last = _part(way, estimate, side * cell / 2)
    points = _moved(way[first:last], estimate, here)
    room = math.ceil(nose / cell) + 2
    for k in range(1, points.shape[0]):
        room += 1 + math.ceil(hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]) / cell)
    cells = np.empty((min(room, side * side), 2), np.int32)
    count = _cells(points, cell, corner, side, cells)
    if count == 0:
        return cells[:0], cells[:0], cells[:0], False
    end_x, end_y = points[-1, 0], points[-1, 1]
    apart = hypot(end_x - here[0], end_y - here[1])
    east, north = (1.0, 0.0) if apart == 0.0 else ((end_x - here[0]) / apart, (end_y - here[1]) / apart)
    points[-1, 0], points[-1, 1] = end_x + nose * east, end_y + nose * north
    farther = np.empty_like(cells)
    ahead = _cells(points, cell, corner, side, farther)
    front = cells[count - 1 : count] if ahead == 0 else farther[ahead - 1 : ahead]
    return cells[:count], cells[count - 1 : count].copy(), front.copy(), apart > nose


@njit(cache=True)  # type: ignore[untyped-decorator]
def chosen(
    way: Floats,
    state: Floats,
    nose: float,
    counts: tuple[int, int],
    barred: NDArray[np.bool_],
    squared: Squares,
    limit: float,
    table: Costs,
    outline: Floats,
    critics: NDArray[np.void],
    alignment: float,
) -> tuple[float, float, float]:
    """The fields of `CheapestVelocity`; there is no valid trajectory if nothing of `way` is in the window.

    `state`, (12,): x, y, m, and heading, rad, of the robot in the map frame, then in the odometry frame; x
    and y, m, of the window's corner in the latter; the least and the greatest speed, m/s, and turn rate,
    rad/s, within reach. `nose`: so far ahead of the centre the nose is, m. `counts`: how many speeds and turn
    rates are tried. `alignment`: weight of the critic of that name while the plan's end is farther away than
    the nose; it is written to `critics`. All else as for `local_plan`, `wavefront` and `cheapest`.
    """
    cells, goal, front, far = local_plan(
        way, state[0:3], state[3:6], state[6:8], critics[0].cell, squared.shape[0], nose
    )
    if cells.shape[0] == 0:
        return 0.0, 0.0, INVALID
    # near the goal the nose is beyond it: to keep it on the plan would turn the robot round
    critics[0].alignment = alignment if far else 0.0
    to_path = wavefront(squared, limit, cells)
    to_goal = wavefront(squared, limit, goal)
    to_front = wavefront(squared, limit, front)
    window = state[8:12].astype(np.float32).astype(np.float64)  # rounded to what the original has
    speeds = samples(window[0], window[1], counts[0])
    turns = samples(window[2], window[3], counts[1])
    found: tuple[float, float, float] = cheapest(
        state[3:8], speeds, turns, barred, squared, to_path, to_goal, to_front, table, outline, critics
    )
    return found


def _control_cycle_fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    squared, table, corners, critics = example()
    way = np.column_stack((np.linspace(0.1, 5.0, 90), 0.8 + np.square(np.linspace(0, 1.5, 90))))
    state = np.array([0.4, 0.8, 0.3, 1.115, 2.52, 0.6, -0.5, 0.5, -0.1, 0.5, -1.0, 1.0])
    barred = np.zeros(4, np.bool_)
    found = chosen(way, state, 0.33, (7, 8), barred, squared, 4.5, table, corners, critics, 3.2)
    return np.array(found).tobytes()


def fingerprint() -> bytes:
    """Return the results of all kernels of this module for fixed inputs, concatenated."""
    return b"".join(part() for part in (_local_plan_fingerprint, _control_cycle_fingerprint))
