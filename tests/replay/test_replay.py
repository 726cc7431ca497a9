"""`acrc replay` and `acrc run --check`: a run or a robot executed again, debugged, or otherwise."""

import io
import json
import re
import shutil
import sys
from functools import partial
from pathlib import Path

import pytest

from acrc_testbed.command_line import replay_commands
from acrc_testbed.recordings import record_replay
from acrc_testbed.recordings.record_replay import RecheckError, ReplayOptions, recheck, replay_actor
from acrc_testbed.recordings.run_recordings import code_folders, read_setup, recordings
from acrc_testbed.run_model.recording_readers import world_setup
from acrc_testbed.run_model.simulated_runs import read_run
from actors.installation.repository import REPOSITORY
from actors.installation.usage import OptionError
from actors.robot.assembly import RobotSetup
from actors.robot.behaviour.code_permit import INSTALLED, Permit
from actors.runtime.errors import AcrcError
from actors.runtime.replay_bus import ReplayError
from deploy.run import swarm
from deploy.run.options import RunOptions, check_options
from deploy.run.swarm_replay import replay_swarm
from deploy.scenario.scenario_file import DEFAULT_SCENARIO, load_scenario
from tests.in_process import acrc
from tests.recorded_runs import record


def test_a_run_made_again_is_the_same(recorded: Path) -> None:
    done = acrc("replay", recorded)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"matches the recording: \d{3} messages; digest [0-9a-f]{64}\n", done.stdout)


def test_another_start_is_found_and_named(copy: Path) -> None:
    file = copy / "scenario.toml"
    text = file.read_text()
    file.write_text(text.replace("start = [12.44, 4.4, 1.57]", "start = [12.44, 4.5, 1.57]"))
    with pytest.raises(
        ReplayError, match=r"^step 0: swarm/(up|down|infra)/.* is .*; in the recording it was "
    ):
        replay_swarm(copy, permit=INSTALLED)
    shutil.rmtree(copy / "world")
    (copy / "run.json").unlink()
    with pytest.raises(ReplayError, match="no recording of the world to compare with"):
        replay_swarm(copy, permit=INSTALLED)


def test_what_is_no_simulated_run_is_told(tmp_path: Path, recorded: Path) -> None:
    for words, code, sentence in (
        ((tmp_path,), 1, f"{tmp_path}: contains no scenario.toml; give the folder of a simulated run"),
        ((recorded, "--to", 1), 2, "--to: requires --robot"),
        ((recorded, "--robot", "r1", "--from", 1), 2, "--from: requires --pdb or --debugpy"),
        ((recorded, "--robot", "r9"), 1, f"{recorded}: no recording of 'r9'; choose from r1, r2, radio, "),
        ((recorded, "--robot", "world", "--strategy", "none"), 1, "world: not a robot of this run; choose "),
        ((recorded, "--robot", "world", "--pdb"), 1, "world: not a robot of this run; choose from r1, r2"),
        ((tmp_path / "x", "--robot", "r1"), 1, f"{tmp_path}/x: does not exist"),
        ((recorded, "--robot", "r1", "--debugpy", 5678), 1, "--debugpy 5678: debugpy is not installed"),
        ((recorded, "--robot", "r2", "--from", 100, "--pdb"), 1, "--from: 100 is after the end of r2's"),
    ):  # fmt: skip
        done = acrc("replay", *words)
        assert done.returncode == code and done.stderr.startswith(f"acrc: {sentence}")
    with pytest.raises(OptionError, match="cannot be combined with --hardware-in-the-loop"):
        check_options(RunOptions(tmp_path, hardware=True, check=True))


def test_one_robot_is_the_same_again_and_can_be_left_early(recorded: Path) -> None:
    whole, part = (acrc("replay", recorded, "--robot", "r1", *to) for to in ((), ("--to", 1)))
    assert re.fullmatch(r"r1: matches the recording: \d+ outputs\n", whole.stdout)
    assert re.fullmatch(r"r1: matches the recording: \d+ outputs up to 1 s\n", part.stdout)
    assert int(part.stdout.split()[4]) < int(whole.stdout.split()[4])


def test_the_debugger_stops_in_the_strategys_code_and_nowhere_else(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("print(self.id)\n" + "step\n" * 6 + "continue\n"))
    terminal = [record_replay.pdb_breakpoint(own=False)]
    watch = ReplayOptions(partial(record_replay.limit_replay, begin_s=1.0, end_s=None, stops=terminal))
    report = replay_actor(recorded, "r2", watch)
    assert report.whole and report.outputs > 30, "a look changes nothing"
    said = capsys.readouterr().out
    stops = re.findall(r"^(?:\(Pdb\) )*> (\S+)\(\d+\)", said, re.MULTILINE)
    assert len(stops) >= 6
    assert all("/cleaning/" in file for file in stops), "never in what a dataclass generates"
    assert "r2" in said
    monkeypatch.setattr(sys, "stdin", io.StringIO("quit\n"))
    replay_commands.replay(recorded, "r2", begin=1.0, pdb=True)
    assert re.search(r"r2: matches the recording: \d+ outputs so far\n$", capsys.readouterr().out)


