"""Distances and clearances compared with scipy; free squares for ray casting."""

import math
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy import ndimage

from actors.floor import raster, raster_arrays
from actors.floor.grid import Cell, OccupancyGrid, SharedCache
from actors.floor.map_file import load_map
from actors.floor.raster import bearing_to, equal_squares, free_squares, half_width, window
from actors.geometry import Point
from actors.robot.localisation import likelihood_field
from actors.robot.navigation.planning import PLANNER_PRESETS, planning_grid
from tests.floor.maps import plan, random_plan

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


def brute_clearance(grid: OccupancyGrid, point: Point) -> float:
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
    lattice = np.ones((2 * grid.rows + 3, 2 * grid.columns + 3), dtype=np.bool_)
    lattice[2:-2, 2:-2] = False
    for row, column in np.argwhere(grid.blocking):
        lattice[2 * row + 1 : 2 * row + 4, 2 * column + 1 : 2 * column + 4] = True
    lattice[1:-1, [1, -2]] = lattice[[1, -2], 1:-1] = True
    half_cells: NDArray[np.float64] = ndimage.distance_transform_edt(~lattice)[2:-2:2, 2:-2:2]
    return half_cells * grid.resolution / 2


@given(st.integers(0, 2**32), st.integers(1, 30), st.integers(1, 30), st.floats(0.0, 0.5))
def test_squared_distance_is_that_of_scipy(seed: int, rows: int, columns: int, share: float) -> None:
    mask = np.random.default_rng(seed).random((rows, columns)) < share
    mask[0, 0] = True  # scipy has no answer for an empty mask
    nearest = ndimage.distance_transform_edt(~mask, return_distances=False, return_indices=True)
    exact = ((np.indices(mask.shape) - nearest) ** 2).sum(axis=0)
    assert np.array_equal(raster._squared_distance(mask), exact)
    assert np.array_equal(raster_arrays.squared_distance(mask), exact)
    limited = raster_arrays.squared_distance(mask, 10)
    assert np.array_equal(np.minimum(limited, 10), np.minimum(exact, 10))


@pytest.mark.parametrize("squared_distance", [raster._squared_distance, raster_arrays.squared_distance])
def test_the_distance_without_true_cells_is_infinite(
    squared_distance: Callable[[NDArray[np.bool_]], NDArray[np.float64]],
) -> None:
    assert np.isposinf(squared_distance(np.zeros((3, 4), dtype=np.bool_))).all()


def assert_arrays_have_the_results_of_kernels(mask: NDArray[np.bool_]) -> None:
    ringed = np.pad(mask, 1, constant_values=True)
    labels, largest = raster._regions(mask)
    found, most = raster_arrays.regions(mask)
    assert (found.tobytes(), found.dtype, most) == (labels.tobytes(), labels.dtype, largest)
    for name in ("squared_clearance", "squared_distance"):
        one, other = getattr(raster_arrays, name)(ringed), getattr(raster, f"_{name}")(ringed)
        assert (one.tobytes(), one.dtype) == (other.tobytes(), other.dtype)


@given(st.integers(0, 2**32), st.integers(1, 30), st.integers(1, 30), st.floats(0.0, 1.0))
def test_arrays_have_the_results_of_kernels(seed: int, rows: int, columns: int, share: float) -> None:
    assert_arrays_have_the_results_of_kernels(np.random.default_rng(seed).random((rows, columns)) < share)


