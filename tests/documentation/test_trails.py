"""The pictures of docs/model-problem.md are what their command draws of a run as it is now."""

from pathlib import Path

import pytest

from deploy.repository import REPOSITORY
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from documentation import trails


@pytest.mark.parametrize("strategy", ["none", "chapter"])
def test_a_picture_is_that_of_a_run(strategy: str, tmp_path: Path) -> None:
    wishes = Overrides(strategy=strategy, duration=120.0)
    scenario = load_scenario(REPOSITORY / "scenarios" / "head_on.toml", wishes)
    plan = swarm.plan(scenario, RunOptions(tmp_path / "out", bus="memory", json=True))
    swarm.run_in_memory(plan, lambda progress: None)
    assert trails.main([str(tmp_path / "out"), str(tmp_path / "picture.svg")]) == 0
    kept = REPOSITORY / "docs" / "pictures" / f"head-on-{strategy}.svg"
    assert (tmp_path / "picture.svg").read_text() == kept.read_text(), (
        f"runs have changed: make {kept.name} anew, as docs/model-problem.md says"
    )


def test_what_is_missing_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert trails.main([]) == 2
    assert capsys.readouterr().err == "usage: python -m documentation.trails RUN PICTURE.svg\n"
