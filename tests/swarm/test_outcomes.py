"""Outcomes of whole runs in memory: places done with and without adaptation, radio contact, the result."""

import csv
import json
from collections import Counter
from pathlib import Path
from typing import Any

import msgspec
import pytest

from acrc_testbed.recordings.run_recordings import read_setup
from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY as ROOT
from actors.radio.radio_model import RadioSetup
from actors.task.task import Value
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from deploy.scenario.tables import EventTable, Scenario
from tests.helpers import sampled
from tests.in_process import acrc
from tests.swarm import command

IN_THE_WAY = 26
"""Seed with which a finished robot blocks the other one for good."""
SAMPLE = (13,)
"""Seeds of the suite; others run nightly."""
HEAD_ON = ROOT / "scenarios" / "head_on.toml"


def head_on(strategy: str, seed: int, duration: float) -> Scenario:
    return load_scenario(HEAD_ON, Overrides(strategy=strategy, seed=seed, duration=duration))


def outcome(scenario: Scenario, out: Path) -> RunResult:
    return swarm.run_in_memory(swarm.plan(scenario, RunOptions(out, bus="memory")), lambda progress: None)


def done_total_lost(result: RunResult) -> tuple[Value, ...]:
    return tuple(result.task[f"places_{name}"] for name in ("done", "total", "lost"))


@pytest.mark.parametrize("seed", sampled((seed for seed in range(1, 21) if seed != IN_THE_WAY), SAMPLE))
def test_with_the_strategy_chapter_all_places_are_cleaned(seed: int, tmp_path: Path) -> None:
    result = outcome(head_on("chapter", seed, 600.0), tmp_path / "out")
    assert done_total_lost(result) == (6, 6, 0)


@pytest.mark.parametrize(("make_way", "done"), [(False, 5), (True, 6)])
def test_a_finished_robot_may_have_to_make_way(make_way: bool, done: int, tmp_path: Path) -> None:
    scenario = msgspec.structs.replace(head_on("chapter", IN_THE_WAY, 150.0), strategy={"make_way": make_way})
    result = outcome(scenario, tmp_path / "out")
    assert done_total_lost(result) == (done, 6, 0)


@pytest.mark.parametrize("seed", sampled((1, 2), (1,)))
def test_without_adaptation_robots_stay_blocked(seed: int, tmp_path: Path) -> None:
    result = outcome(head_on("none", seed, 60.0), tmp_path / "out")
    assert done_total_lost(result) == (0, 6, 0) and result.simulated_s == 60.0


@pytest.mark.nightly
@pytest.mark.parametrize("strategy", ["released", "examples.courteous:behaviour"])
def test_the_released_code_and_the_shipped_example_clean_all_places(strategy: str, tmp_path: Path) -> None:
    result = outcome(head_on(strategy, 5, 300.0), tmp_path / "out")
    assert done_total_lost(result) == (6, 6, 0)


@pytest.mark.parametrize(("exchange", "done"), [(True, 2), (False, 1)])
def test_a_late_adoption_requires_the_exchange(exchange: bool, done: int, tmp_path: Path) -> None:
    """Without it, r2 loses its only place and blocks the passage for r1 for good."""
    scenario = head_on("chapter", 1, 120.0)
    asleep = (EventTable(at=18.0, freeze="r2"), EventTable(at=18.2, thaw="r2"))  # when both adopt
    r1 = msgspec.structs.replace(scenario.robot[0], items=((9.0, 12.5),))
    changed = {
        "task_settings": {"per_robot": 1},
        "robot": (r1,),
        "event": asleep,
        "strategy": {"exchange": exchange},
    }
    result = outcome(msgspec.structs.replace(scenario, **changed), tmp_path / "out")
    assert done_total_lost(result) == (done, 2, 0)


@pytest.mark.parametrize("seed", sampled(range(1, 11), (5,)))
def test_a_robot_alone_cleans_all_its_places(seed: int, tmp_path: Path) -> None:
    overrides = Overrides(robots=1, seed=seed, duration=600.0)
    result = outcome(load_scenario(ROOT / "scenarios" / "corridor.toml", overrides), tmp_path / "out")
    assert done_total_lost(result) == (10, 10, 0)
    assert result.task["completion_s"] is not None


def run(out: Path, *words: object) -> dict[str, Any]:
    done = acrc("run", *words, "--bus", "memory", "--out", out, "--json")
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout)
    return result


TWO = f"""
map = "{ROOT / "maps" / "corridor.yaml"}"
[run]
duration = 3.0
[robots]
count = 2
start = [[12.0, 5.0, 0.0], [17.5, 5.0, 0.0]]
[places]
preset = "free"
per_robot = 1
[radio]
preset = "chapter"
"""


def test_the_radio_of_many_robots_reaches_some_and_is_counted_in_octets(tmp_path: Path) -> None:
    # 30 s: later, robots have stopped
    result = run(tmp_path / "out", ROOT / "scenarios" / "chapter.toml", "--duration", "30")
    frames = result["frames"]
    assert 0.3 < result["direct_reach"] < 0.8
    assert not any(name.startswith("pairs") for name in frames) and frames["copies_heard"] > 0
    sent, octets = frames["frames_sent"], frames["bytes_sent"]
    assert sent >= result["robots"] * 20 and sent * (9 + 1) < octets < sent * 127
    assert result["radio_bytes_per_robot_s"] == round(octets / result["robots"] / 30.0, 3)


