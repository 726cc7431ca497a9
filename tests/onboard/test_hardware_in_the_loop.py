"""A swarm whose robots speak serial bytes only: they drive, talk and clean, and the truth is known."""

import csv
import json
from pathlib import Path

import pytest

from actors.radio.robot_medium import COPIES
from tests.swarm.command import ROOT, acrc, leftovers, processes_of

SCENARIO = f"""
map = "{ROOT}/maps/corridor.yaml"
[run]
duration = 80.0
strategy = "chapter"
[robots]
count = 2
[[robot]]
id = "r1"
start = [9.0, 12.5, 0.0]
places = [[10.5, 12.5]]
[[robot]]
id = "r2"
start = [13.0, 12.5, 0.0]
places = [[13.2, 12.6], [11.8, 12.2]]
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
def test_two_robots_clean_their_places_by_serial_bytes(tmp_path: Path) -> None:
    scenario, out = tmp_path / "near.toml", tmp_path / "out"
    scenario.write_text(SCENARIO)
    done = acrc("run", scenario, "--hardware-in-the-loop", "--out", out, "--json", timeout_s=200.0)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["places_claimed"], result["places_done"], result["places_total"]) == (3, 3, 3)
    assert result["contacts"] == 0
    frames = {robot: part["frames"] for robot, part in result["per_robot"].items()}
    assert min(part["copies_heard"] for part in frames.values()) > 0
    assert all(part["frames_handed"] >= part["frames_sent"] > 0 for part in frames.values())
    jammed = (result["frames"]["copies_lost_disturbed"], frames["r2"]["frames_access_failure"])
    assert min(jammed) > 0, jammed  # four seconds, in which r2 neither hears nor finds the channel clear
    assert sum(result["frames"][name] for name in COPIES) == result["frames"]["frames_sent"]
    assert result == json.loads((out / "result" / "run.json").read_text())
    with (out / "result" / "places.csv").open() as table:
        assert {row["verdict"] for row in csv.DictReader(table)} == {"done"}
    again = acrc("replay", out, "--robot", "r2")
    assert again.returncode == 0 and ": identical: " in again.stdout, again.stderr
    base = acrc("replay", out, "--robot", "r2.base")
    assert (base.returncode, base.stdout, base.stderr) == (
        1, "", "acrc: r2.base: is a process with devices on board; must be a robot, world or radio\n"
    )  # fmt: skip
    assert processes_of(out) == [] and leftovers(out) == []


def test_a_board_of_nobodys_is_refused(tmp_path: Path) -> None:
    for words, sentence in (
        (("--board", "r1"), "acrc: --board: r1; requires --hardware-in-the-loop\n"),
        (
            ("--hardware-in-the-loop", "--board", "r9"),
            "acrc: --board: r9; must be a robot of the scenario: r1, r2, r3, r4\n",
        ),
    ):
        refused = acrc("run", *words, "--out", tmp_path / "out")
        assert (refused.returncode, refused.stderr) == (2, sentence)
    assert not (tmp_path / "out").exists()


def test_what_cannot_be_in_wall_time_is_refused(tmp_path: Path) -> None:
    for words in (("--bus", "memory"), ("--view",), ("--speed", "4")):
        refused = acrc("run", "--hardware-in-the-loop", *words, "--out", tmp_path / "out")
        assert refused.returncode == 2
        assert refused.stderr == (
            "acrc: --hardware-in-the-loop: runs processes in wall time; "
            "cannot be combined with --bus memory, --view or a --speed other than 1\n"
        )
    assert not (tmp_path / "out").exists()
