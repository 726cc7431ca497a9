"""A run's folder that was moved, or copied, is replayed from what lies in it and beside it."""

import shutil
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.foreign import Permit
from actors.runtime.errors import AcrcError
from deploy.branches.swarm_replay import replay_swarm
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import load_scenario
from observation.evidence.run_evidence import world_setup
from observation.evidence.run_reader import read_run
from observation.explanation.explain import Explainer
from observation.replay.record_replay import replay_actor
from observation.replay.recorded_setup import code_folders, setup_of
from observation.replay.run_recordings import recordings
from tests.swarm.command import acrc

SCENARIO = """
map = "floor/corridor.yaml"
[run]
duration = 3.0
strategy = "moved_strategy:behaviour"
modules = "code"
[robots]
count = 2
model = "mine.toml"
[localisation]
preset = "odometry"
[places]
preset = "golden"
per_robot = 1
"""
STRATEGY = """
from actors.robot.behaviour.ports import Decision

class Goes:
    def __init__(self, start):
        self.goal = start.places[0]

    def advance(self, view, until):
        goal, self.goal = self.goal, None
        return Decision() if goal is None else Decision(goal)

def behaviour(start):
    return Goes(start)
"""


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a map, a model and a strategy of one's own, whose whole folder goes elsewhere afterwards."""
    there = tmp_path_factory.mktemp("there") / "study"
    (there / "floor").mkdir(parents=True)
    (there / "code").mkdir()
    for file in (REPOSITORY / "maps").glob("corridor.*"):
        shutil.copy(file, there / "floor")
    (there / "code" / "moved_strategy.py").write_text(STRATEGY)
    shutil.copy(REPOSITORY / "actors" / "models" / "turtlebot2.toml", there / "mine.toml")
    (there / "study.toml").write_text(SCENARIO)
    settled = load_scenario(there / "study.toml")
    swarm.run_in_memory(
        swarm.plan(settled, RunOptions(there / "out", bus="memory", modules=(there / "code",))),
        lambda progress: None,
    )
    here = tmp_path_factory.mktemp("here") / "study"
    shutil.move(there, here)
    for name in ("floor", "mine.toml", "study.toml"):
        (here / name).rename(here / f"not-{name}")  # all of it lies in the run's folder, too
    return here / "out"


def test_every_actor_is_the_same_again(moved: Path) -> None:
    for actor in ("world", "radio", "r1", "r2"):
        assert replay_actor(moved, actor).outputs > 20
    assert replay_swarm(moved, permit=Permit(trust=True)).complete
    assert read_run(moved).grid.cells.any()
    assert Explainer(moved, permit=Permit(trust=True), isolate=False).listed("r1")


def test_a_command_finds_the_strategy_where_it_lay_beside_the_run(moved: Path) -> None:
    done = acrc("explain", moved, "r1", "--trust")
    assert done.returncode == 0 and "sets off for" in done.stdout, done.stderr


def test_what_a_copy_lacks_is_named(moved: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(moved, out)
    done = acrc("replay", out, "--robot", "r1", "--trust")
    assert done.returncode == 1
    assert done.stderr.startswith(
        f"acrc: {out / 'r1' / 'r1.mcap'} names the strategy moved_strategy:behaviour, and there is no module "
        "'moved_strategy' here, nor in "
    )
    shutil.copytree(moved.parent / "code", tmp_path / "code")
    (out / "r1" / "model.toml").unlink()
    with pytest.raises(AcrcError) as caught:
        replay_actor(out, "r1")
    assert str(caught.value).startswith(f"{out / 'r1' / 'model.toml'}: the robot model file cannot be read")


def test_a_copy_beside_its_original_has_files_of_its_own(moved: Path, tmp_path: Path) -> None:
    twice = [tmp_path / name / "out" for name in ("one", "two")]
    for out in twice:
        shutil.copytree(moved, out)
    for out in (moved, *twice):
        setup = setup_of(recordings(out)["r1"], RobotSetup, "a robot")
        assert (setup.map, setup.model) == ("map.yaml", "model.toml")
        world = world_setup(recordings(out)["world"])
        assert Path(world.map).resolve() == (out / "map" / "map.yaml").resolve()
        assert Path(world.robots[0].model).resolve() == (out / "r1" / "model.toml").resolve()
        assert [folder.name for folder in code_folders(out)] == ["code"]
    assert code_folders(moved) == (moved.parent / "code",)