@pytest.mark.parametrize("name", sorted(path.stem for path in CORRIDOR.parent.glob("*.yaml")))
def test_arrays_have_the_results_of_kernels_on_maps(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = load_map(CORRIDOR.with_name(f"{name}.yaml"))
    assert_arrays_have_the_results_of_kernels(grid.blocking)
    seed = Cell(*map(int, np.argwhere(grid.free)[0]))
    compiled = raster.clearance(grid.blocking, grid.resolution), raster.flood(grid.free, *seed)
    monkeypatch.delitem(sys.modules, "numba")
    found = raster.clearance(grid.blocking, grid.resolution), raster.flood(grid.free, *seed)
    assert [one.tobytes() for one in found] == [one.tobytes() for one in compiled]
    assert not raster.flood(grid.free, *np.argwhere(grid.blocking)[0]).any()


@given(st.integers(0, 2**32), st.integers(1, 30), st.integers(1, 30), st.floats(0.0, 0.6))
def test_clearance_is_that_of_scipy_on_half_cells(seed: int, rows: int, columns: int, share: float) -> None:
    grid = random_plan(seed, rows, columns, share)
    assert np.array_equal(raster.clearance(grid.blocking, grid.resolution), scipy_clearance(grid))


@given(st.integers(0, 2**32), st.floats(-3.2, 0.5), st.floats(7.3, 10.0), st.floats(0.01, 2.0))
def test_clearance_of_a_point_is_exact_up_to_a_limit(seed: int, x: float, y: float, within: float) -> None:
    grid = random_plan(seed, 9, 13, 0.05)
    point = Point(x, y)
    expected = min(within, brute_clearance(grid, point)) if grid.is_free(point) else 0.0
    assert grid.clearance_at(point, within) == pytest.approx(expected, abs=1e-12)


def test_squares_are_of_one_material_or_free_and_cannot_grow() -> None:
    kinds = np.random.default_rng(1).choice(2, size=(17, 19), p=[0.9, 0.1]).astype(np.uint8)
    ringed = np.pad(kinds, 1, constant_values=1)
    equal, free = equal_squares(kinds), free_squares(kinds.astype(np.bool_))
    for quadrant, row, column in np.ndindex(equal.shape):
        side = int(equal[quadrant, row, column])
        assert _uniform(kinds, quadrant, row, column, side)
        assert not _uniform(kinds, quadrant, row, column, side + 1)
    for quadrant, row, column in np.ndindex(free.shape):
        side = int(free[quadrant, row, column])
        assert (side == 0) == (ringed[row, column] == 1)
        assert not side or _uniform(ringed, quadrant, row, column, side)
        assert not side or not _uniform(ringed, quadrant, row, column, side + 1)


def _uniform(kinds: NDArray[np.uint8], quadrant: int, row: int, column: int, side: int) -> bool:
    left = column - side + 1 if quadrant & 1 else column
    bottom = row - side + 1 if quadrant & 2 else row
    if left < 0 or bottom < 0 or left + side > kinds.shape[1] or bottom + side > kinds.shape[0]:
        return False
    square = kinds[bottom : bottom + side, left : left + side]
    return bool((square == kinds[row, column]).all())


COORDINATES = st.floats(-5, 5)


@given(COORDINATES, COORDINATES, st.floats(0.05, 1), st.floats(-4, 4), st.floats(-3.2, 0), st.integers(2, 90))
def test_no_ray_outside_of_the_windows_meets_the_disc(
    x: float, y: float, radius: float, heading: float, first_angle: float, rays: int
) -> None:
    apart, increment = math.hypot(x, y), 2 * math.pi / rays
    assume(apart > 1e-6)
    bearing, half = bearing_to(x, y, heading, first_angle), half_width(apart, radius)
    windows = [window(bearing, half, turn, increment, rays) for turn in (-1, 0, 1)]
    inside = {ray for begin, end in windows for ray in range(begin, end)}
    assert inside <= set(range(rays))
    if apart > 2 * radius:
        assert len(inside) <= 2 * half / increment + 6, "few rays meet a narrow thing"
    for ray in set(range(rays)) - inside:
        away = math.remainder(heading + first_angle + ray * increment - math.atan2(y, x), 2 * math.pi)
        assert apart > radius
        assert abs(away) > math.asin(radius / apart)


class Thing:
    """A value that can be weakly referenced."""


def test_a_value_is_shared_while_it_lives() -> None:
    shared, made = SharedCache[Thing](), list[str]()

    def make() -> Thing:
        made.append("made")
        return Thing()

    first = shared.get(("a", 1), make)
    assert shared.get(("a", 1), make) is first is not shared.get(("a", 2), make)
    assert len(made) == 2
    del first
    shared.get(("a", 1), make)
    assert len(made) == 3


def test_grids_have_the_same_content_if_cells_resolution_and_origin_are_the_same() -> None:
    one = plan("..#", "...")
    assert plan("..#", "...").content == one.content
    others = [plan("..?", "..."), plan("..", "#.", ".."), plan("..#", "...", resolution=2.0)]
    others += [plan("..#", "...", origin=Point(0.0, 1.0))]
    assert not any(other.content == one.content for other in others)


def test_every_copy_of_a_map_is_one_grid(tmp_path: Path) -> None:
    for folder in (tmp_path / "r1", tmp_path / "r2"):
        shutil.copytree(CORRIDOR.parent, folder)
    first = load_map(tmp_path / "r1" / "corridor.yaml")
    assert load_map(tmp_path / "r2" / "corridor.yaml") is first
    text = (tmp_path / "r2" / "corridor.yaml").read_text()
    (tmp_path / "r2" / "corridor.yaml").write_text(text.replace("negate: 0", "negate: 1"))
    assert load_map(tmp_path / "r2" / "corridor.yaml") is not first
    shutil.copy(tmp_path / "r2" / "maze.png", tmp_path / "r1" / "corridor.png")
    assert load_map(tmp_path / "r1" / "corridor.yaml") is not first


def test_equal_grids_have_one_ground_and_one_field_for_equal_parameters() -> None:
    grid = load_map(CORRIDOR)
    twin = OccupancyGrid(grid.cells, grid.resolution, grid.origin)
    floor, field = planning_grid(grid, 0.2, PLANNER_PRESETS["robust"]), likelihood_field(grid, 2.0)
    assert planning_grid(twin, 0.2, PLANNER_PRESETS["robust"]) is floor
    assert likelihood_field(twin, 2.0) is field
    assert planning_grid(twin, 0.25) is not floor
    assert planning_grid(twin, 0.2, replace(PLANNER_PRESETS["robust"], margin=0.04)) is not floor
    assert likelihood_field(twin, 1.0) is not field
    assert not any(part.flags.writeable for part in (floor.clearance, floor.costs, field.levels, field.floor))
