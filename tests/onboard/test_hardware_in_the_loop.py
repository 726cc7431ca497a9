"""Hardware-in-the-loop runs, and refused options and scenarios."""

import csv
import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from acrc_testbed.export.log_export import log_run
from acrc_testbed.recordings import record_replay
from acrc_testbed.results.result import RunResult
from acrc_testbed.run_model.hardware_runs import whole_run
from acrc_testbed.run_model.onboard_runs import OnboardReader
from actors.installation.usage import OptionError
from actors.instant import Instant
from actors.processes.launcher import Launcher
from actors.radio.robot_medium import COPIES
from deploy.fleet import hardware_in_the_loop
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import Scenario
from firmware_bridge.laboratory.laboratory import Laboratory, LaboratorySetup
from tests.swarm.command import ROOT, acrc, leftovers, processes_of

SCENARIO = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 80.0
strategy = "chapter"
[robots]
count = 3
[[robot]]
id = "r1"
start = [9.0, 12.5, 0.0]
places = [[10.5, 12.5]]
[[robot]]
id = "r2"
start = [13.0, 12.5, 0.0]
places = [[13.2, 12.6], [11.8, 12.2]]
[[robot]]
id = "r3"
start = [17.0, 12.5, 3.14]
places = [[17.2, 12.5]]
[radio]
shadowing_db = 2.0
[[wall]]
material = "glass"
x = [13.0, 17.0]
y = [0.0, 11.0]
[[wifi]]
at = [14.0, 5.0]
channel = 1
duty = 0.1
[[event]]
at = 3.0
jam = [13.0, 12.5]
radius = 1.8
duration = 4.0
[[event]]
at = 2.0
obstacle = [15.5, 12.5]
radius = 0.2
"""


@pytest.mark.timeout(240)
def test_three_robots_clean_their_places_one_of_them_without_a_board(tmp_path: Path) -> None:
    file, out = tmp_path / "near.toml", tmp_path / "out"
    file.write_text(SCENARIO)
    boards = ("--board", "r1", "--board", "r2")
    done = acrc("run", file, "--hardware-in-the-loop", *boards, "--out", out, "--json", timeout_s=200.0)
    assert done.returncode == 0, done.stderr
    result = msgspec.json.decode(done.stdout, type=RunResult)
    assert [result.task[f"places_{name}"] for name in ("claimed", "done", "total")] == [4, 4, 4]
    assert result.contacts == 0
    frames = {robot: part.frames for robot, part in result.per_robot.items()}
    assert min(part["copies_heard"] for part in frames.values()) > 0
    assert all(part["frames_handed"] >= part["frames_sent"] > 0 for part in frames.values()), frames
    jammed = (result.frames["copies_lost_disturbed"], frames["r2"]["frames_access_failure"])
    assert min(jammed) > 0, jammed  # for 4 s r2 neither receives nor finds the channel clear
    assert sum(result.frames[name] for name in COPIES) == 2 * result.frames["frames_sent"]
    assert msgspec.json.decode((out / "result" / "run.json").read_bytes(), type=RunResult) == result
    with (out / "result" / "places.csv").open() as table:
        assert {row["verdict"] for row in csv.DictReader(table)} == {"done"}
    setup = json.loads((out / "laboratory" / "setup.json").read_text())
    assert setup["without_board"] == ["r3"]
    links = [out / f"r{number}.radio" / "setup.json" for number in (1, 2, 3)]
    assert [json.loads(link.read_text())["actor"]["board"] for link in links] == [True, True, False]
    internals = whole_run(out).internals
    assert {one.process.robot for one in internals if one.is_recorded and one.commits} == {"r1", "r2", "r3"}
    (aligned,) = (one for one in internals if one.process.robot == "r1")
    with OnboardReader(out, "r1") as reader:
        part, rest = reader.poll(), reader.poll(last=True)
    assert part is not None and rest is not None and part.description.robots == ("r1",)
    assert 1e9 < part.since < part.end and len(part.senses["r1"]) == len(part.seconds) > 50
    (own,) = part.internals
    np.testing.assert_array_equal(own.covariances, aligned.covariances[: len(own.seconds)])
    np.testing.assert_array_equal(own.plans.points, aligned.plans.points[: len(own.plans.points)])
    report = log_run(out, tmp_path / "robots.mcap", ("r1",))
    assert report.counts["/acrc/r1/odom"] > 50 and not [note for note in report.notes if "left out" in note]
    checked = acrc("record", "check", out)
    assert checked.returncode == 0, checked.stderr
    assert checked.stdout.startswith("no digest without a recording of the world, over "), checked.stdout
    again = acrc("replay", out, "--robot", "r2")
    assert again.returncode == 0 and ": matches the recording: " in again.stdout, again.stderr
    base = acrc("replay", out, "--robot", "r2.base")
    assert (base.returncode, base.stdout, base.stderr) == (
        1, "", "acrc: r2.base: serves devices and cannot be replayed; give a robot, world or radio\n"
    )  # fmt: skip
    assert processes_of(out) == [] and leftovers(out) == []


@pytest.mark.claim("onboard")
@pytest.mark.nightly
@pytest.mark.timeout(600)
def test_robots_that_meet_clean_all_places(
    full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Run each process in its own network namespace without interfaces (util-linux)."""
    overrides = Overrides(robots=3, duration=300.0) if full else Overrides(robots=2, duration=15.0)
    options = RunOptions(tmp_path / "out", spawn="exec", hardware=True, json=True)
    launcher = Launcher("exec", reap=False)
    launcher._command[:0] = ["unshare", "--map-root-user", "--net"]
    plan = load_scenario(ROOT / "scenarios" / "head_on.toml", overrides)
    result = hardware_in_the_loop.run(plan, options, launcher)
    for name, robot in result.per_robot.items():
        assert robot.frames["copies_heard"] > 0
        assert record_replay.replay_actor(options.out, name).outputs > 0
    done, total = result.task["places_done"], result.task["places_total"]
    record_property("places done", f"{done} of {total}")
    late = {name: one.lateness_p99_ms for name, one in result.per_robot.items()}
    record_property("99 % of the steps answered within, ms", late)
    assert not full or done == total


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--board", "r1"), "--board: r1; requires --hardware-in-the-loop"),
        (("--hardware-in-the-loop", "--board", "r9"), "--board: r9; must be a robot of the scenario: r1, r2"),
        (
            ("--hardware-in-the-loop", "--bus", "memory"),
            "--hardware-in-the-loop: runs processes in wall time; cannot be combined with --bus memory",
        ),
    ],
)
def test_invalid_options_are_refused(words: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    refused = acrc("run", *words, "--out", tmp_path / "out")
    assert refused.returncode == 2 and refused.stderr.startswith(f"acrc: {sentence}")
    assert not (tmp_path / "out").exists()


HEAD = f'map = "{ROOT}/maps/corridor.yaml"\n[robots]\ncount = 2\n'


def scenario(folder: Path, text: str) -> Scenario:
    file = folder / "scenario.toml"
    file.write_text(HEAD + text)
    return load_scenario(file)


def test_unsupported_features_are_refused_by_name(tmp_path: Path) -> None:
    text = '[[robot]]\nid = "r1"\nodometry = "stage"\n'
    text += '[[event]]\nat = 6\nkill = "r2"\n[[event]]\nat = 7\nlose = "r2"\nof = "r1"\n'
    with pytest.raises(OptionError) as refused:
        hardware_in_the_loop.check_limits(scenario(tmp_path, text))
    assert "[[event]] kill: robots in real time have no conductor" in str(refused.value)
    assert 'odometry = "stage": emulated bases have the odometry errors of a Kobuki' in str(refused.value)


def test_shipped_scenarios_and_all_radio_settings_are_accepted(tmp_path: Path) -> None:
    for file in ("head_on.toml", "chapter.toml"):
        hardware_in_the_loop.check_limits(load_scenario(ROOT / "scenarios" / file))
    text = '[radio]\npreset = "beeclick"\nwalls = "concrete"\nshadowing_db = 4\ncorrelation_distance = 1\n'
    asked = scenario(tmp_path, text + SCENARIO.partition("shadowing_db = 2.0\n")[2])
    hardware_in_the_loop.check_limits(asked)
    plan = swarm.plan(asked, RunOptions(tmp_path / "out"))
    laboratory = Laboratory(LaboratorySetup(plan.world, plan.radio))
    laboratory.advance(Instant(20_000), lambda port, data: None)
    assert laboratory.medium.counters()["frames_sent"] == 0
