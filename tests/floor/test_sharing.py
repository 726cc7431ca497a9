"""What follows from content alone is made once, for as long as somebody holds it."""

import shutil
from dataclasses import replace
from pathlib import Path

from actors.floor.grid import OccupancyGrid
from actors.floor.map_file import load_map
from actors.floor.sharing import Shared
from actors.geometry import Point
from actors.robot.localisation import likelihood_field
from actors.robot.navigation.planning import PLANNER_PRESETS, ground
from tests.floor.plans import plan

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


class Thing:
    """Something that can be held."""


def test_a_value_is_shared_while_it_lives() -> None:
    shared: Shared[Thing] = Shared()
    first = shared.get(("a", 1), Thing)
    assert shared.get(("a", 1), Thing) is first
    assert shared.get(("a", 2), Thing) is not first
    made: list[str] = []

    def make() -> Thing:
        made.append("anew")
        return Thing()

    shared.get(("a", 1), make)
    assert made == []
    del first
    shared.get(("a", 1), make)
    assert made == ["anew"]


def test_grids_have_the_same_content_if_cells_resolution_and_origin_are_the_same() -> None:
    one = plan("..#", "...")
    others = [
        plan("..#", "..."),
        plan("..?", "..."),
        plan("..", "#.", ".."),
        plan("..#", "...", resolution=2.0),
        plan("..#", "...", origin=Point(0.0, 1.0)),
    ]
    assert [other.content == one.content for other in others] == [True, False, False, False, False]


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
    floor, field = ground(grid, 0.2, PLANNER_PRESETS["robust"]), likelihood_field(grid, 2.0)
    assert ground(twin, 0.2, PLANNER_PRESETS["robust"]) is floor
    assert likelihood_field(twin, 2.0) is field
    assert ground(twin, 0.25) is not floor
    assert ground(twin, 0.2, replace(PLANNER_PRESETS["robust"], margin=0.04)) is not floor
    assert likelihood_field(twin, 1.0) is not field
    assert not any(part.flags.writeable for part in (floor.clearance, floor.costs, field.levels, field.floor))
