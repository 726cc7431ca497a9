"""Kernels of path and goal distances in the window of the local cost map, around obstacles.

As MapGrid of ros-planning/navigation, base_local_planner/src/map_grid.cpp: a wave propagates from its start
cells to their four neighbours, through cells that the robot's centre may occupy.
"""

import math
from typing import NamedTuple

import numpy as np

from actors.array_types import Floats, Int16s, Int32s
from actors.kernels import kernel
from actors.portable.compiled import atan2, cos, hypot, sin


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    row, column = np.indices((40, 40))
    squared = ((row * 5 + column * column * 3) % 31).astype(np.int16)
    path = np.column_stack((np.linspace(0.1, 3.0, 30), 0.8 + np.square(np.linspace(0, 1, 30))))
    body = np.array([8.0, 17.0, 0.3])
    motion = np.array([cos(0.3), sin(0.3), 0.5, 0.0, 20.0])
    nearest, ended, cells = clip_path(path, 0, motion, body, 40, 20.0)
    assert cells.size
    goals = free_goal(squared, 20.5, cells, -1.0), free_goal(squared, 20.5, cells, 3.0)
    steps = wavefront(squared, 4.5, cells)
    results = nearest, ended, goals, bearing(squared, 4.5, cells, body, 5.0), detour(steps, cells, body)
    return repr(results).encode() + cells.tobytes() + steps.tobytes()


class Waves(NamedTuple):
    """Steps from each cell of the window; see `wavefront`."""

    path: Int32s
    """Steps to the plan."""
    goal: Int32s
    """Steps to the local goal."""
    front: Int32s
    """Steps to the target of the nose."""


@kernel
def _with_ring(squared: Int16s, limit: float, far: np.int32) -> Int32s:
    """Return `far` in free cells, -1 in others, and a ring of 0 around them, which replaces bounds checks."""
    rows, columns = squared.shape
    width = columns + 2
    known = np.full((rows + 2) * width, np.int32(0), np.int32)
    for row in range(rows):
        inside = known[(row + 1) * width + 1 : (row + 1) * width + 1 + columns]
        open_row = squared[row]
        for column in range(columns):
            inside[column] = far if open_row[column] > limit else np.int32(-1)
    return known


@kernel
def wavefront(squared: Int16s, limit: float, starts: Int32s) -> Int32s:
    """Return the steps from each cell to the nearest of `starts`: (rows, columns).

    rows · columns in an occupied cell beside the wave, one more in an unreached cell. `squared`: (rows,
    columns), squared distance to marks; a wave enters cells with more than `limit`, but may start in any.
    `starts`: (n, 2), rows and columns within the window.
    """
    rows, columns = squared.shape
    far, barred, met = np.int32(rows * columns + 1), np.int32(-1), np.int32(-2)
    width = columns + 2
    known = _with_ring(squared, limit, far)
    queue = np.empty(rows * columns + starts.shape[0], np.int32)
    end = 0
    for k in range(starts.shape[0]):
        cell = (starts[k, 0] + 1) * width + starts[k, 1] + 1
        if known[cell] != 0:
            known[cell] = 0
            queue[end] = cell
            end += 1
    # unsigned, so that indices need no check for negative values
    done, queued, one, above = np.uintp(0), np.uintp(end), np.uintp(1), np.uintp(width)
    while done < queued:
        cell = np.uintp(queue[done])
        done += one
        further = np.int32(known[cell] + 1)
        for near in (cell - above, cell - one, cell + one, cell + above):
            if known[near] == far:
                known[near] = further
                queue[queued] = near
                queued += one
            elif known[near] == barred:
                known[near] = met
    return _distances(known, rows, columns, far)


@kernel
def _distances(known: Int32s, rows: int, columns: int, far: np.int32) -> Int32s:
    """Return the steps without the ring; `far` in unreached cells, one less in occupied cells beside it."""
    width = columns + 2
    distances = np.empty((rows, columns), np.int32)
    for row in range(rows):
        inside = known[(row + 1) * width + 1 : (row + 1) * width + 1 + columns]
        out = distances[row]
        for column in range(columns):
            out[column] = inside[column] if inside[column] >= 0 else far + inside[column] + 1
    return distances


@kernel
def _nearest(path: Floats, first: int, x: float, y: float, along: float) -> int:
    """Return the index of the point nearest to (x, y), from `first` to `along` m further on the path."""
    nearest, least = first, math.inf
    gone = 0.0
    for k in range(first, path.shape[0]):
        if k > first:
            gone += hypot(path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1])
        if gone > along:
            break
        apart = hypot(path[k, 0] - x, path[k, 1] - y)
        if apart < least:
            nearest, least = k, apart
    return nearest


