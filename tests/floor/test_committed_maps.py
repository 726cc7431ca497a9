"""Committed maps: equal to their scripts, connected, passable, with closable doors."""

import runpy
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from actors.floor import raster
from actors.floor.doors import DoorError, Doorways
from actors.floor.grid import OCCUPIED, Cell, OccupancyGrid, largest_region, outline, passable
from actors.floor.map_file import load_map
from actors.geometry import Point

MAPS = Path(__file__).parents[2] / "maps"
SIZES = {"corridor": None, "maze": (10.0, 10.0), "apartment": (16.0, 11.0), "warehouse": (24.0, 16.0)}
RADIUS = 0.177
BODY = RADIUS + 0.03
"""A robot's radius, and with the margin of planning, m."""
PIXEL = 0.03125
"""Size of the corridor's map, m."""
each = pytest.mark.parametrize("name", SIZES)
new = pytest.mark.parametrize("name", ["maze", "apartment", "warehouse"])


def grid_of(name: str) -> OccupancyGrid:
    return load_map(MAPS / f"{name}.yaml")


@pytest.mark.parametrize("script", ["draw_corridor", "draw_floors"])
def test_drawing_again_gives_the_committed_files(script: str, tmp_path: Path) -> None:
    runpy.run_path(str(MAPS / f"{script}.py"))["main"](tmp_path)
    assert {file.stem for file in tmp_path.iterdir()} <= set(SIZES)
    for drawn in tmp_path.glob("*.png"):
        assert np.array_equal(np.asarray(Image.open(drawn)), np.asarray(Image.open(MAPS / drawn.name)))
        yaml = drawn.with_suffix(".yaml")
        assert yaml.read_text() == (MAPS / yaml.name).read_text()


@each
def test_size_and_one_closed_floor(name: str) -> None:
    grid = grid_of(name)
    size = SIZES[name]
    if size:
        assert (grid.resolution, grid.origin) == (0.05, Point(0.0, 0.0))
        assert grid.corner == pytest.approx(size)
    assert np.array_equal(largest_region(grid), grid.free), "nothing free behind a wall"
    floor, walls = np.pad(grid.free, 3), np.pad(grid.cells, 3)
    thick = 3 if name == "corridor" else 2
    near = ndimage.binary_dilation(floor, iterations=thick, structure=np.ones((3, 3), dtype=np.bool_))
    assert (walls[near & ~floor] == OCCUPIED).all()
    assert len(outline(grid)) < 1000, "short enough for physics"


def test_the_corridor_has_the_areas_of_the_original_testbed() -> None:
    grid = grid_of("corridor")
    assert grid.free.sum() * PIXEL**2 == pytest.approx(152.64, rel=0.01)
    for x0, y0, x1, y1 in (
        (11.50, 1.00, 13.50, 7.00),
        (16.50, 1.00, 18.25, 7.00),
        (2.25, 11.10, 4.75, 13.75),
        (6.25, 11.10, 14.25, 13.75),
        (15.75, 11.10, 23.75, 13.75),
        (25.25, 11.10, 28.75, 13.75),
    ):
        area = grid.free[round(y0 / PIXEL) : round(y1 / PIXEL), round(x0 / PIXEL) : round(x1 / PIXEL)]
        assert area.mean() > 0.99, "but for a pillar's edge or a recess"
    assert [0.09375, 11.59375, 0.09375, 13.3125] in outline(grid).tolist(), "the kitchen's west wall"


@new
def test_all_passable_floor_is_connected(name: str) -> None:
    grid = grid_of(name)
    region = largest_region(grid, BODY)
    assert np.array_equal(region, passable(grid, BODY))
    assert region.sum() > 0.6 * grid.free.sum()


@new
def test_no_rotation_or_reflection_is_similar(name: str) -> None:
    walls = ~grid_of(name).free[2:-2, 2:-2]  # the border is one wall all round
    half = np.flipud(np.fliplr(walls))
    images: list[NDArray[np.bool_]] = [np.flipud(walls), np.fliplr(walls), half]
    if walls.shape[0] == walls.shape[1]:
        images += [np.rot90(walls), np.rot90(walls, 3), walls.T, half.T]
    assert max((walls & image).sum() / (walls | image).sum() for image in images) < 0.4


@cache
def doorways(name: str) -> tuple[OccupancyGrid, Doorways]:
    grid = grid_of(name)
    return grid, Doorways(grid, RADIUS)


def test_a_closed_office_door_spans_its_opening() -> None:
    grid, doors = doorways("corridor")
    rows, columns = np.nonzero(doors.closed_cells(doors.at(Point(12.45, 9.4))))
    first, last = grid.centre(Cell(rows.min(), columns.min())), grid.centre(Cell(rows.max(), columns.max()))
    assert last.y - first.y < 0.05 and (first.x, last.x) == pytest.approx((12.0, 12.88), abs=0.05)
    cells = grid.blocking[rows[0], [columns.min() - 1, columns.max() + 1]]
    assert cells.all(), "it reaches from wall to wall"


@each
def test_a_closed_door_separates_its_regions(name: str) -> None:
    grid, doors = doorways(name)
    floor = passable(grid, RADIUS)
    for door in doors.regions.doors:
        left = floor & ~doors.closed_cells(door)
        inside = doors.regions.labels == doors.regions.count + 1 + door.index
        pieces = raster.regions(left & np.isin(doors.regions.labels, door.regions) | left & inside)
        ends = [np.unique(pieces[(doors.regions.labels == one) & (pieces > 0)]) for one in door.regions]
        assert len(set(map(tuple, ends))) > 1, door


def test_a_point_near_a_door_selects_it() -> None:
    _, doors = doorways("corridor")
    assert doors.at(Point(12.45, 9.4)) == doors.at(Point(12.6, 9.9))
    with pytest.raises(DoorError) as caught:
        doors.at(Point(9.0, 12.5))
    assert str(caught.value).startswith("(9, 12.5) is not at a door; the map's doors are at (12.52, 9.48), ")
