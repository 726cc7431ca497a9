"""Two short runs in memory in which the causes of decisions were planted; nobody changes their folders."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario, parse

PLANTED = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"

[run]
duration = 16.0
seed = 1
strategy = "tests.explanation.planted:behaviour"

[deeco]
relay = true

[robots]
count = 4
start = [[6.5, 12.5, 0.0], [13.0, 12.5, 0.0], [20.0, 12.5, 0.0], [12.0, 11.5, 0.0]]

[localisation]
preset = "odometry"

[navigation]
preset = "robust"

[places]
preset = "golden"
per_robot = 1

[[event]]
at = 4.9
jam = [13.0, 12.5]
radius = 3.0
duration = 3.0
"""
"""r2 and r4 hear nothing from 4.9 s to 7.9 s; r3 is too far from r1 to hear it."""


def _run(out: Path, scenario_text: str) -> Path:
    settled = parse(scenario_text, REPOSITORY / "planted.toml")
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out


@pytest.fixture(scope="session")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _run(tmp_path_factory.mktemp("planted") / "out", PLANTED)


@pytest.fixture(scope="session")
def doorway(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The chapter's robots in a doorway for a minute."""
    out = tmp_path_factory.mktemp("doorway") / "out"
    settled = load_scenario(REPOSITORY / "scenarios" / "head_on.toml", Overrides(duration=64.0))
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out