@kernel
def clip_path(
    path: Floats, first: int, motion: Floats, body: Floats, side: int, reach: float
) -> tuple[int, bool, Int32s]:
    """Return the index of the point of `path` nearest to the body, whether the path is complete, and cells.

    The cells are (k, 2) rows and columns from that point on, without gaps (MapGrid::adjustPlanResolution).
    `path`: (n, 2), n ≥ 1, m. `first`: the previous index; points up to half of `reach` further along the path
    are tried. `motion`: cosine and sine of the angle from the path's frame to the window's, shift of x and y,
    m, and cells per m. `body`: x and y, cells. `side`: of the window. `reach`: where the path is clipped,
    cells.
    """
    c, s, scale = motion[0], motion[1], motion[4]
    # the body in the path's frame
    dx, dy = body[0] / scale - motion[2], body[1] / scale - motion[3]
    nearest = _nearest(path, first, c * dx + s * dy, c * dy - s * dx, reach / scale / 2)
    cells = np.empty((side * side, 2), np.int32)
    count = 0
    last_x, last_y = 0.0, 0.0
    for k in range(nearest, path.shape[0]):
        x = (c * path[k, 0] - s * path[k, 1] + motion[2]) * scale
        y = (s * path[k, 0] + c * path[k, 1] + motion[3]) * scale
        steps = 1 if k == nearest else max(1, math.ceil(hypot(x - last_x, y - last_y)))
        for step in range(1, steps + 1):
            px = x if step == steps else last_x + step / steps * (x - last_x)
            py = y if step == steps else last_y + step / steps * (y - last_y)
            row, column = math.floor(py), math.floor(px)
            near = hypot(px - body[0], py - body[1]) <= reach and count < cells.shape[0]
            if not (near and 0 <= row < side and 0 <= column < side):
                return nearest, False, cells[:count].copy()
            if count == 0 or cells[count - 1, 0] != row or cells[count - 1, 1] != column:
                cells[count, 0], cells[count, 1] = row, column
                count += 1
        last_x, last_y = x, y
    return nearest, True, cells[:count].copy()


@kernel
def steps_at(steps: Int32s, x: float, y: float) -> int:
    """Return the steps of a point's cell; if unreached, of the best of the three other cells near it.

    The point may be farther from marks than its cell's centre. It is at least half a cell inside the window.
    """
    own = steps[np.uintp(y), np.uintp(x)]
    if own < steps.size:
        return int(own)
    row, column = np.uintp(y - 0.5), np.uintp(x - 0.5)
    over, after = row + np.uintp(1), column + np.uintp(1)
    return int(min(steps[row, column], steps[row, after], steps[over, column], steps[over, after]))


@kernel
def detour(steps: Int32s, cells: Int32s, body: Floats) -> int:
    """Return the additional steps from the body to the goal of `steps`, compared with those through `cells`.

    `steps`: of `wavefront`. `cells`: (k, 2), k ≥ 1. `body`: x and y, cells. 0 if the body is unreached.
    """
    here = steps_at(steps, body[0], body[1])
    if here >= steps.size:
        return 0
    planned = abs(cells[0, 0] - math.floor(body[1])) + abs(cells[0, 1] - math.floor(body[0]))
    for k in range(1, cells.shape[0]):
        planned += abs(cells[k, 0] - cells[k - 1, 0]) + abs(cells[k, 1] - cells[k - 1, 1])
    return int(here - planned)


@kernel
def bearing(squared: Int16s, limit: float, cells: Int32s, body: Floats, ahead: float) -> float:
    """Return the angle from the heading to the first of `cells` at distance `ahead`, or to the last, rad.

    0 if a cell before it is occupied. `squared`, `limit`: as for `wavefront`. `cells`: (k, 2), k ≥ 1. `body`:
    x and y, cells, and heading, rad. `ahead`: cells.
    """
    dx, dy = 0.0, 0.0
    for k in range(cells.shape[0]):
        if squared[cells[k, 0], cells[k, 1]] <= limit:
            return 0.0
        dx, dy = cells[k, 1] + 0.5 - body[0], cells[k, 0] + 0.5 - body[1]
        if hypot(dx, dy) >= ahead:
            break
    angle = atan2(dy, dx) - body[2]
    return float(angle - math.tau * math.floor((angle + math.pi) / math.tau))


@kernel
def free_goal(squared: Int16s, limit: float, cells: Int32s, slack: float) -> tuple[int, int]:
    """Return row and column of the last of `cells`, or of a free replacement.

    Replacement: with `slack` < 0 the last free one of `cells`, otherwise the nearest free cell within
    `slack`, cells; without one, the last of `cells`. `squared`, `limit`: as for `wavefront`; `cells`: (k, 2),
    k ≥ 1.
    """
    last_row, last_column = cells[-1, 0], cells[-1, 1]
    if squared[last_row, last_column] > limit:
        return last_row, last_column
    if slack < 0:
        for k in range(cells.shape[0] - 1, -1, -1):
            if squared[cells[k, 0], cells[k, 1]] > limit:
                return cells[k, 0], cells[k, 1]
        return last_row, last_column
    best_row, best_column, least = last_row, last_column, slack * slack
    reach = int(slack)
    for row in range(max(last_row - reach, 0), min(last_row + reach + 1, squared.shape[0])):
        for column in range(max(last_column - reach, 0), min(last_column + reach + 1, squared.shape[1])):
            apart = float(
                (row - last_row) * (row - last_row) + (column - last_column) * (column - last_column)
            )
            if squared[row, column] > limit and apart <= least:
                # of equally near cells the later one: an arbitrary rule
                best_row, best_column, least = row, column, apart
    return best_row, best_column
