"""Distances and clearances beside scipy, and free squares for ray casting."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage

from actors.floor import distance, flood
from actors.floor.grid import Cell, OccupancyGrid
from actors.floor.traversal import equal_squares, free_squares
from actors.geometry import Point
from tests.floor.plans import plan, random_plan
from tests.world.scenery import clutter


def brute_clearance(grid: OccupancyGrid, point: Point) -> float:
    """The plain twin: over all blocking squares, a ring of them around the map included."""
    nearest = math.inf
    for row in range(-1, grid.rows + 1):
        for column in range(-1, grid.columns + 1):
            centre = grid.centre(Cell(row, column))
            if not grid.is_free(centre):
                dx = max(abs(point.x - centre.x) - grid.resolution / 2, 0.0)
                dy = max(abs(point.y - centre.y) - grid.resolution / 2, 0.0)
                nearest = min(nearest, math.hypot(dx, dy))
    return nearest


def scipy_clearance(grid: OccupancyGrid) -> NDArray[np.float64]:
    """scipy's transform on the lattice of half cells, where a square's whole border blocks."""
    lattice = np.ones((2 * grid.rows + 3, 2 * grid.columns + 3), dtype=np.bool_)
    lattice[2:-2, 2:-2] = False
    for row, column in np.argwhere(grid.blocking):
        lattice[2 * row + 1 : 2 * row + 4, 2 * column + 1 : 2 * column + 4] = True
    lattice[1:-1, [1, -2]] = lattice[[1, -2], 1:-1] = True
    half_cells: NDArray[np.float64] = ndimage.distance_transform_edt(~lattice)[2:-2:2, 2:-2:2]
    return half_cells * grid.resolution / 2


def test_a_cell_beside_a_wall_has_half_a_cell_of_clearance() -> None:
    grid = plan(
        ".....",
        ".....",
        "..#..",
        ".....",
        ".....",
        resolution=2.0,
    )
    root = math.sqrt(0.5) * 2.0
    assert distance.clearance(grid.blocking, grid.resolution).tolist() == [
        [1.0, 1.0, 1.0, 1.0, 1.0],
        [1.0, root, 1.0, root, 1.0],
        [1.0, 1.0, 0.0, 1.0, 1.0],
        [1.0, root, 1.0, root, 1.0],
        [1.0, 1.0, 1.0, 1.0, 1.0],
    ]


@given(st.integers(0, 2**32), st.integers(1, 30), st.integers(1, 30), st.floats(0.0, 0.5))
def test_the_squared_distance_is_exactly_that_of_scipy(
    seed: int, rows: int, columns: int, share: float
) -> None:
    mask = np.random.default_rng(seed).random((rows, columns)) < share
    mask[0, 0] = True  # scipy has no answer for an empty mask
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    exact = ((np.indices(mask.shape) - nearest) ** 2).sum(axis=0)
    assert np.array_equal(distance.squared_distance(mask), exact)


def test_without_a_cell_to_measure_to_the_distance_is_infinite() -> None:
    assert np.isposinf(distance.squared_distance(np.zeros((3, 4), dtype=np.bool_))).all()


def test_a_column_without_a_cell_is_measured_across() -> None:
    mask = np.zeros((2, 4), dtype=np.bool_)
    mask[1, 3] = True
    assert distance.squared_distance(mask).tolist() == [[10, 5, 2, 1], [9, 4, 1, 0]]


@given(st.integers(0, 2**32), st.integers(1, 30), st.integers(1, 30), st.floats(0.0, 0.6))
def test_the_clearance_is_that_of_scipy_on_half_cells(
    seed: int, rows: int, columns: int, share: float
) -> None:
    grid = random_plan(seed, rows, columns, share)
    assert np.array_equal(distance.clearance(grid.blocking, grid.resolution), scipy_clearance(grid))


@pytest.mark.parametrize("seed", range(5))
def test_the_clearance_is_the_distance_to_the_nearest_square(seed: int) -> None:
    grid = random_plan(seed, 9, 13, 0.1)
    field = distance.clearance(grid.blocking, grid.resolution)
    for row, column in np.ndindex(field.shape):
        expected = brute_clearance(grid, grid.centre(Cell(row, column)))
        assert field[row, column] == pytest.approx(expected, abs=1e-12)


@given(st.integers(0, 2**32), st.floats(-3.2, 0.5), st.floats(7.3, 10.0), st.floats(0.01, 2.0))
def test_the_clearance_of_a_point_is_exact_up_to_what_was_asked(
    seed: int, x: float, y: float, within: float
) -> None:
    grid = random_plan(seed, 9, 13, 0.05)
    point = Point(x, y)
    expected = min(within, brute_clearance(grid, point)) if grid.is_free(point) else 0.0
    assert grid.clearance_at(point, within) == pytest.approx(expected, abs=1e-12)


def test_fingerprints_depend_on_nothing_but_the_machine() -> None:
    assert distance.fingerprint() == distance.fingerprint()
    assert flood.fingerprint() == flood.fingerprint()
    row, column = np.indices((23, 31))
    mask = (row * 7 + column * column * 3) % 37 == 0
    first = ndimage.distance_transform_edt(~mask) ** 2
    assert np.frombuffer(distance.fingerprint(), np.float64)[: first.size].round().tolist() == [
        round(value) for value in first.ravel().tolist()
    ]


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
