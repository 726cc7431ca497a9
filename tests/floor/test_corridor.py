"""The committed map: it is what the script draws, and has the measures of the original testbed."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from actors.floor.grid import OCCUPIED, OccupancyGrid, largest_region, outline, reachable
from actors.floor.map_file import load_map
from actors.geometry import Point

MAPS = Path(__file__).parents[2] / "maps"
PIXEL = 0.03125
CORRIDOR = Point(15.0, 11.0)


@pytest.fixture(scope="module")
def grid() -> OccupancyGrid:
    return load_map(MAPS / "corridor.yaml")


@pytest.fixture(scope="module")
def floor(grid: OccupancyGrid) -> NDArray[np.bool_]:
    return reachable(grid, CORRIDOR)


def width(line: NDArray[np.bool_], at: int) -> float:
    """Length, m, of the run of True in `line` around the index `at`."""
    assert line[at]
    blocked = np.flatnonzero(~line)
    begin = np.searchsorted(blocked, at)
    return float(blocked[begin] - blocked[begin - 1] - 1) * PIXEL


def test_drawing_again_gives_the_committed_files(tmp_path: Path) -> None:
    runpy.run_path(str(MAPS / "draw_corridor.py"))["main"](tmp_path)
    drawn = np.asarray(Image.open(tmp_path / "corridor.png"))
    assert np.array_equal(drawn, np.asarray(Image.open(MAPS / "corridor.png")))
    assert (tmp_path / "corridor.yaml").read_text() == (MAPS / "corridor.yaml").read_text()


def test_size_and_place(grid: OccupancyGrid) -> None:
    assert (grid.columns, grid.rows, grid.resolution) == (941, 474, PIXEL)
    assert grid.origin == Point(0.0, 0.0)


def test_the_floor_has_the_area_of_the_original_and_is_all_that_is_free(
    grid: OccupancyGrid, floor: NDArray[np.bool_]
) -> None:
    assert floor.sum() * PIXEL**2 == pytest.approx(152.64, rel=0.01)
    assert np.array_equal(floor, grid.free), "one region, nothing free behind a wall"
    assert np.array_equal(floor, largest_region(grid))


def test_the_walls_are_closed_and_at_least_3_pixels_thick(
    grid: OccupancyGrid, floor: NDArray[np.bool_]
) -> None:
    near = ndimage.binary_dilation(np.pad(floor, 3), iterations=3, structure=np.ones((3, 3), dtype=np.bool_))
    beyond = near & ~np.pad(floor, 3)
    assert beyond.sum() == (np.pad(grid.cells, 3)[beyond] == OCCUPIED).sum()


@pytest.mark.parametrize("x", [12.4, 17.2])
def test_the_passages_to_the_offices(floor: NDArray[np.bool_], x: float) -> None:
    column = int(x / PIXEL)
    widths = [width(floor[row], column) for row in range(int(8.4 / PIXEL), int(10.35 / PIXEL))]
    assert min(widths) == pytest.approx(0.88, abs=PIXEL)
    assert max(widths) == pytest.approx(1.03, abs=PIXEL)


@pytest.mark.parametrize("x", [5.3, 14.8, 24.3])
def test_the_corridor_at_the_cabinets(floor: NDArray[np.bool_], x: float) -> None:
    assert width(floor[:, int(x / PIXEL)], int(11.0 / PIXEL)) == pytest.approx(1.50, abs=PIXEL)


@pytest.mark.parametrize("x", [10.0, 15.5, 20.0])
def test_the_corridor_elsewhere(floor: NDArray[np.bool_], x: float) -> None:
    assert width(floor[:, int(x / PIXEL)], int(11.0 / PIXEL)) == pytest.approx(3.43, abs=PIXEL)


def test_the_kitchen_door(floor: NDArray[np.bool_]) -> None:
    assert width(floor[:, int(1.65 / PIXEL)], int(12.1 / PIXEL)) == pytest.approx(0.75, abs=PIXEL)


@pytest.mark.parametrize(
    ("x0", "y0", "x1", "y1"),
    [
        (11.50, 1.00, 13.50, 7.00),
        (16.50, 1.00, 18.25, 7.00),
        (2.25, 11.10, 4.75, 13.75),
        (6.25, 11.10, 14.25, 13.75),
        (15.75, 11.10, 23.75, 13.75),
        (25.25, 11.10, 28.75, 13.75),
    ],
)
def test_the_areas_of_the_original_testbed_are_floor(
    floor: NDArray[np.bool_], x0: float, y0: float, x1: float, y1: float
) -> None:
    area = floor[round(y0 / PIXEL) : round(y1 / PIXEL), round(x0 / PIXEL) : round(x1 / PIXEL)]
    assert area.mean() > 0.99, "but for a pillar's edge or a recess"


@pytest.mark.parametrize(
    "pillar", [(7.64, 13.89), (12.45, 13.92), (17.36, 13.83), (21.95, 13.95), (26.45, 13.89)]
)
def test_the_pillars(grid: OccupancyGrid, pillar: tuple[float, float]) -> None:
    x, y = pillar
    assert not grid.is_free(Point(x, y))
    for dx, dy in ((0.2, 0.0), (-0.2, 0.0), (0.0, 0.2), (0.0, -0.2)):
        assert grid.is_free(Point(x + dx, y + dy))


def test_the_outline_is_short_enough_for_physics_and_on_the_walls(grid: OccupancyGrid) -> None:
    segments = outline(grid)
    assert len(segments) < 1000
    assert [0.09375, 11.59375, 0.09375, 13.3125] in segments.tolist(), "the kitchen's west wall"
