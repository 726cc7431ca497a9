"""Kernels of global planning: potentials of goals, and gradient descent.

Dijkstra's algorithm with a bucket queue (Dial, "Algorithm 360: Shortest-path forest with topological
ordering", CACM 12(11), 1969), since costs are small integers. A step leads to one of eight neighbours and
costs (5 straight, 7 diagonal) × (cost of the cell it leaves + cost of the cell it enters); diagonal steps
need both cells beside them to be free.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats, Int32s, Octets, Singles
from actors.kernels import kernel

UNREACHABLE: Final = np.iinfo(np.int32).max
"""Potential of a cell without path to the goal."""
STRAIGHT: Final = 5
DIAGONAL: Final = 7
"""7/5 is within 1 % of √2."""


@kernel
def _is_step(costs: Int32s, row: int, column: int, down: int, right: int) -> bool:
    """Return True if the step from a free cell ends in a free cell of the grid and cuts no corner."""
    r, c = row + down, column + right
    if r < 0 or c < 0 or r >= costs.shape[0] or c >= costs.shape[1] or costs[r, c] == 0:
        return False
    return down == 0 or right == 0 or (costs[row, c] > 0 and costs[r, column] > 0)


@kernel
def potential(costs: Int32s, goal_row: int, goal_column: int) -> Int32s:
    """Return the cost of the cheapest path from each cell to the goal cell: (rows, columns), or UNREACHABLE.

    `costs`: (rows, columns), > 0 in free cells, otherwise 0.
    """
    rows, columns = costs.shape
    field = np.full((rows, columns), UNREACHABLE, np.int32)
    known = field.ravel()
    if costs[goal_row, goal_column] == 0:
        return field
    # a cell is in at most one bucket, a doubly linked list, so that a cheaper path can move it to another
    buckets = np.full(2 * DIAGONAL * costs.max() + 1, -1, np.int32)
    after = np.full(rows * columns, -1, np.int32)
    before = np.full(rows * columns, -1, np.int32)
    known[goal_row * columns + goal_column] = 0
    buckets[0] = goal_row * columns + goal_column
    waiting = 1
    distance = 0
    while waiting > 0:
        slot = distance % buckets.size
        cell = buckets[slot]
        if cell < 0:
            distance += 1
            continue
        _unlink(buckets, after, before, cell, slot)
        waiting -= 1
        row, column = cell // columns, cell % columns
        for side in range(9):
            down, right = side // 3 - 1, side % 3 - 1
            if side == 4 or not _is_step(costs, row, column, down, right):
                continue
            near = cell + down * columns + right
            length = STRAIGHT if down == 0 or right == 0 else DIAGONAL
            reached = distance + length * (costs[row, column] + costs[row + down, column + right])
            if reached < known[near]:
                if known[near] == UNREACHABLE:
                    waiting += 1
                else:
                    _unlink(buckets, after, before, near, known[near] % buckets.size)
                known[near] = reached
                _link(buckets, after, before, near, reached % buckets.size)
    return field


@kernel
def _link(buckets: Int32s, after: Int32s, before: Int32s, cell: int, slot: int) -> None:
    """Insert a cell into a bucket."""
    head = buckets[slot]
    after[cell] = head
    before[cell] = -1
    if head >= 0:
        before[head] = cell
    buckets[slot] = cell


@kernel
def _unlink(buckets: Int32s, after: Int32s, before: Int32s, cell: int, slot: int) -> None:
    """Remove a cell from its bucket."""
    if before[cell] >= 0:
        after[before[cell]] = after[cell]
    else:
        buckets[slot] = after[cell]
    if after[cell] >= 0:
        before[after[cell]] = before[cell]


@kernel
def descent(costs: Int32s, field: Int32s, row: int, column: int) -> Int32s:
    """Return the cells from (row, column) to the goal by steepest descent: (n, 2) rows and columns.

    The start's potential must not be UNREACHABLE.
    """
    cells = np.empty((costs.size, 2), np.int32)
    count = 0
    while True:
        cells[count, 0], cells[count, 1] = row, column
        count += 1
        if field[row, column] == 0:
            return cells[:count].copy()
        steepest = 0.0
        best_down, best_right = 0, 0
        for side in range(9):
            down, right = side // 3 - 1, side % 3 - 1
            if side == 4 or not _is_step(costs, row, column, down, right):
                continue
            drop = float(field[row, column]) - float(field[row + down, column + right])
            slope = drop / (STRAIGHT if down == 0 or right == 0 else DIAGONAL)
            if slope > steepest:
                steepest, best_down, best_right = slope, down, right
        row += best_down
        column += best_right


UNREACHED: Final = np.float32(1e10)
"""Potential of an unreached cell (POT_HIGH)."""
IMPASSABLE: Final = 254
"""Cost of an occupied cell (COST_OBS)."""
_ASIDE: Final = 0.707106781
"""A cell is updated again if its potential exceeds a neighbour's by this share of its cost."""
_WAITING: Final = np.uint8(255)
"""Value instead of the cost of a cell that is already in a block."""
_STEP: Final = 0.5
"""Length of a descent step, cells (pathStep)."""