@pytest.mark.parametrize(("walls", "share"), [("air", 1.0), ("concrete", 0.0)])
def test_walls_of_the_map_attenuate(tmp_path: Path, walls: str, share: float) -> None:
    scenario = tmp_path / "two.toml"
    scenario.write_text(f'{TWO}walls = "{walls}"\n')
    result = run(tmp_path / walls, scenario)
    assert result["direct_reach"] == share
    setup = read_setup(tmp_path / walls / "radio" / "radio.mcap", RadioSetup, "a radio")
    assert (setup.walls, setup.preset) == (walls, "chapter")


def test_wifi_spoils_frames_of_robots_nearby(tmp_path: Path) -> None:
    quiet = tmp_path / "quiet.toml"
    quiet.write_text(TWO.replace("3.0", '20.0\nstrategy = "chapter"') + 'walls = "air"\n')
    noisy = tmp_path / "noisy.toml"
    noisy.write_text(quiet.read_text() + "[[wifi]]\nat = [14.0, 5.0]\nchannel = 1\nduty = 0.5\n")
    without, with_wifi = (run(tmp_path / file.stem, file)["frames"] for file in (quiet, noisy))
    assert without["copies_heard"] > with_wifi["copies_heard"]
    assert without["copies_lost_disturbed"] == 0 and with_wifi["copies_lost_disturbed"] > 10


REPORTING = f"""
map = "{ROOT / "maps" / "corridor.yaml"}"

[run]
duration = 6.0
strategy = "tests.swarm.reporting:behaviour"

[robots]
count = 2

[places]
preset = "free"
per_robot = 4

[[event]]
at = 5.0
restart = "r2"
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    path = tmp_path / "reporting.toml"
    path.write_text(REPORTING)
    return path


@pytest.mark.parametrize("bus", ["memory", pytest.param("zenoh", marks=pytest.mark.nightly)])
def test_the_result_contains_reports_of_robots(scenario: Path, tmp_path: Path, bus: str) -> None:
    make = run if bus == "memory" else command.run
    result = make(tmp_path / "out", scenario, "--modules", ROOT)
    assert result["simulated_s"] == 6.0  # open places of r2, and the event, extend the run
    names = ("places_total", "places_done", "places_claimed", "places_given_up", "places_lost")
    task = result["task"]
    assert [task[name] for name in names] == [8, 0, 1, 4, 0]  # the restarted r2 has all its places
    assert (task["completion_s"], task["settled_s"], task["last_reached_s"]) == (None, None, 3.0)
    about_poses = result["per_robot"]["r1"].pop("pose_error")
    assert (about_poses["samples"], about_poses["times_lost"]) == (60, 0) and about_poses["rmse"] < 0.1
    ways = [part.pop("driven_m") for part in result["per_robot"].values()]
    assert result.pop("driven_m") == pytest.approx(sum(ways), abs=0.01)
    assert result["per_robot"]["r1"]["task"] == {
        "places_total": 4, "places_done": 0, "places_claimed": 0, "places_given_up": 4, "completion_s": None
    }  # fmt: skip
    assert result["radio_bytes_per_robot_s"] == 0.0
    assert result["deeco"] == {
        "counters": {"activations": 60 + 50 + 10, "published": 3},  # r1, r2, and r2 once more
        "exchanges": {"Meeting": 6},
        "replica_age_mean_s": 0.45,
        "replica_age_p95_s": 0.9,
    }
    with (tmp_path / "out" / "places.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["owner"], row["place"]) for row in rows] == [
        (r, str(p)) for r in ("r1", "r2") for p in range(4)
    ]
    assert Counter(row["verdict"] for row in rows) == {"given up": 4, "open": 3, "mistaken": 1}
    assert {row["reason"] for row in rows[:4]} == {"stands still"}
    assert [row["in_route_of"] for row in rows] == [""] * 4 + ["r2"] * 4
    written = json.loads((tmp_path / "out" / "run.json").read_text())
    assert written["per_robot"]["r1"].pop("pose_error") == about_poses
    assert [part.pop("driven_m") for part in written["per_robot"].values()] == ways
    del written["driven_m"]
    assert written == result


def test_a_place_on_no_route_is_lost(scenario: Path, tmp_path: Path) -> None:
    scenario.write_text(REPORTING.replace('restart = "r2"', 'kill = "r1"'))
    result = run(tmp_path / "out", scenario, "--modules", ROOT)
    assert result["task"]["places_lost"] == 1  # the last of r2's
    assert acrc("record", "check", tmp_path / "out").returncode == 0


def test_a_malformed_report_of_a_node_is_named_and_not_counted(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--strategy", "tests.swarm.reporting:malformed", "--robots", 1, "--duration", 1)
    done = acrc("run", *words, "--bus", "memory", "--out", out)
    assert done.returncode == 0, done.stderr
    sentence = (
        f"r1: malformed node report, not counted: {out}/r1/r1.mcap: "
        "outcome 'deeco' is not that of a node: counters[…] is wrong, but must be a whole number"
    )
    assert sentence in done.stdout.splitlines()
    result = json.loads((out / "run.json").read_text())
    assert result["refused_reports"] == [sentence] and result["deeco"]["counters"] == {}
