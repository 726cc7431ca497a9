"""Kernels: what one scan tells about the cells of a grid: which are marked, cleared, seen free.

The grid's cells are squares of side 1 in the units used here; (x, y) of a pose count from the grid's corner.
As costmap_2d's obstacle layer (ros-planning/navigation, costmap_2d/plugins/obstacle_layer.cpp), but for two
things: a ray's way is exact, not Bresenham's line between cells, and the cell that it ends in is not cleared.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.bearings import bearing_to, half_width, window
from actors.kernels import njit
from actors.messages import NO_ECHO_MM
from actors.portable import arrays
from actors.portable.compiled import cos_sin, hypot

Floats = NDArray[np.float64]
Marks = NDArray[np.uint8]

HALF_DIAGONAL: Final = math.sqrt(0.5)
_ENDED: Final = 2
"""What a cell holds in which a ray of the present scan ends, until the scan is taken in."""


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    # read-only, as what a message holds: so this compiles the very variant that the robot will call
    ranges = np.frombuffer((900 + 700 * arrays.sin(5 * angles)).astype("<u2").tobytes(), "<u2")
    rays = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
    marks = (np.add.outer(np.arange(40) * 7, np.square(np.arange(40)) * 3) % 5 == 0).astype(np.uint8)
    stamps = np.zeros((40, 40), np.int64)
    fan, eye = np.array([-math.pi, math.tau / 90]), np.array([19.3, 20.6, 0.4])
    body = np.array([20.1, 20.4, 3.5])
    limits = np.array([0.02, 25.0, 30.0, 0.0])
    take_in(marks, ranges, rays, fan, eye, body, limits)
    stamp(stamps, 7, ranges, rays, eye, body, limits)
    arrivals = np.zeros((40, 40), np.int64)
    note_arrivals(arrivals, 9, marks, np.zeros((40, 40), np.uint8), stamps, 7)
    return bytes(marks) + bytes(stamps) + bytes(arrivals)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _free_stretch(range_mm: int, limits: Floats) -> tuple[float, float]:
    """From where to where a ray shows that nothing is there, cells; from inf if nowhere."""
    if range_mm == NO_ECHO_MM:
        return limits[3], limits[2]
    return 0.0, min(range_mm * limits[0], limits[2])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _crossing(x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
    """Where a ray from the origin along (dx, dy) enters and leaves the unit square around (x, y).

    It leaves before it enters if it misses the square.
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _passed(
    x: float,
    y: float,
    ranges_mm: NDArray[np.uint16],
    rays: Floats,
    fan: Floats,
    limits: Floats,
    c: float,
    s: float,
    heading: float,
) -> bool:
    """True if some ray passes through the cell with its centre (x, y) away from the sensor."""
    apart = hypot(x, y)
    if apart - HALF_DIAGONAL >= limits[2]:
        return False
    bearing, half = bearing_to(x, y, heading, fan[0]), half_width(apart, HALF_DIAGONAL)
    for turn in range(-1, 2):
        first, last = window(bearing, half, turn, fan[1], ranges_mm.size)
        for k in range(first, last):
            begin, end = _free_stretch(ranges_mm[k], limits)
            if end < apart - HALF_DIAGONAL:
                continue
            enter, leave = _crossing(x, y, c * rays[k, 0] - s * rays[k, 1], s * rays[k, 0] + c * rays[k, 1])
            if begin <= enter < leave <= end:
                return True
    return False


@njit(cache=True)  # type: ignore[untyped-decorator]
def _write_below(cells: NDArray[Any], value: int, body: Floats, radius: float) -> None:
    """Write `value` into the cells whose centres are within `radius` of the body's."""
    for row in range(max(int(body[1] - radius), 0), min(int(body[1] + radius) + 1, cells.shape[0])):
        for column in range(max(int(body[0] - radius), 0), min(int(body[0] + radius) + 1, cells.shape[1])):
            if hypot(column + 0.5 - body[0], row + 0.5 - body[1]) <= radius:
                cells[row, column] = value


@njit(cache=True)  # type: ignore[untyped-decorator]
def take_in(
    marks: Marks,
    ranges_mm: NDArray[np.uint16],
    rays: Floats,
    fan: Floats,
    eye: Floats,
    body: Floats,
    limits: Floats,
) -> None:
    """Clear the marked cells that a ray passes through, mark those that a ray ends in, clear the body's.

    `marks`: (rows, columns), 0 or 1, changed. `ranges_mm`: (n,), NO_ECHO_MM where a ray met nothing. `rays`:
    (n, 2), unit vectors in the sensor's frame. `fan`: angle of the first ray in that frame, and from one to
    the next, rad. `eye`: x, y, cells, and heading of the sensor, rad. `body`: x, y and radius, cells; only
    cells that lie wholly below it are its own. `limits`: cells per mm; up to what distance rays mark, and up
    to what they clear, cells; from what distance on those without echo clear, cells, inf if they do not.
    """
    c, s = cos_sin(eye[2])
    for k in range(ranges_mm.size):
        apart = ranges_mm[k] * limits[0]
        if ranges_mm[k] == NO_ECHO_MM or apart >= limits[1]:
            continue
        column = math.floor(eye[0] + apart * (c * rays[k, 0] - s * rays[k, 1]))
        row = math.floor(eye[1] + apart * (s * rays[k, 0] + c * rays[k, 1]))
        if 0 <= row < marks.shape[0] and 0 <= column < marks.shape[1]:
            marks[row, column] = _ENDED
    for row in range(marks.shape[0]):
        for column in range(marks.shape[1]):
            if marks[row, column] == _ENDED:  # most of what is marked: whether rays pass it does not matter
                marks[row, column] = 1
            elif marks[row, column]:
                x, y = column + 0.5 - eye[0], row + 0.5 - eye[1]
                if _passed(x, y, ranges_mm, rays, fan, limits, c, s, eye[2]):
                    marks[row, column] = 0
    _write_below(marks, 0, body, body[2] - HALF_DIAGONAL)


@njit(cache=True)  # type: ignore[untyped-decorator]
def stamp(
    stamps: NDArray[np.int64],
    instant: int,
    ranges_mm: NDArray[np.uint16],
    rays: Floats,
    eye: Floats,
    body: Floats,
    limits: Floats,
) -> None:
    """Write `instant` into every cell that a ray passes through or that is below the body.

    `stamps`: (rows, columns), changed; the rest as above.

    The traversal of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics
    1987, from cell to cell, as every one is written: there is nothing that `actors.floor.traversal`, which
    leaps, could leave out.
    """
    _write_below(stamps, instant, body, body[2])
    rows, columns = stamps.shape
    c, s = cos_sin(eye[2])
    for k in range(ranges_mm.size):
        begin, end = _free_stretch(ranges_mm[k], limits)
        dx, dy = c * rays[k, 0] - s * rays[k, 1], s * rays[k, 0] + c * rays[k, 1]
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def note_arrivals(
    arrivals: NDArray[np.int64],
    instant: int,
    marks: Marks,
    before: Marks,
    stamps: NDArray[np.int64],
    oldest: int,
) -> None:
    """Write `instant` into every cell that is marked, was not so `before`, and has a stamp from `oldest` on.

    All arrays: (rows, columns).
    """
    for row in range(marks.shape[0]):
        for column in range(marks.shape[1]):
            if marks[row, column] > before[row, column] and stamps[row, column] >= oldest:
                arrivals[row, column] = instant
