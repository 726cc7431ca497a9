"""A swarm whose robots speak serial bytes only: they drive, talk and clean, and the truth is known."""

import csv
import json
from pathlib import Path

import pytest

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
    assert min(robot["frames"]["copies_heard"] for robot in result["per_robot"].values()) > 0
    assert result == json.loads((out / "result" / "run.json").read_text())
    with (out / "result" / "places.csv").open() as table:
        assert {row["verdict"] for row in csv.DictReader(table)} == {"done"}
    again = acrc("record", "replay", out, "r2")
    assert again.returncode == 0 and "all equal to the recorded ones" in again.stdout, again.stderr
    base = acrc("record", "replay", out, "r2.base")
    assert (base.returncode, base.stdout, base.stderr) == (
        1, "", "acrc: r2.base: is a process with devices on board; must be a robot, world or radio\n"
    )  # fmt: skip
    assert processes_of(out) == [] and leftovers(out) == []


def test_what_cannot_be_in_wall_time_is_refused(tmp_path: Path) -> None:
    for words in (("--bus", "memory"), ("--view",), ("--speed", "4")):
        refused = acrc("run", "--hardware-in-the-loop", *words, "--out", tmp_path / "out")
        assert refused.returncode == 2
        assert refused.stderr == (
            "acrc: --hardware-in-the-loop: runs processes in wall time; "
            "must stand without --bus memory, --view, and a --speed other than 1\n"
        )
    assert not (tmp_path / "out").exists()
