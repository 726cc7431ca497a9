"""Kernels that mark and clear the cells of a grid by ray tracing of scans.

Lengths are in cells; positions are relative to the grid's corner. As costmap_2d's obstacle layer
(ros-planning/navigation, costmap_2d/plugins/obstacle_layer.cpp) with two differences: rays are traced exactly
instead of by Bresenham's line, and the cell in which a ray ends is not cleared.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats, Int16s, Int64s, Octets, UInt16s
from actors.floor.raster import bearing_to, half_width, window
from actors.geometry import distance_to_border
from actors.kernels import kernel
from actors.messages import NO_ECHO_MM
from actors.portable import arrays
from actors.portable import cos_sin as portable_cos_sin
from actors.portable.compiled import cos_sin, hypot
from actors.settings import ParameterError

HALF_DIAGONAL: Final = math.sqrt(0.5)
_ENDED: Final = 2
"""Temporary value of a cell in which a ray of the current scan ends."""


class Rays(NamedTuple):
    """Geometry of a range sensor; lengths in cells."""

    directions: Floats
    """(n, 2): unit vectors in the sensor's frame."""
    fan: Floats
    """Angle of the first ray in that frame and increment, rad."""
    limits: Floats
    """Cells per mm; maximum ranges of marking and of clearing; range from which rays without echo clear (inf:
    never)."""


@kernel
def _free_segment(range_mm: int, limits: Floats) -> tuple[float, float]:
    """Return the segment of a ray that is free, cells; begins at inf if there is none."""
    if range_mm == NO_ECHO_MM:
        return limits[3], limits[2]
    return 0.0, min(range_mm * limits[0], limits[2])