def wave(costs: Octets, root: tuple[int, int], neutral: int, until: tuple[int, int] | None = None) -> Singles:
    """Return the potential of the cells, 0 at `root` (row, column): (rows, columns), or UNREACHED.

    `costs`: (rows, columns), of a step through each cell, ≥ IMPASSABLE along the edge; the root must not be
    on the edge, and its cost is ignored. `neutral`: the lowest cost, used for thresholds. The wave ends at
    the cell `until`; potentials near it may not be minimal.
    """
    rows, columns = costs.shape
    assert 0 < root[0] < rows - 1 and 0 < root[1] < columns - 1
    last = -1 if until is None else until[0] * columns + until[1]
    start = root[0] * columns + root[1]
    return _wave(costs.ravel(), columns, start, last, 2.0 * neutral).reshape(costs.shape)


def steepest_descent(field: Singles, row: int, column: int, neutral: int) -> Floats:
    """Return the path of steepest descent from a reached cell to the root: (n, 2), rows and columns.

    Coordinates are in cells; the centre of a cell has its indices. Spacing: half a cell, up to a diagonal
    beside unreached cells. The first point is the cell, the last the root.
    """
    columns = field.shape[1]
    most = 64 + int(4 * field[row, column] / neutral)
    return _steepest_descent(field.ravel(), columns, row * columns + column, float(neutral), most)


@kernel
def _front(
    left: np.float32, right: np.float32, down: np.float32, up: np.float32, cost: np.float32
) -> np.float32:
    """Return a cell's potential from those of its four neighbours."""
    lower, other = min(left, right), min(down, up)
    if other < lower:
        lower, other = other, lower
    apart = np.float32(other - lower)
    slant = np.float64(np.float32(apart / cost))
    share = np.float32(-0.2301 * slant * slant + 0.5307 * slant + 0.7040)
    return np.float32(lower + (cost if apart >= cost else np.float32(cost * share)))


@kernel
def _add_if_lower(
    near: np.uint64,
    potential: np.float32,
    here: np.float32,
    aside: Singles,
    entrance: Octets,
    blocks: NDArray[np.uint32],
    end: np.uint64,
) -> np.uint64:
    """Add a neighbour to the block that ends at `end` if `here` may lower its potential; return the new end.

    Branchless, since the branch is unpredictable: the neighbour is always written behind the last cell.
    """
    cost = entrance[near]
    wakes = potential > np.float32(here + aside[cost])
    entrance[near] = _WAITING if wakes else cost
    blocks[end] = near
    return end + np.uint64(wakes)


@kernel
def _update_thresholds() -> Singles:
    """Return the difference of potentials above which a cell is updated again, by its cost."""
    aside = np.full(256, np.inf, np.float32)
    for cost in range(IMPASSABLE):
        aside[cost] = np.float32(_ASIDE * np.float64(cost))
    return aside


@kernel
def _wave(costs: Octets, columns: int, root: int, last: int, rise: float) -> Singles:
    # unsigned, so that indices need no check for negative values
    field = np.full(costs.size, UNREACHED, np.float32)
    entrance, aside = costs.copy(), _update_thresholds()
    # a cell is in at most one block; each block has space for all cells and one that is not kept; blocks are
    # parts of one array, which begin at `now`, `soon` and `later`: faster than three arrays
    none, one, across, cell = np.uint64(0), np.uint64(1), np.uint64(columns), np.uint64(root)
    space = np.uint64(costs.size + 1)
    blocks = np.empty(3 * (costs.size + 1), np.uint32)
    now, soon, later = none, space, space + space
    end, end_soon, end_later = now, soon, later
    threshold = np.float32(IMPASSABLE)
    here = field[cell] = np.float32(0.0)
    for near in (cell - one, cell + one, cell - across, cell + across):
        end = _add_if_lower(near, field[near], here, aside, entrance, blocks, end)
    while end > now:
        for k in range(now, end):
            entrance[blocks[k]] = costs[blocks[k]]
        i = now
        while i < end:
            cell = np.uint64(blocks[i])
            i += one
            left, right, down, up = cell - one, cell + one, cell - across, cell + across
            at_left, at_right, at_down, at_up = field[left], field[right], field[down], field[up]
            here = _front(at_left, at_right, at_down, at_up, np.float32(costs[cell]))
            if here < field[cell]:
                field[cell] = here
                sooner = here < threshold
                n = end_soon if sooner else end_later
                n = _add_if_lower(left, at_left, here, aside, entrance, blocks, n)
                n = _add_if_lower(right, at_right, here, aside, entrance, blocks, n)
                n = _add_if_lower(down, at_down, here, aside, entrance, blocks, n)
                n = _add_if_lower(up, at_up, here, aside, entrance, blocks, n)
                end_soon, end_later = n if sooner else end_soon, end_later if sooner else n
        now, soon, end, end_soon = soon, now, end_soon, now
        if end == now:
            threshold = np.float32(threshold + rise)
            now, later, end, end_later = later, now, end_later, now
        if last >= 0 and field[last] < UNREACHED:
            break
    return field


