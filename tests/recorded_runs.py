"""Recorded runs in memory: three fixtures with session scope, and a function that records others.

All tests of a worker share the folders of the three runs. A test that changes files works on a copy.
"""

import math
import shutil
from pathlib import Path
from typing import Any

import pytest

from acrc_testbed.results.result import RunResult
from actors.installation.repository import REPOSITORY
from actors.runtime.process_setup import RecordDetail
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.tables import Scenario

HEAD_ON = REPOSITORY / "scenarios" / "head_on.toml"


def record(
    out: Path, scenario: Path | str | Scenario = HEAD_ON, *, detail: RecordDetail = "full", **overrides: Any
) -> RunResult:
    """Run a scenario in memory; `scenario`: a file, its text, or a loaded scenario.

    Map paths in a text are relative to the folder `scenarios` of this project. `overrides`: see `Overrides`.
    """
    if isinstance(scenario, str):
        settled = parse(scenario, HEAD_ON.parent / "of_a_test.toml", Overrides(**overrides))
    elif isinstance(scenario, Path):
        settled = load_scenario(scenario, Overrides(**overrides))
    else:
        assert not overrides
        settled = scenario
    options = RunOptions(out, bus="memory", record=detail, timeout_s=math.inf)  # pytest has a timeout
    return swarm.run_in_memory(swarm.plan(settled, options), lambda progress: None)


@pytest.fixture(scope="session")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run: two robots approach each other for three seconds (180 kB)."""
    out = tmp_path_factory.mktemp("short") / "run"
    record(out, duration=3.0)
    return out


@pytest.fixture(scope="session")
def recorded_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run of 30 s: two robots localise by AMCL, meet in a door and exchange destinations."""
    out = tmp_path_factory.mktemp("recorded") / "run"
    record(out, HEAD_ON.read_text().replace('"odometry"', '"chapter"'), duration=30.0)
    return out


@pytest.fixture(scope="session")
def complete_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run to its end after 99 s: two robots with exact poses have cleaned all six places."""
    out = tmp_path_factory.mktemp("complete") / "run"
    record(out)
    return out


@pytest.fixture
def short_run_copy(short_run: Path, tmp_path: Path) -> Path:
    """Copy of the folder, to be changed."""
    return shutil.copytree(short_run, tmp_path / "copy")
