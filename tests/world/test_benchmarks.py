"""Benchmarks of the world: they run and measure the right thing; speed is not tested."""

from pathlib import Path
from unittest.mock import patch

from acrc_testbed.benchmarks import world

CORRIDOR = Path(__file__).parents[2] / "maps" / "corridor.yaml"


def test_scans_agree_with_pymunk_on_the_corridor() -> None:
    task = world.ScanTask(rays=(64, 640), robots=10, repeats=1, peer_repeats=1)
    found = world.measure_scans(CORRIDOR, task)
    for speed in found.figures["speeds"]:
        assert speed["median_difference_mm"] <= 0.5 and speed["disagreements"] < 0.002
    assert str(found.shown[-1]).startswith("goal, mm from pymunk with 640 rays, at most 5: ")


def test_the_benchmark_compares_the_world_with_stage() -> None:
    task = world.WorldTask(robots=(4, 20), rays=(60,), seconds_long=2, repeats=1)
    small = world.ScanTask(rays=(64,), robots=2, repeats=1, peer_repeats=1)
    with patch.object(world, "ScanTask", lambda: small):
        found = world.measure(CORRIDOR, task)
    speeds, said = found.figures["speeds"], [str(one) for one in found.shown]
    assert [(speed["robots"], speed["stage"]) for speed in speeds] == [(4, 422.0), (20, 61.0)]
    assert all(speed["speed"] > 0 and speed["ratio"] > 0 for speed in speeds)
    assert any(one.startswith("goal, minimum speed relative to Stage, at least 1:") for one in said)
    assert [one["rays"] for one in found.figures["scans"]["speeds"]] == [64]
