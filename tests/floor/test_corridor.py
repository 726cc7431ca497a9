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


def test_drawing_again_gives_the_committed_files(tmp_path: Path) -> None:
    runpy.run_path(str(MAPS / "draw_corridor.py"))["main"](tmp_path)
    drawn = np.asarray(Image.open(tmp_path / "corridor.png"))
    assert np.array_equal(drawn, np.asarray(Image.open(MAPS / "corridor.png")))
    assert (tmp_path / "corridor.yaml").read_text() == (MAPS / "corridor.yaml").read_text()


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


def test_the_outline_is_short_enough_for_physics_and_on_the_walls(grid: OccupancyGrid) -> None:
    segments = outline(grid)
    assert len(segments) < 1000
    assert [0.09375, 11.59375, 0.09375, 13.3125] in segments.tolist(), "the kitchen's west wall"
