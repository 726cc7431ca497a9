"""One scenario and seed gives one digest on every transport and in every kind of process."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from actors.installation.repository import REPOSITORY
from actors.runtime.isolation.sandbox import available
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from observation.replay.recheck import recheck
from observation.results.result import RunResult

WAYS: Final[Mapping[str, Mapping[str, Any]]] = {
    "forked": {"isolate": False},
    "isolated": {"isolate": True},
    "executed": {"spawn": "exec", "isolate": False},
    "timed": {"speed": "20", "isolate": False},
}
NIGHTLY: Final = ("forked", "executed", "timed")


def run(out: Path, full: bool, **options: Any) -> RunResult:
    """Run four robots of the chapter for 120 s, or two for 3 s."""
    overrides = Overrides(duration=120.0) if full else Overrides(robots=2, duration=3.0)
    scenario = load_scenario(REPOSITORY / "scenarios" / "chapter.toml", overrides)
    return swarm.run(scenario, RunOptions(out, json=True, **options))


@pytest.fixture(scope="module")
def digest(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Digest of the run in memory."""
    full = bool(request.config.getoption("--full"))
    return run(tmp_path_factory.mktemp("memory") / "out", full, bus="memory").digest


@pytest.mark.claim("same-bits")
@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=[pytest.mark.nightly] if way in NIGHTLY else []) for way in WAYS]
)
def test_processes_have_the_digest_of_the_run_in_memory(
    way: str, digest: str, full: bool, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    if way == "isolated" and (reason := available()) is not None:
        pytest.skip(reason)
    result = run(tmp_path / "out", full, **WAYS[way])
    assert (result.digest, result.undelivered) == (digest, 0)
    if way == "isolated":
        replayed = recheck(tmp_path / "out").outputs  # raises if a replayed message differs
        record_property("messages replayed equal", replayed)
        assert replayed > 0
