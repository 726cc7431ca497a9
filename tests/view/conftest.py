"""One run of the meeting in the doorway, looked into once; what needs rerun is left out where it is not."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.isolation import sandbox
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.evidence.run_evidence import RunEvidence
from observation.evidence.run_reader import read_run
from observation.trace.rows import Trace
from observation.trace.traces import Traced, traces

collect_ignore = (
    []
    if find_spec("rerun")
    else ["test_drawn.py", "test_following.py", "test_inside.py", "test_watched.py", "test_window.py"]
)


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots that localise, for half a minute: they meet, one adopts the other's place."""
    out = tmp_path_factory.mktemp("view") / "run"
    shipped = (REPOSITORY / "scenarios" / "head_on.toml").read_text()
    own = shipped.replace('"odometry"', '"chapter"').replace("../maps", str(REPOSITORY / "maps"))
    scenario = out.parent / "head_on.toml"
    scenario.write_text(own)
    settled = load_scenario(scenario, Overrides(duration=30.0))
    swarm.run_in_memory(swarm.plan(settled, RunOptions(out, bus="memory")), lambda progress: None)
    return out


@pytest.fixture(scope="session")
def evidence(folder: Path) -> RunEvidence:
    return read_run(folder)


@pytest.fixture(scope="session")
def traced(folder: Path, evidence: RunEvidence) -> list[Traced]:
    """World and robots, each in a sandbox where the machine has one."""
    isolate = sandbox.available() is None
    return list(traces(folder, ["world", *evidence.robots], permit=INSTALLED, isolate=isolate))


@pytest.fixture(scope="session")
def insides(traced: list[Traced]) -> dict[str, Trace]:
    """The trace of each robot."""
    found = {one.actor: one.whole() for one in traced if one.parts}
    assert sorted(found) == ["r1", "r2"], traced
    return found
