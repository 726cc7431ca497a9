"""Maze and apartment as committed: what the script draws, in one piece, passable, like no mirror image."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from actors.floor.grid import OccupancyGrid, largest_region, outline, passable
from actors.floor.map_file import load_map
from actors.geometry import Point

MAPS = Path(__file__).parents[2] / "maps"
NAMES = ("maze", "apartment")
SIZES = {"maze": (10.0, 10.0), "apartment": (16.0, 11.0)}
BODY = 0.177 + 0.03
"""A robot's radius and what planning keeps beyond it, m."""


@pytest.fixture(scope="module")
def grids() -> dict[str, OccupancyGrid]:
    return {name: load_map(MAPS / f"{name}.yaml") for name in NAMES}


def test_drawing_again_gives_the_committed_files(tmp_path: Path) -> None:
    runpy.run_path(str(MAPS / "draw_floors.py"))["main"](tmp_path)
    for name in NAMES:
        drawn = np.asarray(Image.open(tmp_path / f"{name}.png"))
        assert np.array_equal(drawn, np.asarray(Image.open(MAPS / f"{name}.png")))
        assert (tmp_path / f"{name}.yaml").read_text() == (MAPS / f"{name}.yaml").read_text()


@pytest.mark.parametrize("name", NAMES)
def test_size_border_and_one_floor(grids: dict[str, OccupancyGrid], name: str) -> None:
    grid = grids[name]
    assert grid.resolution == 0.05 and grid.origin == Point(0.0, 0.0)
    assert grid.corner == pytest.approx(SIZES[name])
    assert np.array_equal(largest_region(grid), grid.free), "nothing free behind a wall"
    assert not grid.free[:2].any() and not grid.free[-2:].any()
    assert not grid.free[:, :2].any() and not grid.free[:, -2:].any()
    assert len(outline(grid)) < 1000, "short enough for physics"


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_gets_everywhere_it_fits(grids: dict[str, OccupancyGrid], name: str) -> None:
    grid = grids[name]
    region = largest_region(grid, BODY)
    assert np.array_equal(region, passable(grid, BODY))
    assert region.sum() > 0.6 * grid.free.sum()


@pytest.mark.parametrize("name", NAMES)
def test_no_turn_or_reflection_looks_alike(grids: dict[str, OccupancyGrid], name: str) -> None:
    inner = grids[name].free[2:-2, 2:-2]  # the border is one wall all round
    half = np.flipud(np.fliplr(inner))
    images = [np.flipud(inner), np.fliplr(inner), half]
    if inner.shape[0] == inner.shape[1]:
        images += [np.rot90(inner), np.rot90(inner, 3), inner.T, half.T]
    assert max(_likeness(~inner, ~image) for image in images) < 0.4, "walls in common, of all walls"


def _likeness(
    one: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    other: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
) -> float:
    return float((one & other).sum() / (one | other).sum())
