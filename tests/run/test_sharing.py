"""What all robots have in common is made once: in a run in memory, and by the server that forks them."""

import shutil
from pathlib import Path

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from actors.floor import distance
from actors.floor.map_file import load_map
from actors.processes.launch import Program, launcher
from actors.robot.stack import Stack
from deploy.run.options import RunOptions
from deploy.run.plan import in_common
from deploy.run.swarm import plan, run_in_memory
from deploy.scenario.scenario_file import Overrides, load_scenario

MAPS = Path(__file__).parents[2] / "maps"
CHAPTER = MAPS.parent / "scenarios" / "chapter.toml"


def test_a_forked_process_finds_what_its_server_was_told_to_share(tmp_path: Path) -> None:
    shutil.copytree(MAPS, tmp_path / "maps")
    stack = msgspec.json.encode(Stack()).decode()
    log = tmp_path / "heir.log"
    with launcher("forkserver") as launched:
        for name in ("none.yaml", "maps/corridor.yaml"):  # the first is left to who needs it
            launched.share("actors.robot.program", (name, "turtlebot2", "", stack), tmp_path)
        argv = (str(tmp_path / "maps" / "corridor.yaml"), str(tmp_path / "maps" / "maze.yaml"))
        heir = launched.start(Program("heir", "tests.run.heir", argv, log, None))
        while heir.exit_code is None:
            launched.wait(0.1)
    assert log.read_text().split() == ["True", "False"]


def test_robots_in_memory_compute_the_walls_distances_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    maps = tmp_path / "maps"
    shutil.copytree(MAPS, maps)
    with Image.open(maps / "corridor.png") as image:
        image.load()
    before = load_map(maps / "corridor.yaml").cells.copy()
    image.putpixel((0, 0), 0 if image.getpixel((0, 0)) else 255)
    image.save(maps / "corridor.png")
    assert (
        load_map(maps / "corridor.yaml").cells != before
    ).any()  # distances that no other test has asked for
    scenario = load_scenario(CHAPTER, Overrides(robots=3, duration=0.2, seed=1))
    own = scenario.model_copy(update={"map": str(maps / "corridor.yaml")})
    planned = plan(own, RunOptions(tmp_path / "out", bus="memory"))
    shapes: list[tuple[int, ...]] = []
    compute = distance.squared_distance

    def counted(mask: NDArray[np.bool_]) -> NDArray[np.float64]:
        shapes.append(mask.shape)
        return compute(mask)

    monkeypatch.setattr(distance, "squared_distance", counted)
    run_in_memory(planned, lambda progress: None)
    assert len(in_common(planned)) == 1
    assert shapes.count(before.shape) == 1  # the others are the fingerprint's
