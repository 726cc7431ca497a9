"""What a run leaves: the result and the table of places, the same over processes and in memory."""

import csv
import json
from collections import Counter
from pathlib import Path

import pytest

from tests.swarm.command import ROOT, acrc, run

SCENARIO = f"""
map = "{ROOT / "maps" / "corridor.yaml"}"

[run]
duration = 6.0
strategy = "tests.swarm.witness:behaviour"

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
    path = tmp_path / "witnesses.toml"
    path.write_text(SCENARIO)
    return path


@pytest.mark.parametrize("bus", ["zenoh", "memory"])
def test_everything_that_was_said_is_in_the_result(scenario: Path, tmp_path: Path, bus: str) -> None:
    result = run(tmp_path / "out", scenario, "--bus", bus, "--modules", ".")
    assert result["simulated_s"] == 6.0  # the places that r2 leaves open, and the event, keep it going
    names = ("places_total", "places_done", "places_claimed", "places_given_up", "places_lost")
    assert [result[name] for name in names] == [
        8,
        0,
        1,
        4,
        0,
    ]  # started again, r2 has all of its places again
    assert (result["completion_s"], result["settled_s"], result["last_reached_s"]) == (None, None, 3.0)
    about_poses = result["per_robot"]["r1"].pop("pose_error")
    assert (about_poses["samples"], about_poses["times_lost"]) == (60, 0) and about_poses["rmse"] < 0.1
    ways = [part.pop("driven_m") for part in result["per_robot"].values()]
    assert result.pop("driven_m") == pytest.approx(sum(ways), abs=0.01)
    assert result["per_robot"]["r1"] == {
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
    assert {row["reason"] for row in rows[:4]} == {"only a witness"}
    assert [row["in_route_of"] for row in rows] == [""] * 4 + ["r2"] * 4
    written = json.loads((tmp_path / "out" / "run.json").read_text())
    assert written["per_robot"]["r1"].pop("pose_error") == about_poses
    assert [part.pop("driven_m") for part in written["per_robot"].values()] == ways
    del written["driven_m"]
    assert written == result


def test_a_place_that_nobody_means_to_visit_is_lost(scenario: Path, tmp_path: Path) -> None:
    scenario.write_text(SCENARIO.replace('restart = "r2"', 'kill = "r1"'))
    result = run(tmp_path / "out", scenario, "--bus", "memory", "--modules", ".")
    assert result["places_lost"] == 1  # the last of r2's
    assert acrc("record", "check", tmp_path / "out").returncode == 0


def test_the_air_is_counted_in_octets(tmp_path: Path) -> None:
    corridor = ROOT / "scenarios" / "corridor.toml"
    result = run(tmp_path / "out", corridor, "--bus", "memory", "--robots", 3, "--duration", 20)
    sent, octets = result["frames"]["frames_sent"], result["frames"]["bytes_sent"]
    assert sent == 60 and sent * (9 + 1) < octets < sent * 127
    assert result["radio_bytes_per_robot_s"] == round(octets / 3 / 20.0, 3)


def test_what_is_no_outcome_of_a_node_is_one_sentence_and_not_counted(tmp_path: Path) -> None:
    out = tmp_path / "out"
    words = ("--strategy", "tests.swarm.witness:liar", "--robots", 1, "--duration", 1, "--bus", "memory")
    done = acrc("run", *words, "--out", out)
    assert done.returncode == 0, done.stderr
    sentence = (
        f"r1: what it says of its node cannot be, and is not counted: {out}/r1/r1.mcap: "
        "the outcome 'deeco' is not that of a node: counters[…] is wrong, but must be a whole number"
    )
    assert sentence in done.stdout.splitlines()
    result = json.loads((out / "run.json").read_text())
    assert result["refused_reports"] == [sentence] and result["deeco"]["counters"] == {}