@kernel
def _crossing(x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
    """Return where a ray from the origin along (dx, dy) enters and leaves the unit square around (x, y).

    The exit precedes the entry if the ray misses the square.
    """
    enter, leave = 0.0, math.inf
    for centre, along in ((x, dx), (y, dy)):
        if along == 0.0:
            if abs(centre) > 0.5:
                return math.inf, 0.0
            continue
        near, far = (centre - 0.5) / along, (centre + 0.5) / along
        enter = max(enter, min(near, far))
        leave = min(leave, max(near, far))
    return enter, leave


@kernel
def _is_passed(
    x: float, y: float, ranges_mm: UInt16s, rays: Rays, c: float, s: float, heading: float
) -> bool:
    """Return True if a ray passes through the cell centred at (x, y) relative to the sensor."""
    directions, fan, limits = rays
    apart = hypot(x, y)
    if apart - HALF_DIAGONAL >= limits[2]:
        return False
    bearing, half = bearing_to(x, y, heading, fan[0]), half_width(apart, HALF_DIAGONAL)
    for turn in range(-1, 2):
        first, last = window(bearing, half, turn, fan[1], ranges_mm.size)
        for k in range(first, last):
            begin, end = _free_segment(ranges_mm[k], limits)
            if end < apart - HALF_DIAGONAL:
                continue
            enter, leave = _crossing(
                x, y, c * directions[k, 0] - s * directions[k, 1], s * directions[k, 0] + c * directions[k, 1]
            )
            if begin <= enter < leave <= end:
                return True
    return False


@kernel
def _write_below(cells: NDArray[Any], value: int, body: Floats, radius: float) -> None:
    """Write `value` into cells with centres within `radius` of the body's."""
    for row in range(max(int(body[1] - radius), 0), min(int(body[1] + radius) + 1, cells.shape[0])):
        for column in range(max(int(body[0] - radius), 0), min(int(body[0] + radius) + 1, cells.shape[1])):
            if hypot(column + 0.5 - body[0], row + 0.5 - body[1]) <= radius:
                cells[row, column] = value


@kernel
def mark_and_clear(marks: Octets, ranges_mm: UInt16s, rays: Rays, eye: Floats, body: Floats) -> None:
    """Clear cells passed by a ray or below the body, and mark cells in which a ray ends.

    `marks`: (rows, columns), 0 or 1, modified. `ranges_mm`: (n,). `eye`: x, y, cells, and heading of the
    sensor, rad. `body`: x, y and radius, cells.
    """
    directions, limits = rays.directions, rays.limits
    c, s = cos_sin(eye[2])
    for k in range(ranges_mm.size):
        apart = ranges_mm[k] * limits[0]
        if ranges_mm[k] == NO_ECHO_MM or apart >= limits[1]:
            continue
        column = math.floor(eye[0] + apart * (c * directions[k, 0] - s * directions[k, 1]))
        row = math.floor(eye[1] + apart * (s * directions[k, 0] + c * directions[k, 1]))
        if 0 <= row < marks.shape[0] and 0 <= column < marks.shape[1]:
            marks[row, column] = _ENDED
    for row in range(marks.shape[0]):
        for column in range(marks.shape[1]):
            if marks[row, column] == _ENDED:  # stays marked even if other rays pass
                marks[row, column] = 1
            elif marks[row, column]:
                x, y = column + 0.5 - eye[0], row + 0.5 - eye[1]
                if _is_passed(x, y, ranges_mm, rays, c, s, eye[2]):
                    marks[row, column] = 0
    _write_below(marks, 0, body, body[2] - HALF_DIAGONAL)


@kernel
def stamp_free_cells(
    stamps: Int64s, instant: int, ranges_mm: UInt16s, rays: Rays, eye: Floats, body: Floats
) -> None:
    """Write `instant` into each cell passed by a ray or below the body.

    `stamps`: (rows, columns), modified; other parameters as for `mark_and_clear`. Grid traversal: Amanatides
    and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987.
    """
    _write_below(stamps, instant, body, body[2])
    rows, columns = stamps.shape
    directions, limits = rays.directions, rays.limits
    c, s = cos_sin(eye[2])
    for k in range(ranges_mm.size):
        begin, end = _free_segment(ranges_mm[k], limits)
        dx, dy = c * directions[k, 0] - s * directions[k, 1], s * directions[k, 0] + c * directions[k, 1]
        column, row = math.floor(eye[0]), math.floor(eye[1])
        east, north = (1 if dx >= 0 else -1), (1 if dy >= 0 else -1)
        per_x = 1 / abs(dx) if dx != 0 else math.inf
        per_y = 1 / abs(dy) if dy != 0 else math.inf
        to_x = ((column + 1 - eye[0]) if dx >= 0 else (eye[0] - column)) * per_x
        to_y = ((row + 1 - eye[1]) if dy >= 0 else (eye[1] - row)) * per_y
        enter = 0.0
        while 0 <= row < rows and 0 <= column < columns and min(to_x, to_y) <= end:
            if enter >= begin:
                stamps[row, column] = instant
            if to_x < to_y:
                enter = to_x
                to_x += per_x
                column += east
            else:
                enter = to_y
                to_y += per_y
                row += north


@kernel
def stamp_new_marks(
    arrivals: Int64s, instant: int, marks: Octets, before: Octets, stamps: Int64s, oldest: int
) -> None:
    """Write `instant` into each cell that is marked, was not marked `before`, and has a stamp ≥ `oldest`.

    All arrays: (rows, columns).
    """
    for row in range(marks.shape[0]):
        for column in range(marks.shape[1]):
            if marks[row, column] > before[row, column] and stamps[row, column] >= oldest:
                arrivals[row, column] = instant


CORNERS: Final = 16
"""Number of corners of a footprint (makeFootprintFromRadius)."""
_NEARLY_ZERO: Final = {4: (1.0, 1.0), 8: (-1.0, 1.0), 12: (-1.0, -1.0)}
"""Signs of the padding of the left, rear and right corners: in double precision their cosines and sines are
not 0, and costmap_2d uses their signs."""


def outline(radius: float, padding: float) -> Floats:
    """Return the corners of a disc of `radius`, m: (CORNERS, 2), body's frame, counter-clockwise.

    The first is in front. Each coordinate that is not 0 is `padding`, m, farther out (padFootprint).
    """
    corners = np.array([portable_cos_sin(corner * math.tau / CORNERS)[:2] for corner in range(CORNERS)])
    outward = np.sign(corners)
    outward[0] = 1.0, 0.0
    for corner, signs in _NEARLY_ZERO.items():
        outward[corner] = signs
    padded: Floats = corners * radius + padding * outward
    return padded


def inscribed(radius: float, padding: float) -> float:
    """Return the radius of the largest disc within that outline, m (calculateMinAndMaxDistances)."""
    return distance_to_border(tuple((float(x), float(y)) for x, y in outline(radius, padding)))


@kernel
def cost_below(
    squared: Int16s, table: Octets, x: float, y: float, c: float, s: float, corners: Floats
) -> int:
    """Return the highest cost below the outline of a body at (x, y) with the heading's cosine and sine.

    -1 if the outline meets a mark or leaves the window. `squared`: (rows, columns), squared distance to
    marks; `table`: cost by squared distance. `corners`: (n, 2), cells, body's frame
    (CostmapModel::footprintCost).
    """
    rows, columns = squared.shape
    highest = 0
    last = corners.shape[0] - 1
    right = x + (corners[last, 0] * c - corners[last, 1] * s)
    up = y + (corners[last, 0] * s + corners[last, 1] * c)
    if not (0.0 <= right < columns and 0.0 <= up < rows):
        return -1
    for corner in range(corners.shape[0]):
        next_right = x + (corners[corner, 0] * c - corners[corner, 1] * s)
        next_up = y + (corners[corner, 0] * s + corners[corner, 1] * c)
        if not (0.0 <= next_right < columns and 0.0 <= next_up < rows):
            return -1
        cost = _along(squared, table, int(right), int(up), int(next_right), int(next_up))
        if cost < 0:
            return -1
        highest = max(highest, cost)
        right, up = next_right, next_up
    return highest


@kernel
def _along(squared: Int16s, table: Octets, column: int, row: int, last_column: int, last_row: int) -> int:
    """Return the highest cost along a line of cells; -1 if one is marked.

    Bresenham, "Algorithm for computer control of a digital plotter", IBM Systems Journal 4(1), 1965; the
    initial remainder is half of the longer axis (base_local_planner/line_iterator.h).
    """
    right, up = abs(last_column - column), abs(last_row - row)
    east, north = (1 if last_column >= column else -1), (1 if last_row >= row else -1)
    length, aside = max(right, up), min(right, up)
    carried = length // 2
    highest = 0
    for _ in range(length + 1):
        if squared[row, column] == 0:
            return -1
        highest = max(highest, int(table[squared[row, column]]))
        carried += aside
        over = carried >= length
        if over:
            carried -= length
        if over or right >= up:
            column += east
        if over or right < up:
            row += north
    return highest


MOST_REACH: Final = 126
"""Maximum distance of `squared_within`, cells; 2 (reach + 1)² must fit into int16."""


def check_reach(what: str, reach: float, cell: float) -> None:
    """Raise ParameterError if `reach`, m, exceeds MOST_REACH cells of side `cell`, m."""
    if reach > MOST_REACH * cell:
        raise ParameterError(what, reach, f"at most {MOST_REACH} cells of {cell:g} m")


@kernel
def _along_columns(marks: Octets, reach: int) -> Int16s:
    """Return the distance in rows to the nearest mark of the same column, at most reach + 1."""
    rows, columns = marks.shape
    away = np.empty((rows, columns), np.int16)
    far, one, zero = np.int16(reach + 1), np.int16(1), np.int16(0)
    for column in range(columns):
        away[0, column] = zero if marks[0, column] else far
    for row in range(1, rows):
        for column in range(columns):
            more = min(far, np.int16(away[row - 1, column] + one))
            away[row, column] = zero if marks[row, column] else more
    for row in range(rows - 2, -1, -1):
        for column in range(columns):
            more = np.int16(away[row + 1, column] + one)
            away[row, column] = min(away[row, column], more)
    return away


@kernel
def squared_within(marks: Octets, reach: int) -> Int16s:
    """Return the exact squared distance from each cell to the nearest mark, cells², at most (reach + 1)².

    `marks`: (rows, columns), 0 in unmarked cells; the result has that shape. `reach`: 1 to MOST_REACH.
    """
    assert 1 <= reach <= MOST_REACH
    rows, columns = marks.shape
    away = _along_columns(marks, reach)
    # all rows in one loop, with `reach` unmarked columns between them
    stride = columns + reach
    height = np.full(reach + rows * stride + reach, np.int16((reach + 1) * (reach + 1)), np.int16)
    for row in range(rows):
        first = reach + row * stride
        height[first : first + columns] = away[row] * away[row]
    best = height[reach:-reach].copy()
    for aside in range(1, reach + 1):
        more = np.int16(aside * aside)
        left, right = height[reach - aside :], height[reach + aside :]
        for cell in range(best.size):
            near = np.int16(min(left[cell], right[cell]) + more)
            best[cell] = min(best[cell], near)
    return best.reshape(rows, stride)[:, :columns].copy()


@kernel
def half_gaps(
    squared: Int16s, arrivals: Int64s, since: int, body: Floats, room: float, farthest: float
) -> Floats:
    """Return half of the gap to each moving mark, if below `farthest`, so that two robots stop in time.

    (k, 3): unit vector to the mark, and half of the gap. `squared`: 0 in marked cells; marks with `arrivals`
    ≥ `since` are moving. `body`: x and y. `room`: distance of the centre from marks. Lengths in cells.
    """
    reach = room + 2.0 * farthest
    bottom, top = max(int(body[1] - reach), 0), min(int(body[1] + reach) + 1, squared.shape[0])
    left, right = max(int(body[0] - reach), 0), min(int(body[0] + reach) + 1, squared.shape[1])
    bounds = np.empty((max(top - bottom, 0) * max(right - left, 0), 3))
    count = 0
    for row in range(bottom, top):
        for column in range(left, right):
            if squared[row, column] > 0 or arrivals[row, column] < since:
                continue
            x, y = column + 0.5 - body[0], row + 0.5 - body[1]
            apart = math.sqrt(x * x + y * y)
            half = max(apart - room, 0.0) / 2.0
            if apart > 0.0 and half < farthest:
                bounds[count, 0], bounds[count, 1], bounds[count, 2] = x / apart, y / apart, half
                count += 1
    return bounds[:count].copy()


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    # read-only like the data of a message, to compile the variant that the robot calls
    ranges = np.frombuffer((900 + 700 * arrays.sin(5 * angles)).astype("<u2").tobytes(), "<u2")
    directions = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
    fan, limits = np.array([-math.pi, math.tau / 90]), np.array([0.02, 25.0, 30.0, 0.0])
    rays = Rays(directions, fan, limits)
    marks = (np.add.outer(np.arange(40) * 7, np.square(np.arange(40)) * 3) % 5 == 0).astype(np.uint8)
    stamps, arrivals = np.zeros((40, 40), np.int64), np.zeros((40, 40), np.int64)
    eye, body = np.array([19.3, 20.6, 0.4]), np.array([20.1, 20.4, 3.5])
    mark_and_clear(marks, ranges, rays, eye, body)
    stamp_free_cells(stamps, 7, ranges, rays, eye, body)
    stamp_new_marks(arrivals, 9, marks, np.zeros((40, 40), np.uint8), stamps, 7)
    row, column = np.indices((40, 40))
    corners, costs = outline(3.6, 0.2), ((row * 5 + column * column * 3) % 101).astype(np.int16)
    table = np.maximum(200 - 2 * np.arange(101), 0).astype(np.uint8)
    table.setflags(write=False)  # as the cost map's
    places = (12.3, 20.4), (30.1, 8.8), (39.0, 2.0)
    below = np.array([cost_below(costs, table, x, y, 0.8, 0.6, corners) for x, y in places])
    near = squared_within(((row * 7 + column * column * 3) % 61 == 0).astype(np.uint8), 9)
    gaps = half_gaps(near, (column * 7 % 5).astype(np.int64), 3, np.array([17.6, 16.4, 0.0]), 1.5, 4.0)
    return b"".join(part.tobytes() for part in (marks, stamps, arrivals, corners, below, near, gaps))
