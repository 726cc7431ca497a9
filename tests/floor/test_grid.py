import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from actors.floor import raster
from actors.floor.grid import Cell, OccupancyGrid, largest_region, nearest_cell, outline, reachable
from actors.geometry import Point
from tests.floor.maps import plan, random_plan


def test_row_0_is_the_south_and_the_origin_its_west_corner() -> None:
    grid = plan("#..", "?.#", resolution=0.5, origin=Point(10.0, -2.0))
    assert grid.corner == Point(11.5, -1.0)
    assert grid.cell(Point(10.1, -1.9)) == Cell(0, 0)
    assert grid.cell(Point(11.4, -1.1)) == Cell(1, 2)
    assert grid.centre(Cell(1, 2)) == Point(11.25, -1.25)
    assert grid.is_free(Point(10.75, -1.75)) and grid.is_free(Point(11.4, -1.1))
    assert not grid.is_free(Point(10.1, -1.9)), "unknown is not free"
    assert not grid.is_free(Point(10.1, -1.1)) and not grid.is_free(Point(11.4, -1.9))
    grid = plan("..", "..")
    assert grid.cell(Point(1.0, 1.0)) == Cell(1, 1)
    assert grid.contains(Point(0.0, 0.0))
    for point in (Point(2.0, 1.0), Point(1.0, 2.0), Point(-1e-9, 1.0), Point(1.0, -1e-9)):
        assert not grid.contains(point)
        assert not grid.is_free(point)
    assert not grid.contains(Point(float("nan"), 0.0))
    assert not grid.contains(Point(float("inf"), 0.0))


@given(*[st.integers(0, 999)] * 2, st.floats(0.01, 1.0), *[st.floats(-1000, 1000)] * 2)
def test_centre_of_a_cell_lies_in_it(row: int, column: int, resolution: float, x: float, y: float) -> None:
    grid = OccupancyGrid(np.zeros((1000, 1000), dtype=np.uint8), resolution, Point(x, y))
    assert grid.cell(grid.centre(Cell(row, column))) == Cell(row, column)
    xs, ys = grid.centres()
    assert Point(xs[column], ys[row]) == grid.centre(Cell(row, column))


def test_a_grid_keeps_a_read_only_copy() -> None:
    cells = np.zeros((2, 2), dtype=np.uint8)
    grid = OccupancyGrid(cells, 1.0)
    cells[0, 0] = 2
    assert grid.is_free(Point(0.5, 0.5))
    assert grid.clearance is grid.clearance
    assert np.array_equal(grid.clearance, raster.clearance(grid.blocking, grid.resolution))
    for part in (grid.cells, grid.clearance):
        with pytest.raises(ValueError, match="read-only"):
            part[0, 0] = 2
    assert not largest_region(plan("##", "?#")).any()


def test_reachable_floor_depends_on_the_radius() -> None:
    grid = plan("...#...", ".......", "...#...")
    assert reachable(grid, Point(0.5, 1.5), 0.5).sum() == 19
    wide = reachable(grid, Point(1.5, 1.5), 0.6)
    assert wide.tolist() == plan("#######", "#..####", "#######").free.tolist()
    assert not reachable(grid, Point(0.5, 1.5), 0.6).any(), "half a metre from the border"


@given(st.integers(0, 2**32), st.floats(0.2, 0.6))
def test_regions_are_those_of_scipy(seed: int, share: float) -> None:
    grid = random_plan(seed, 17, 23, share)
    labels, regions = ndimage.label(grid.free)
    sizes = np.bincount(labels.ravel(), minlength=2)[1:]
    assert largest_region(grid).sum() == sizes.max()
    for region in range(1, regions + 1):
        row, column = np.argwhere(labels == region)[0]
        assert np.array_equal(reachable(grid, grid.centre(Cell(row, column))), labels == region)
    first = np.argmax(sizes) + 1  # scipy counts regions in row order, too
    assert np.array_equal(largest_region(grid), labels == first)
    for row, column in np.argwhere(grid.blocking)[:3]:
        assert not reachable(grid, grid.centre(Cell(row, column))).any()
    assert not reachable(grid, Point(-4.0, 8.0)).any(), "outside"


@given(st.integers(0, 40), st.floats(-4, 2), st.floats(6, 14), st.sampled_from([0.0, 0.3, 1.0, 9.0]))
def test_nearest_cell(seed: int, x: float, y: float, within: float) -> None:
    grid, point = random_plan(seed, 20, 16, 0.9), Point(x, y)
    found = nearest_cell(grid, grid.free, point, within)
    if grid.is_free(point):
        assert found == grid.cell(point)
        return
    free = [Cell(int(row), int(column)) for row, column in np.argwhere(grid.free)]
    gaps = {cell: grid.centre(cell).distance_to(point) for cell in free}
    if found is None:
        assert min(gaps.values(), default=np.inf) > within - 1e-9
    else:
        assert gaps[found] <= within + 1e-9
        assert gaps[found] == pytest.approx(min(gaps.values()))
    anywhere = nearest_cell(grid, grid.free, point)
    assert (anywhere is None) == (not gaps)


@given(st.integers(0, 2**32), st.floats(0.0, 1.0))
def test_the_outline_is_every_edge_between_free_and_blocking_once(seed: int, share: float) -> None:
    grid = random_plan(seed, 7, 9, share)
    expected = []
    for row in range(-1, grid.rows + 1):
        for column in range(-1, grid.columns + 1):
            here = grid.is_free(grid.centre(Cell(row, column)))
            if here != grid.is_free(grid.centre(Cell(row + 1, column))):
                expected.append((column, row + 1, column + 1, row + 1))
            if here != grid.is_free(grid.centre(Cell(row, column + 1))):
                expected.append((column + 1, row, column + 1, row + 1))
    lines = (outline(grid) - np.array([*grid.origin, *grid.origin])) / grid.resolution
    unit = []
    for x0, y0, x1, y1 in lines.round().astype(int).tolist():
        unit += [(x, y0, x + 1, y0) for x in range(x0, x1)] + [(x0, y, x0, y + 1) for y in range(y0, y1)]
    assert sorted(unit) == sorted(expected)
    ends = {(x0, y0) for x0, y0, x1, y1 in lines.tolist() if y0 == y1}
    assert not [1 for x0, y0, x1, y1 in lines.tolist() if y0 == y1 and (x1, y1) in ends], "not maximal"
