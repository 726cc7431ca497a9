"""Kernels of global planning: how far every cell is from the goal, and the way down from a cell.

Dijkstra's algorithm with a queue of buckets (Dial, "Algorithm 360: Shortest-path forest with topological
ordering", CACM 12(11), 1969), as all costs are small whole numbers. A step leads to one of eight neighbours
and costs (5 straight, 7 diagonal) × (cost of the cell it leaves + cost of the cell it enters); diagonally
only where both cells beside the step are passable.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.array_types import Floats, Int32s, Octets, Singles
from actors.kernels import kernel

UNREACHABLE: Final = np.iinfo(np.int32).max
"""The potential of a cell from which no way leads to the goal."""
STRAIGHT: Final = 5
DIAGONAL: Final = 7
"""7/5 is within 1 % of √2."""


@kernel
def _is_step(costs: Int32s, row: int, column: int, down: int, right: int) -> bool:
    """True if the step from a passable cell ends on the grid, on a passable cell, and cuts no corner."""
    r, c = row + down, column + right
    if r < 0 or c < 0 or r >= costs.shape[0] or c >= costs.shape[1] or costs[r, c] == 0:
        return False
    return down == 0 or right == 0 or (costs[row, c] > 0 and costs[r, column] > 0)


@kernel
def potential(costs: Int32s, goal_row: int, goal_column: int) -> Int32s:
    """Cost of the cheapest way from every cell to the goal cell: (rows, columns), UNREACHABLE without one.

    `costs`: (rows, columns), > 0 of a passable cell, 0 of one that is not.
    """
    rows, columns = costs.shape
    field = np.full((rows, columns), UNREACHABLE, np.int32)
    known = field.ravel()
    if costs[goal_row, goal_column] == 0:
        return field
    # a cell waits in at most one bucket, a doubly linked list, so that a cheaper way can move it to another
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
    """Put a cell into a bucket."""
    head = buckets[slot]
    after[cell] = head
    before[cell] = -1
    if head >= 0:
        before[head] = cell
    buckets[slot] = cell


@kernel
def _unlink(buckets: Int32s, after: Int32s, before: Int32s, cell: int, slot: int) -> None:
    """Take a waiting cell out of its bucket."""
    if before[cell] >= 0:
        after[before[cell]] = after[cell]
    else:
        buckets[slot] = after[cell]
    if after[cell] >= 0:
        before[after[cell]] = before[cell]


@kernel
def descent(costs: Int32s, field: Int32s, row: int, column: int) -> Int32s:
    """The cells from (row, column) to the goal, steepest way down the potential: (n, 2) rows and columns.

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
"""The potential of a cell to which no wave came (POT_HIGH)."""
IMPASSABLE: Final = 254
"""Cost of a cell that no wave enters (COST_OBS)."""
_ASIDE: Final = 0.707106781
"""A cell is looked at again if its potential is higher than a neighbour's by so much of its cost."""
_WAITING: Final = np.uint8(255)
"""Instead of its cost: the cell is in a block, and is not to get into another one."""
_STEP: Final = 0.5
"""Length of a step down, cells (pathStep)."""


def wave(costs: Octets, root: tuple[int, int], neutral: int, until: tuple[int, int] | None = None) -> Singles:
    """The potential of the cells, 0 at `root` (row, column): (rows, columns), UNREACHED where no wave came.

    `costs`: (rows, columns), of a step through each cell; IMPASSABLE or more all along the edge, where the
    root must not be; its own cost does not matter. `neutral`: the lowest cost, of which thresholds are made.
    The wave ends as it reaches the cell `until`: potentials near that are not yet as low as they can be.
    """
    rows, columns = costs.shape
    assert 0 < root[0] < rows - 1 and 0 < root[1] < columns - 1
    last = -1 if until is None else until[0] * columns + until[1]
    start = root[0] * columns + root[1]
    return _wave(costs.ravel(), columns, start, last, 2.0 * neutral).reshape(costs.shape)


def way_down(field: Singles, row: int, column: int, neutral: int) -> Floats:
    """The steepest way from a cell that was reached to the potential's root: (n, 2), rows and columns.

    They are in cells: a point in the middle of a cell has that cell's numbers. From one to the next it is
    half a cell, beside what was not reached up to a diagonal. The first is the cell, the last the root.
    """
    columns = field.shape[1]
    most = 64 + int(4 * field[row, column] / neutral)
    return _way_down(field.ravel(), columns, row * columns + column, float(neutral), most)


@kernel
def _front(
    left: np.float32, right: np.float32, down: np.float32, up: np.float32, cost: np.float32
) -> np.float32:
    """A cell's potential from those of its four neighbours."""
    lower, other = min(left, right), min(down, up)
    if other < lower:
        lower, other = other, lower
    apart = np.float32(other - lower)
    slant = np.float64(np.float32(apart / cost))
    share = np.float32(-0.2301 * slant * slant + 0.5307 * slant + 0.7040)
    return np.float32(lower + (cost if apart >= cost else np.float32(cost * share)))


