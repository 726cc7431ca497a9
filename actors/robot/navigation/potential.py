"""Kernels of global planning: how far every cell is from the goal, and the way down from a cell.

Dijkstra's algorithm with a queue of buckets (Dial, "Algorithm 360: Shortest-path forest with topological
ordering", CACM 12(11), 1969), as all costs are small whole numbers. A step leads to one of eight neighbours
and costs (5 straight, 7 diagonal) × (cost of the cell it leaves + cost of the cell it enters); diagonally
only where both cells beside the step are passable.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit

UNREACHABLE: Final = np.iinfo(np.int32).max
"""The potential of a cell from which no way leads to the goal."""
STRAIGHT: Final = 5
DIAGONAL: Final = 7
"""7/5 is within 1 % of √2."""


def potential(costs: NDArray[np.int32], goal_row: int, goal_column: int) -> NDArray[np.int32]:
    """Cost of the cheapest way from every cell to the goal cell: (rows, columns), UNREACHABLE without one.

    `costs`: (rows, columns), > 0 of a passable cell, 0 of one that is not.
    """
    field: NDArray[np.int32] = _potential(costs, goal_row, goal_column, int(costs.max()))
    return field


def descent(costs: NDArray[np.int32], field: NDArray[np.int32], row: int, column: int) -> NDArray[np.int32]:
    """The cells from (row, column) to the goal, steepest way down the potential: (n, 2) rows and columns.

    The start's potential must not be UNREACHABLE.
    """
    cells: NDArray[np.int32] = _descent(costs, field, row, column)
    return cells


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((19, 27), dtype=np.int32)
    costs = np.where((row * 5 + column * column * 3) % 7 < 5, 10 + (row * column) % 13, 0).astype(np.int32)
    costs[9], costs[0] = 10, 11
    costs.setflags(write=False)  # as the ground's: this compiles the very variant that the robot calls
    field = potential(costs, 9, 0)
    return field.tobytes() + descent(costs, field, 9, 26).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _is_step(costs: NDArray[np.int32], row: int, column: int, down: int, right: int) -> bool:
    """True if the step from a passable cell ends on the grid, on a passable cell, and cuts no corner."""
    r, c = row + down, column + right
    if r < 0 or c < 0 or r >= costs.shape[0] or c >= costs.shape[1] or costs[r, c] == 0:
        return False
    return down == 0 or right == 0 or (costs[row, c] > 0 and costs[r, column] > 0)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _potential(costs: NDArray[np.int32], goal_row: int, goal_column: int, highest: int) -> NDArray[np.int32]:
    rows, columns = costs.shape
    field = np.full((rows, columns), UNREACHABLE, np.int32)
    known = field.ravel()
    if costs[goal_row, goal_column] == 0:
        return field
    # a cell waits in at most one bucket, a doubly linked list, so that a cheaper way can move it to another
    buckets = np.full(2 * DIAGONAL * highest + 1, -1, np.int32)
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _link(
    buckets: NDArray[np.int32], after: NDArray[np.int32], before: NDArray[np.int32], cell: int, slot: int
) -> None:
    """Put a cell into a bucket."""
    head = buckets[slot]
    after[cell] = head
    before[cell] = -1
    if head >= 0:
        before[head] = cell
    buckets[slot] = cell


@njit(cache=True)  # type: ignore[untyped-decorator]
def _unlink(
    buckets: NDArray[np.int32], after: NDArray[np.int32], before: NDArray[np.int32], cell: int, slot: int
) -> None:
    """Take a waiting cell out of its bucket."""
    if before[cell] >= 0:
        after[before[cell]] = after[cell]
    else:
        buckets[slot] = after[cell]
    if after[cell] >= 0:
        before[after[cell]] = before[cell]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _descent(costs: NDArray[np.int32], field: NDArray[np.int32], row: int, column: int) -> NDArray[np.int32]:
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
