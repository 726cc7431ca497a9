"""One short run, whose recordings are then damaged in copies."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario

Copy = Callable[[], Path]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots for three seconds, in memory."""
    out = tmp_path_factory.mktemp("recorded") / "out"
    settled = load_scenario(REPOSITORY / "scenarios" / "head_on.toml", Overrides(duration=3.0))
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out


@pytest.fixture
def copy(recorded: Path, tmp_path: Path) -> Path:
    """A copy of its folder, to be damaged."""
    return shutil.copytree(recorded, tmp_path / "copy")
