from pathlib import Path

import numpy as np
import pytest

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, largest_region
from actors.floor.map_file import load_map, map_warnings
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import parse
from tests.floor.public_maps import PUBLIC_MAPS, PublicMap

each = pytest.mark.parametrize("public", PUBLIC_MAPS, ids=lambda one: one.name.replace("/", " "))


@each
def test_a_map_like_a_public_one_is_read(public: PublicMap, tmp_path: Path) -> None:
    path = public.write(tmp_path)
    grid, pixels = load_map(path), np.flipud(public._pixels())
    assert grid.resolution == public.resolution and grid.cells.shape == public.size
    assert (grid.cells[pixels == 254] == FREE).all() and (grid.cells[pixels == 0] == OCCUPIED).all()
    assert (grid.cells[pixels == 205] == (FREE if public.warnings else UNKNOWN)).all()
    assert len(map_warnings(path)) == public.warnings
    floor = (pixels == 254).sum()
    assert largest_region(grid, 0.18).sum() > 0.5 * floor


@pytest.mark.nightly
@each
def test_two_robots_reach_places_on_a_map_like_a_public_one(public: PublicMap, tmp_path: Path) -> None:
    public.write(tmp_path)
    text = (
        'map = "map.yaml"\nlocalisation.preset = "robust"\nnavigation.preset = "robust"\n'
        '[run]\nduration = 120.0\n[robots]\ncount = 2\n[places]\npreset = "free"\nper_robot = 3\n'
    )
    plan = swarm.plan(parse(text, tmp_path / "scenario.toml"), RunOptions(tmp_path / "out", bus="memory"))
    result = swarm.run_in_memory(plan, lambda progress: None)
    assert result.places_done >= 3 and result.places_given_up == 0
