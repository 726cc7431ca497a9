"""A robot alone has nobody in its way: it cleans all of its places in time, from every seed."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.seeds import sampled

SAMPLE = (4,)
"""The seed of every day, one of those that take the longest; the others are left to the night."""


@pytest.mark.parametrize("seed", sampled(range(1, 11), SAMPLE))
def test_a_robot_alone_cleans_all_its_places(seed: int, tmp_path: Path) -> None:
    corridor = REPOSITORY / "scenarios" / "corridor.toml"
    scenario = load_scenario(corridor, Overrides(robots=1, seed=seed, duration=600.0))
    plan = swarm.plan(scenario, RunOptions(tmp_path / "out", bus="memory"))
    result = swarm.run_in_memory(plan, lambda progress: None)
    assert (result.places_done, result.places_total) == (10, 10)
    assert result.completion_s is not None and result.completion_s <= 600.0