@kernel
def _is_reached_around(field: Singles, columns: int, cell: int) -> bool:
    """Return True if the cell and its eight neighbours are reached."""
    for line in (cell - columns, cell, cell + columns):
        if max(field[line - 1], field[line], field[line + 1]) >= UNREACHED:
            return False
    return True


@kernel
def _lowest_beside(field: Singles, columns: int, cell: int) -> int:
    """Return the cell with the lowest potential of the nine, compared as integers as in the original."""
    lowest, best = np.floor(field[cell]), cell
    for line in (cell - columns, cell, cell + columns):
        for near in (line - 1, line, line + 1):
            if field[near] < lowest:
                lowest, best = np.floor(field[near]), near
    return best


@kernel
def _slope(field: Singles, columns: int, cell: int) -> tuple[float, float]:
    """Return the direction, right and up, of descent at a reached cell: of length 1, or 0."""
    here, right, up = np.float64(field[cell]), 0.0, 0.0
    if field[cell - 1] < UNREACHED:
        right += field[cell - 1] - here
    if field[cell + 1] < UNREACHED:
        right += here - field[cell + 1]
    if field[cell - columns] < UNREACHED:
        up += field[cell - columns] - here
    if field[cell + columns] < UNREACHED:
        up += here - field[cell + columns]
    length = np.sqrt(right * right + up * up)
    if length > 0:
        return right / length, up / length
    return 0.0, 0.0


@kernel
def _interpolated(field: Singles, columns: int, cell: int, right: float, up: float) -> tuple[float, float]:
    """Return the slope between the cell and its neighbours right and up, by bilinear interpolation."""
    a, b = _slope(field, columns, cell), _slope(field, columns, cell + 1)
    c, d = _slope(field, columns, cell + columns), _slope(field, columns, cell + columns + 1)
    x = (1.0 - up) * ((1.0 - right) * a[0] + right * b[0]) + up * ((1.0 - right) * c[0] + right * d[0])
    y = (1.0 - up) * ((1.0 - right) * a[1] + right * b[1]) + up * ((1.0 - right) * c[1] + right * d[1])
    return x, y


@kernel
def _rounded(value: float) -> int:
    """Return the nearest integer, ties away from 0."""
    return int(value + 0.5) if value >= 0 else -int(0.5 - value)


@kernel
def _steepest_descent(field: Singles, columns: int, cell: int, neutral: float, most: int) -> Floats:
    # after `most` points, which are normally enough, go from cell to cell, each lower than the one before
    points = np.empty((2 * most, 2))
    right, up = 0.0, 0.0
    count = 0
    while True:
        nearest = cell + _rounded(right) + columns * _rounded(up)
        if field[nearest] < neutral:
            points[count, 0], points[count, 1] = nearest // columns, nearest % columns
            return points[: count + 1].copy()
        points[count, 0], points[count, 1] = cell // columns + up, cell % columns + right
        count += 1
        back_and_forth = (
            count > 2
            and points[count - 1, 0] == points[count - 3, 0]
            and points[count - 1, 1] == points[count - 3, 1]
        )
        x, y = 0.0, 0.0
        if count < most and not back_and_forth and _is_reached_around(field, columns, cell):
            x, y = _interpolated(field, columns, cell, right, up)
        length = np.sqrt(x * x + y * y)
        if length == 0.0:
            cell, right, up = _lowest_beside(field, columns, cell), 0.0, 0.0
            continue
        right += x * _STEP / length
        up += y * _STEP / length
        if right > 1.0:
            cell, right = cell + 1, right - 1.0
        elif right < -1.0:
            cell, right = cell - 1, right + 1.0
        if up > 1.0:
            cell, up = cell + columns, up - 1.0
        elif up < -1.0:
            cell, up = cell - columns, up + 1.0


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    row, column = np.indices((19, 27), dtype=np.int32)
    ours = np.where((row * 5 + column * column * 3) % 7 < 5, 10 + (row * column) % 13, 0).astype(np.int32)
    ours[9], ours[0] = 10, 11
    row, column = np.indices((21, 33))
    costs = np.where((row * 5 + column * column * 3) % 7 < 6, 50 + (row * column * 7) % 200, IMPASSABLE)
    costs[:, 4] = costs[10] = 50
    costs[[0, -1]] = costs[:, [0, -1]] = IMPASSABLE
    navfn = costs.astype(np.uint8)
    for shared in (ours, navfn):
        shared.setflags(write=False)  # like those of the robot, to compile the variants that it calls
    field, near, goal = potential(ours, 9, 0), wave(navfn, (10, 4), 50, (12, 28)), wave(navfn, (10, 4), 50)
    parts = field, descent(ours, field, 9, 26), goal, steepest_descent(goal, 10, 30, 50), near
    return b"".join(part.tobytes() for part in parts)
