"""The body's outline as the cost maps lay it onto the floor, and what lies below it.

A polygon, as ros-planning/navigation, branch indigo-devel, makes it of a radius
(costmap_2d/src/footprint.cpp) and lays it down (base_local_planner/src/costmap_model.cpp).
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.convex import distance_to_border
from actors.kernels import njit
from actors.portable import cos_sin

Costs = NDArray[np.uint8]
Squares = NDArray[np.int16]
Floats = NDArray[np.float64]

CORNERS: Final = 16
"""makeFootprintFromRadius."""
_NEARLY_ZERO: Final = {4: (1.0, 1.0), 8: (-1.0, 1.0), 12: (-1.0, -1.0)}
"""Which way the corners behind, left and right of the body are padded along the axis that they lie on: in
double precision their cosines and sines are not 0, and costmap_2d asks for their signs."""


def outline(radius: float, padding: float) -> Floats:
    """(CORNERS, 2): corners of a disc of `radius`, m, body's frame, counter-clockwise from its front.

    Each coordinate that is not 0 is `padding`, m, farther out (padFootprint).
    """
    corners = np.array([cos_sin(corner * math.tau / CORNERS)[:2] for corner in range(CORNERS)])
    outward = np.sign(corners)
    outward[0] = 1.0, 0.0
    for corner, signs in _NEARLY_ZERO.items():
        outward[corner] = signs
    padded: Floats = corners * radius + padding * outward
    return padded


def inscribed(radius: float, padding: float) -> float:
    """Radius of the largest disc within that outline, m (calculateMinAndMaxDistances)."""
    return distance_to_border(tuple((float(x), float(y)) for x, y in outline(radius, padding)))


def fingerprint() -> bytes:
    """What outline and kernel give for fixed inputs: differs where a processor or library computes
    differently."""
    corners = outline(3.6, 0.2)
    row, column = np.indices((40, 40))
    squared = ((row * 5 + column * column * 3) % 101).astype(np.int16)
    table = np.maximum(200 - 2 * np.arange(101), 0).astype(np.uint8)
    table.setflags(write=False)  # as the cost map's: the kernel is compiled for that
    below = [
        cost_below(squared, table, x, y, 0.8, 0.6, corners)
        for x, y in ((12.3, 20.4), (30.1, 8.8), (39.0, 2.0))
    ]
    return corners.tobytes() + np.array(below).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def cost_below(
    squared: Squares, table: Costs, x: float, y: float, c: float, s: float, corners: Floats
) -> int:
    """The highest cost below the outline of a body at (x, y), with its heading's cosine and sine.

    -1 if that meets a mark or leaves the window. `squared`: (rows, columns), squared distance to what is
    marked; `table`: cost by that. `corners`: (n, 2), cells, in the body's frame
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _along(squared: Squares, table: Costs, column: int, row: int, last_column: int, last_row: int) -> int:
    """The highest cost along a line of cells, -1 if one is marked.

    Bresenham, "Algorithm for computer control of a digital plotter", IBM Systems Journal 4(1), 1965; half of
    the longer axis is carried at first (base_local_planner/line_iterator.h).
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
