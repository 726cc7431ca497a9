"""Simulated runs to collect again, made once for all tests, and their rewritten copies."""

import csv
from collections.abc import Callable, Mapping
from pathlib import Path

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.results.result import RunResult
from tests.field_trial.rewriting import Clock, rewrite

CROWD = f"""
map = "{REPOSITORY / "maps" / "corridor.yaml"}"

[run]
duration = 60.0
seed = 3

[robots]
count = 4

[places]
preset = "free"
per_robot = 3

[[event]]
at = 10.0
kill = "r4"

[[event]]
at = 30.0
restart = "r2"
"""


def run(scenario: Path, out: Path, duration: float) -> RunResult:
    """Run in memory."""
    settled = load_scenario(scenario, Overrides(duration=duration))
    return swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)


def copies(run: Path, to: Path, clocks: Mapping[str, Clock], late: Callable[[], int] = lambda: 0) -> Path:
    """Every robot's recordings as its clock would have stamped them, each in its folder of `to`."""
    for robot, clock in clocks.items():
        for path in sorted((run / robot).glob("*.mcap")):
            rewrite(path, to / robot / path.name, {robot: clock}, late=late)
    return to


def table(path: Path) -> list[dict[str, str]]:
    """The rows of a places.csv."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