def test_breakpoints_take_the_names_that_explain_prints(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    commands = "b cleaning.robot.CleaningRobot.drive\nb no.such\nc\nq\n"
    monkeypatch.setattr(sys, "stdin", io.StringIO(commands))
    replay_commands.replay(recorded, "r2", begin=0.5, pdb=True)
    printed = capsys.readouterr().out
    assert re.search(r"Breakpoint 1 at .*/cleaning/robot\.py:\d+", printed)
    assert "'no.such' is not a function" in printed
    assert re.search(r"> .*/cleaning/robot\.py\(\d+\)drive\(\)", printed)


def test_another_strategy_decides_as_recorded_until_it_does_not(recorded: Path) -> None:
    same = acrc("replay", recorded, "--robot", "r1", "--strategy", "chapter", "--to", 2)
    assert same.stdout == "r1: no different decision up to 2 s\n", "the scenario sets none of its numbers"
    other = acrc(
        "replay", recorded, "--robot", "r1", "--strategy", "cleaning.strategies.idle:behaviour", "--json"
    )
    assert other.returncode == 0, other.stderr
    difference = json.loads(other.stdout)["decisions"]
    assert difference == "first different decision: none; recorded: drives to (9.00, 12.50) at 0 s"


def test_what_follows_a_clock_chance_a_set_or_an_address_is_found(tmp_path: Path) -> None:
    strategy = "tests.replay.fickle:behaviour"
    record(tmp_path / "out", DEFAULT_SCENARIO, robots=5, duration=1.2, strategy=strategy)
    with pytest.raises(RecheckError) as caught:
        recheck(tmp_path / "out")
    said = str(caught.value)
    assert said.startswith("r1 and r2 and r3 and r4: the replay differs, so the code depends on more than ")
    faults = re.findall(
        r"/(r\d)\.mcap: step 10: swarm/up/r\d/drive: Drive\.given_up\[0\]\.reason is '(.*?)', "
        r"recorded was '(.*?)'",
        said,
    )
    assert [robot for robot, _, _ in faults] == ["r1", "r2", "r3", "r4"]
    assert all(now != then for _, now, then in faults)


def test_a_run_is_checked_and_sealed_at_its_end(tmp_path: Path) -> None:
    words = ("--bus", "memory", "--robots", 1, "--duration", 1, "--check", "--out", tmp_path / "out")
    done = acrc("run", *words)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"checked: 3 actors replayed, all \d+ messages equal", done.stderr.splitlines()[-1])
    assert (tmp_path / "out" / "SHA256SUMS").is_file()


SCENARIO = """
map = "floor/corridor.yaml"
[run]
duration = 2.0
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
from actors.geometry import Point
from actors.robot.behaviour.ports import Decision

class Goes:
    def __init__(self, start):
        self.goal = Point(*start.items[0])

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
    options = RunOptions(there / "out", bus="memory", modules=(there / "code",))
    swarm.run_in_memory(swarm.plan(load_scenario(there / "study.toml"), options), lambda progress: None)
    here = tmp_path_factory.mktemp("here") / "study"
    shutil.move(there, here)
    for name in ("floor", "mine.toml", "study.toml"):
        (here / name).rename(here / f"not-{name}")  # all of it lies in the run's folder, too
    return here / "out"


def test_every_actor_is_the_same_again(moved: Path) -> None:
    for actor in ("world", "radio", "r1", "r2"):
        assert replay_actor(moved, actor).outputs > 10
    assert replay_swarm(moved, permit=Permit(trust=True)).complete
    assert read_run(moved).grid.cells.any()
    done = acrc("explain", moved, "r1", "--trust")
    assert done.returncode == 0 and "drives to" in done.stdout, done.stderr


def test_what_a_copy_lacks_is_named(moved: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(moved, out)
    done = acrc("replay", out, "--robot", "r1", "--trust")
    assert done.returncode == 1
    assert "r1.mcap: strategy moved_strategy:behaviour: there is no module " in done.stderr
    shutil.copytree(moved.parent / "code", tmp_path / "code")
    (out / "r1" / "model.toml").unlink()
    with pytest.raises(AcrcError, match=r"model\.toml: the robot model file cannot be read"):
        replay_actor(out, "r1")


def test_a_copy_beside_its_original_has_files_of_its_own(moved: Path, tmp_path: Path) -> None:
    for out in (moved, shutil.copytree(moved, tmp_path / "out")):
        setup = read_setup(recordings(out)["r1"], RobotSetup, "a robot")
        assert (setup.map, setup.model) == ("map.yaml", "model.toml")
        world = world_setup(recordings(out)["world"])
        assert Path(world.map).resolve() == (out / "map" / "map.yaml").resolve()
        assert Path(world.robots[0].model).resolve() == (out / "r1" / "model.toml").resolve()
        assert [folder.name for folder in code_folders(out)] == ["code"]
    assert code_folders(moved) == (moved.parent / "code",)
