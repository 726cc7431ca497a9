"""Kernels: straight lines over a grid, from border to border of squares of equal cells.

The traversal of Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987,
but in leaps over squares, not cells: it meets the same cell at the same point. All lengths are in cells.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit

MOST_SIDE: Final = 255
"""No square is larger, cells: its side has one byte."""


class Ray(NamedTuple):
    """A line from a point along a unit vector."""

    x: float
    y: float
    dx: float
    dy: float
    per_x: float
    """So far along it one goes to get 1 further in x; negative westward."""
    per_y: float
    quadrant: int
    """Which squares it leaps over: bit 0 set if it goes westward, bit 1 if southward."""


class Square(NamedTuple):
    """A square that a ray is in, and where it leaves that."""

    left: int
    bottom: int
    side: int
    border_x: int
    """Column of the border ahead of it,"""
    border_y: int
    """and row."""
    to_x: float
    """Where on the ray it meets the one,"""
    to_y: float
    """and where the other: it leaves by the nearer one."""


def equal_squares(kinds: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """How far a ray may leap: (4, rows, columns) for (rows, columns) of kinds of cells.

    For each cell and each quadrant of directions (bit 0 set: westward, bit 1 set: southward) the side, in
    cells, of the largest square of one kind that has the cell in its near corner; MOST_SIDE at most.
    """
    squares = np.empty((4, *kinds.shape), np.uint8)
    _equal_squares(kinds, squares)
    return squares


def free_squares(blocking: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """The same over free cells only: (4, rows + 2, columns + 2), as a ring of blocking cells is laid around.

    0 in a blocking cell.
    """
    ringed = np.ones((blocking.shape[0] + 2, blocking.shape[1] + 2), np.uint8)
    ringed[1:-1, 1:-1] = blocking
    squares = equal_squares(ringed)
    squares[:, ringed != 0] = 0
    return squares


@njit(cache=True)  # type: ignore[untyped-decorator]
def ray(x: float, y: float, dx: float, dy: float) -> Ray:
    """The ray from (x, y) along the unit vector (dx, dy)."""
    per_x = 1 / dx if dx != 0 else 1e300
    per_y = 1 / dy if dy != 0 else 1e300
    return Ray(x, y, dx, dy, per_x, per_y, quadrant(dx, dy))


@njit(cache=True)  # type: ignore[untyped-decorator]
def quadrant(dx: float, dy: float) -> int:
    """`Ray.quadrant` of a direction."""
    return (0 if dx >= 0 else 1) + (0 if dy >= 0 else 2)


@njit(cache=True)  # type: ignore[untyped-decorator]
def square_at(ray: Ray, column: int, row: int, side: int) -> Square:
    """The square of that side, ≥ 1, with its near corner in the cell where the ray is."""
    east, north = ray.dx >= 0, ray.dy >= 0
    left = column if east else column - side + 1
    bottom = row if north else row - side + 1
    border_x = left + side if east else left
    border_y = bottom + side if north else bottom
    to_x, to_y = (border_x - ray.x) * ray.per_x, (border_y - ray.y) * ray.per_y
    return Square(left, bottom, side, border_x, border_y, to_x, to_y)


@njit(cache=True)  # type: ignore[untyped-decorator]
def cell_after(ray: Ray, square: Square, distance: float) -> tuple[int, int]:
    """Column and row of the cell that the ray enters as it leaves the square, so far from its start.

    Rounding must not carry the ray out of the square anywhere but through the border that it meets.
    """
    left, bottom, last = square.left, square.bottom, square.side - 1
    if square.to_x < square.to_y:
        column = square.border_x if ray.dx >= 0 else square.border_x - 1
        return column, min(max(int(ray.y + distance * ray.dy), bottom), bottom + last)
    row = square.border_y if ray.dy >= 0 else square.border_y - 1
    return min(max(int(ray.x + distance * ray.dx), left), left + last), row


@njit(cache=True)  # type: ignore[untyped-decorator]
def _equal_squares(kinds: NDArray[np.uint8], squares: NDArray[np.uint8]) -> None:
    rows, columns = kinds.shape
    for quadrant in range(4):
        east = 1 if quadrant & 1 == 0 else -1
        north = 1 if quadrant & 2 == 0 else -1
        for a in range(rows):
            row = rows - 1 - a if north > 0 else a
            for b in range(columns):
                column = columns - 1 - b if east > 0 else b
                side = 0
                if a > 0 and b > 0:
                    kind = kinds[row, column]
                    if (
                        kinds[row + north, column] == kind
                        and kinds[row, column + east] == kind
                        and kinds[row + north, column + east] == kind
                    ):
                        side = min(
                            squares[quadrant, row + north, column],
                            squares[quadrant, row, column + east],
                            squares[quadrant, row + north, column + east],
                        )
                squares[quadrant, row, column] = min(side, MOST_SIDE - 1) + 1
