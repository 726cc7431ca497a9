"""Squares that rays leap over, against looking at all their cells."""

import numpy as np
from numpy.typing import NDArray

from actors.floor.traversal import equal_squares, free_squares
from tests.world.scenery import clutter


def square(
    cells: NDArray[np.bool_], row: int, column: int, side: int, east: int, north: int
) -> NDArray[np.bool_]:
    """The square of cells that reaches from the given one to the east (or west) and north (or south)."""
    bottom = row if north > 0 else row - side + 1
    left = column if east > 0 else column - side + 1
    return cells[bottom : bottom + side, left : left + side]


def test_squares_are_the_largest_free_ones() -> None:
    grid = clutter(3, share=0.05)
    squares, ringed = free_squares(grid.blocking), np.pad(grid.blocking, 1, constant_values=True)
    rng = np.random.default_rng(0)
    for row, column in zip(rng.integers(1, 41, 150), rng.integers(1, 61, 150), strict=True):
        for quadrant, (east, north) in enumerate([(1, 1), (-1, 1), (1, -1), (-1, -1)]):
            side = 0
            while not square(ringed, row, column, side + 1, east, north).any():
                side += 1
            assert squares[quadrant, row, column] == side


def test_squares_are_of_one_material_and_cannot_grow() -> None:
    kinds = np.random.default_rng(1).choice(2, size=(17, 19), p=[0.9, 0.1]).astype(np.uint8)
    squares = equal_squares(kinds)
    for quadrant in range(4):
        for row in range(17):
            for column in range(19):
                side = int(squares[quadrant, row, column])
                assert _uniform(kinds, quadrant, row, column, side)
                assert not _uniform(kinds, quadrant, row, column, side + 1)


def _uniform(kinds: NDArray[np.uint8], quadrant: int, row: int, column: int, side: int) -> bool:
    left = column - side + 1 if quadrant & 1 else column
    bottom = row - side + 1 if quadrant & 2 else row
    if left < 0 or bottom < 0 or left + side > kinds.shape[1] or bottom + side > kinds.shape[0]:
        return False
    square = kinds[bottom : bottom + side, left : left + side]
    return bool((square == kinds[row, column]).all())
