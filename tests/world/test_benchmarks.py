"""That the benchmarks of the world run and measure what they say; never how fast anything is."""

import json
from pathlib import Path

import pytest

from benchmarks.world import navground_peer, scan, world

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


def test_scans_agree_with_pymunk_on_the_corridor(capsys: pytest.CaptureFixture[str]) -> None:
    task = scan.ScanTask(rays=(64, 640), robots=10, repeats=1, peer_repeats=1)
    figures = scan.run(CORRIDOR, json_output=True, task=task)
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(figures))
    for speed in figures["speeds"]:
        assert speed["median_difference_mm"] <= 0.5 and speed["disagreements"] < 0.002
    scan.run(CORRIDOR, task=task)
    assert "goal, at least 20 times pymunk, at most 5 mm:" in capsys.readouterr().out


def test_the_world_is_measured_beside_stage(capsys: pytest.CaptureFixture[str]) -> None:
    task = world.WorldTask(robots=(4, 20), rays=(60,), seconds_long=2, repeats=1)
    figures = world.run(CORRIDOR, task=task)
    printed = capsys.readouterr().out
    assert [(speed["robots"], speed["stage"]) for speed in figures["speeds"]] == [(4, 422.0), (20, 61.0)]
    assert all(speed["speed"] > 0 and speed["ratio"] > 0 for speed in figures["speeds"])
    missing = navground_peer.version() is None
    assert ("navground is not installed: it was NOT measured." in printed) == missing
    world.run(CORRIDOR, json_output=True, task=task)
    assert json.loads(capsys.readouterr().out)["stage"] == "Stage 4.3, one core of such a machine"
