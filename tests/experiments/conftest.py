"""Fixtures of the tests of comparisons."""

import pytest

from acrc_testbed.results.result import RunResult
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario


@pytest.fixture(scope="session")
def plain(tmp_path_factory: pytest.TempPathFactory) -> RunResult:
    """Return the result of a real run, to be varied by tests."""
    out = tmp_path_factory.mktemp("runs") / "out"
    plan = swarm.plan(load_scenario(None, Overrides(robots=1, duration=1)), RunOptions(out, bus="memory"))
    return swarm.run_in_memory(plan, lambda progress: None)
