"""One short run in which two robots block each other and exchange destinations; nobody changes its folder."""

from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario


@pytest.fixture(scope="session")
def met(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots for twenty seconds, in memory: r2 adopts r1's destination at 15 s, r1 r2's at 18 s."""
    out = tmp_path_factory.mktemp("met") / "out"
    settled = load_scenario(
        REPOSITORY / "scenarios" / "head_on.toml", Overrides(duration=20.0, strategy="chapter")
    )
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out
