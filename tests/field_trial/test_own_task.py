"""Field trials of a user's task are judged by its own judge, which the user must permit."""

from pathlib import Path

import pytest

from acrc_testbed.results.field_recordings import FieldTrialError, read_field_trial
from acrc_testbed.run_model.hardware_runs import collected_run
from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError
from actors.task.loading import load_task
from actors.user_code import FINDER
from deploy.fleet.collect import collect
from deploy.run import swarm
from deploy.run.options import RunOptions
from deploy.scenario.scenario_file import Overrides, load_scenario
from tests.field_trial.conftest import Run
from tests.field_trial.runs import clock, copies, rewrite, table
from tests.field_trial.test_collect import EPOCH, laboratory

BEACONS = f"""
map = "{REPOSITORY}/maps/corridor.yaml"
task = {{ use = "tests.field_trial.beacons:Beacons" }}
run = {{ duration = 4.0, strategy = "tests.field_trial.beacons:listen" }}
robots = {{ count = 2 }}

[[robot]]
id = "r1"
start = [12.0, 12.5, 0.0]
beacons = ["north", "south"]

[[robot]]
id = "r2"
start = [14.0, 12.5, 0.0]
beacons = ["east", "west", "up"]
"""


@pytest.fixture
def beacons(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Two robots that acknowledge beacons for 4 s; tasks of this repository are permitted."""
    monkeypatch.setattr(FINDER, "task_folders", (REPOSITORY,))
    file, out = tmp_path / "beacons.toml", tmp_path / "run"
    file.write_text(BEACONS)
    plan = swarm.plan(load_scenario(file, Overrides()), RunOptions(out, bus="memory", modules=(REPOSITORY,)))
    return Run(out, swarm.run_in_memory(plan, lambda progress: None))


@pytest.fixture
def far(beacons: Run, tmp_path: Path) -> Path:
    """Copy the recordings, with the clock of r2 a day ahead; the world's names the task."""
    clocks = {"r1": clock(EPOCH), "r2": clock(EPOCH + 86_400_000_000)}
    copies(beacons.out, tmp_path / "far", clocks)
    rewrite(beacons.out / "world" / "world.mcap", tmp_path / "far" / "world" / "world.mcap", {})
    return tmp_path / "far"


def test_the_task_that_a_recording_names_judges_reports(beacons: Run, far: Path, tmp_path: Path) -> None:
    ours = collect([far], tmp_path / "out")
    assert ours.task == {"acknowledged": 5, "apart_m": None}
    assert (ours.task_summary, ours.declaration) == ("acknowledged beacons", beacons.result.declaration)
    assert ours.notes == ()
    rows = table(tmp_path / "out" / "beacons.csv")
    assert [(row["name"], row["by"]) for row in rows] == [
        ("north", "r1"), ("east", "r2"), ("south", "r1"), ("west", "r2"), ("up", "r2"),
    ]  # fmt: skip
    seen = [int(row["at_us"]) for row in table(beacons.out / "beacons.csv")]
    assert [int(row["at_us"]) for row in rows] == pytest.approx(seen, abs=3000)
    truth = laboratory(beacons, tmp_path / "truth.json")
    assert collect([far], None, truth).task == beacons.result.task
    assert beacons.result.task["apart_m"] == 2.0


def test_a_task_that_is_not_permitted_is_not_loaded(far: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FINDER, "task_folders", ())
    load_task.cache_clear()
    sentence = "task 'tests.field_trial.beacons:Beacons': its module is not installed; name its folder with"
    with pytest.raises(AcrcError, match=sentence):
        collect([far])
    run = collected_run(far)
    assert run.description.task.name == "beacons" and any(sentence in note for note in run.notes)


def test_recordings_of_different_tasks_are_refused(head_on: Run, far: Path) -> None:
    with pytest.raises(FieldTrialError, match=r"of the tasks '.*Beacons' and 'cleaning.task:CleaningTask'"):
        read_field_trial([far, head_on.out / "world"])


def test_items_of_another_task_are_one_sentence(far: Path) -> None:
    (far / "world" / "world.mcap").unlink()
    with pytest.raises(AcrcError, match=r'/r1\.mcap: items\[0\] is "north", but must be a point \[x, y\]'):
        collect([far])