@kernel
def _wake(
    near: np.uint64,
    potential: np.float32,
    here: np.float32,
    aside: Singles,
    entrance: Octets,
    block: NDArray[np.uint32],
    count: np.uint64,
) -> np.uint64:
    """Put a neighbour whose potential one of `here` may lower into a block of `count` cells; its new count.

    Without a branch, for no processor guesses which one it is: written it is in any case, behind the last.
    """
    cost = entrance[near]
    wakes = potential > np.float32(here + aside[cost])
    entrance[near] = _WAITING if wakes else cost
    block[count] = near
    return count + np.uint64(wakes)


@kernel
def _asides() -> Singles:
    """By how much a potential must be higher than a neighbour's to be looked at again, by the cell's cost."""
    aside = np.full(256, np.inf, np.float32)
    for cost in range(IMPASSABLE):
        aside[cost] = np.float32(_ASIDE * np.float64(cost))
    return aside


@kernel
def _wave(costs: Octets, columns: int, root: int, last: int, rise: float) -> Singles:
    # cells are counted without a sign: with one, each access asks whether it counts from the end
    field = np.full(costs.size, UNREACHED, np.float32)
    entrance, aside = costs.copy(), _asides()
    # a cell waits in one block at most, so each may hold all of them, and one that does not wait
    blocks = np.empty((3, costs.size + 1), np.uint32)
    now, soon, later = blocks[0], blocks[1], blocks[2]
    threshold = np.float32(IMPASSABLE)
    none, one, across, cell = np.uint64(0), np.uint64(1), np.uint64(columns), np.uint64(root)
    here = field[cell] = np.float32(0.0)
    count, count_soon, count_later = none, none, none
    for near in (cell - one, cell + one, cell - across, cell + across):
        count = _wake(near, field[near], here, aside, entrance, now, count)
    while count > none:
        for i in range(count):
            entrance[now[i]] = costs[now[i]]
        for i in range(count):
            cell = np.uint64(now[i])
            left, right, down, up = cell - one, cell + one, cell - across, cell + across
            at_left, at_right, at_down, at_up = field[left], field[right], field[down], field[up]
            here = _front(at_left, at_right, at_down, at_up, np.float32(costs[cell]))
            if here < field[cell]:
                field[cell] = here
                sooner = here < threshold
                block, n = (soon, count_soon) if sooner else (later, count_later)
                n = _wake(left, at_left, here, aside, entrance, block, n)
                n = _wake(right, at_right, here, aside, entrance, block, n)
                n = _wake(down, at_down, here, aside, entrance, block, n)
                n = _wake(up, at_up, here, aside, entrance, block, n)
                if sooner:
                    count_soon = n
                else:
                    count_later = n
        now, soon, count, count_soon = soon, now, count_soon, none
        if count == none:
            threshold = np.float32(threshold + rise)
            now, later, count, count_later = later, now, count_later, none
        if last >= 0 and field[last] < UNREACHED:
            break
    return field


@kernel
def _is_reached_around(field: Singles, columns: int, cell: int) -> bool:
    """True if the cell and the eight around it have been reached."""
    for line in (cell - columns, cell, cell + columns):
        if max(field[line - 1], field[line], field[line + 1]) >= UNREACHED:
            return False
    return True


@kernel
def _lowest_beside(field: Singles, columns: int, cell: int) -> int:
    """The cell with the lowest potential of the nine; whole numbers decide, as in the original."""
    lowest, best = np.floor(field[cell]), cell
    for line in (cell - columns, cell, cell + columns):
        for near in (line - 1, line, line + 1):
            if field[near] < lowest:
                lowest, best = np.floor(field[near]), near
    return best


@kernel
def _slope(field: Singles, columns: int, cell: int) -> tuple[float, float]:
    """Direction, right and up, in which the potential falls at a reached cell: of length 1, or 0."""
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
    """The slope beside the cell, from those of it and of its neighbours right and up."""
    a, b = _slope(field, columns, cell), _slope(field, columns, cell + 1)
    c, d = _slope(field, columns, cell + columns), _slope(field, columns, cell + columns + 1)
    x = (1.0 - up) * ((1.0 - right) * a[0] + right * b[0]) + up * ((1.0 - right) * c[0] + right * d[0])
    y = (1.0 - up) * ((1.0 - right) * a[1] + right * b[1]) + up * ((1.0 - right) * c[1] + right * d[1])
    return x, y


@kernel
def _rounded(value: float) -> int:
    """The nearest whole number, of two the one farther from 0."""
    return int(value + 0.5) if value >= 0 else -int(0.5 - value)


@kernel
def _way_down(field: Singles, columns: int, cell: int, neutral: float, most: int) -> Floats:
    # after `most` points, of which that many are enough, from cell to cell: each lower than the one before
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
        shared.setflags(write=False)  # as those of the robot: this compiles the variants that it calls
    field, near, goal = potential(ours, 9, 0), wave(navfn, (10, 4), 50, (12, 28)), wave(navfn, (10, 4), 50)
    parts = field, descent(ours, field, 9, 26), goal, way_down(goal, 10, 30, 50), near
    return b"".join(part.tobytes() for part in parts)
