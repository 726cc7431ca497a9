"""`acrc replay`: a run made again, one robot replayed, stopped in, or given another strategy."""

import io
import re
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.bus.replay_bus import ReplayError
from command_line import replaying
from deploy.branches.swarm_replay import replay_otherwise, replay_swarm
from observation.replay import debugging
from observation.replay.record_replay import Onlook, replay_actor
from tests.in_process import acrc


def test_a_run_made_again_is_the_same(recorded: Path) -> None:
    done = acrc("replay", recorded)
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(r"identical: \d{3} messages; digest [0-9a-f]{64}\n", done.stdout)


def test_another_start_is_found_and_named(copy: Path) -> None:
    file = copy / "scenario.toml"
    text = file.read_text()
    assert "start = [12.44, 4.4, 1.57]" in text
    file.write_text(text.replace("start = [12.44, 4.4, 1.57]", "start = [12.44, 4.5, 1.57]"))
    with pytest.raises(ReplayError, match=r"^step 0: swarm/(up|down|infra)/.* is .*; recorded was "):
        replay_swarm(copy, permit=INSTALLED)


def test_what_is_no_simulated_run_is_told(tmp_path: Path, recorded: Path) -> None:
    for words, code, sentence in (
        ((tmp_path,), 1, f"{tmp_path}: has no scenario.toml; it should be the folder of a simulated run"),
        ((recorded, "--to", 1), 2, "--to: requires --robot; it is about one actor"),
        (
            (recorded, "--robot", "r1", "--from", 1), 2,
            "--from: requires --pdb or --debugpy; a debugger stops there",
        ),
        ((recorded, "--robot", "r9"), 1, f"{recorded}: no recording of 'r9'; there are r1, r2, radio, world"),
        ((recorded, "--robot", "world", "--strategy", "none"), 1, "world: has no strategy; must be a robot"),
    ):  # fmt: skip
        done = acrc("replay", *words)
        assert (done.returncode, done.stderr) == (code, f"acrc: {sentence}\n")


def test_one_robot_is_the_same_again_and_can_be_left_early(recorded: Path) -> None:
    whole, part = (acrc("replay", recorded, "--robot", "r1", *to) for to in ((), ("--to", 1)))
    assert re.fullmatch(r"r1: identical: \d+ outputs\n", whole.stdout)
    assert re.fullmatch(r"r1: identical: \d+ outputs up to 1 s\n", part.stdout)
    assert int(part.stdout.split()[2]) < int(whole.stdout.split()[2])


def test_the_debugger_stops_in_the_strategys_code_and_nowhere_else(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(
        sys, "stdin", io.StringIO("print(self.id)\nstep\nstep\nstep\nstep\nstep\nstep\ncontinue\n")
    )
    stretch = debugging.Stretch(begin_s=1.0, end_s=None)
    report = replay_actor(
        recorded,
        "r2",
        Onlook(lambda core, step_us: debugging.watch(core, step_us, stretch, debugging.terminal(own=False))),
    )
    assert report.whole and report.outputs > 30, "a look changes nothing"
    said = capsys.readouterr().out
    stops = re.findall(r"^(?:\(Pdb\) )*> (\S+)\(\d+\)", said, re.MULTILINE)
    assert len(stops) >= 6
    assert all("/cleaning/" in file for file in stops), "never in what a dataclass generates"
    assert "r2" in said


DERIVED = """
from typing import Self
from actors.robot.behaviour import Behaviour, Start, host
from cleaning.place import assignments
from cleaning.robot import CleaningRobot
from deeco import component, periodic, seconds

@component
class DerivedRobot(CleaningRobot):
    @periodic(every=seconds(0.5), order=9)
    def look(self) -> Self:
        return self

def behaviour(start: Start) -> Behaviour:
    return host(start, DerivedRobot(id=start.robot, position=start.pose.point, route=assignments(start)))
"""


def test_the_debugger_steps_over_what_a_strategy_of_ones_own_is_derived_from(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "derived_strategy.py").write_text(DERIVED)
    (tmp_path / "leads_nowhere").symlink_to("leads_nowhere")  # is no reason not to run
    out, words = tmp_path / "out", ("--robots", 1, "--duration", 2)
    own = ("--strategy", "derived_strategy:behaviour", "--modules", tmp_path)
    assert acrc("run", *words, *own, "--out", out).returncode == 0
    monkeypatch.setattr(sys, "stdin", io.StringIO("continue\n"))
    replaying.replay(out, "r1", pdb=True, modules=[tmp_path])
    stops = re.findall(r"^(?:\(Pdb\) )*> (\S+)\(\d+\)", capsys.readouterr().out, re.MULTILINE)
    assert stops == [str(tmp_path / "derived_strategy.py")]


def test_who_leaves_the_debugger_has_seen_enough(
    recorded: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("quit\n"))
    replaying.replay(recorded, "r2", begin=1.0, pdb=True)
    assert re.search(r"r2: identical: \d+ outputs so far\n$", capsys.readouterr().out)


def test_a_debugger_that_is_never_come_to_is_told(recorded: Path) -> None:
    done = acrc("replay", recorded, "--robot", "r2", "--from", 100, "--pdb")
    assert done.returncode == 1
    assert done.stderr == "acrc: --from: is 100, but r2's recording ends before\n"


def test_without_a_recording_of_the_world_there_is_nothing_to_compare_with(copy: Path) -> None:
    shutil.rmtree(copy / "world")
    (copy / "run.json").unlink()
    with pytest.raises(ReplayError, match="there is no recording of the world, with which to compare"):
        replay_swarm(copy, permit=INSTALLED)


def test_without_the_editors_debugger_it_says_how_to_get_it(recorded: Path) -> None:
    if find_spec("debugpy") is not None:
        pytest.fail("the suite's own environment should not have debugpy")
    done = acrc("replay", recorded, "--robot", "r1", "--debugpy", 5678)
    assert done.returncode == 1
    assert done.stderr == (
        "acrc: --debugpy 5678: needs the Python package debugpy, which is not installed; "
        "`./acrc add debugpy` brings it\n"
    )


def test_another_strategy_decides_as_recorded_until_it_does_not(recorded: Path) -> None:
    same = replay_otherwise(recorded, "r1", "cleaning.strategies.chapter:behaviour", Onlook())
    assert same.whole, "the same strategy, and the scenario sets none of its numbers"
    with pytest.raises(ReplayError, match=r"r1\.mcap: step \d+: swarm/up/r1/"):
        replay_otherwise(recorded, "r1", "examples.courteous:behaviour", Onlook())
