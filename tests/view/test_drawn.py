"""The view file of a run, read back without a window: every entity that a person looks at is there."""

from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from actors.observer.sheet import APPLICATION
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.errors import AcrcError
from command_line import look
from observation.accounting.account import spells
from observation.accounting.time_spent import Cause
from observation.evidence.run_evidence import RunEvidence
from observation.explanation.explain import Explainer
from observation.trace.rows import Trace
from observation.trace.traces import Traced
from observation.view import beside, drawn
from observation.view.drawn import Wishes, draw, place, read_story
from tests.view.rrd import Rows, rows

pytestmark = pytest.mark.usefixtures("strict")
WORLD = {
    *("map", "robots/r1", "robots/r1/turn", "robots/r1/turn/body", "robots/r1/turn/nose", "robots/r1/name"),
    *("trails/r1", "history/r1", "places/r1", "intent/r1", "heading/r1", "radio/links", "radio/losses"),
}
INSIDE = {"scan", "particles", "estimate", "costs", "plan", "arc"}


@pytest.fixture
def computed(monkeypatch: pytest.MonkeyPatch, insides: dict[str, Trace]) -> None:
    """Robots are looked into once for all tests."""
    traced = [Traced(actor, (inside,)) for actor, inside in insides.items()]
    monkeypatch.setattr(drawn, "traces", lambda *words, **more: iter(traced))


def of(found: Rows, entity: str, component: str) -> list[tuple[float, Any]]:
    """What one component was, and from when on."""
    return [
        (row["sim_time"].total_seconds(), row[component])
        for row in found[entity]
        if "sim_time" in row and row.get(component) is not None
    ]


def test_everything_that_a_person_looks_at_is_in_the_file(
    folder: Path, evidence: RunEvidence, insides: dict[str, Trace], computed: None, tmp_path: Path
) -> None:
    said: list[str] = []
    path = tmp_path / "run.rrd"
    draw(read_story(folder), path, Wishes(why=True), send_to=None, say=said.append)
    assert [sentence.partition(" after ")[0] for sentence in said] == ["first picture", "all of it"]
    assert said[-1].endswith("with what 2 robots perceived and meant")
    assert not path.with_name("run.rrd.part").exists()
    found = rows(path)
    assert {f"/world/{name}" for name in WORLD} <= set(found)
    assert {f"/inside/r2/{name}" for name in INSIDE} <= set(found)
    assert {"/r1", "/knowledge/r1", "/plots/places/r1", "/plots/error/r1", "/plots/speed/r2"} <= set(found)
    assert {"/plots/copies/heard", "/plots/rssi/r1_at_r2", "/plots/ages/r2_at_r1"} <= set(found)
    assert {"/ensembles/robots", "/ensembles/exchanges"} <= set(found)
    poses = of(found, "/world/robots/r1", "Transform3D:translation")
    np.testing.assert_allclose([second for second, _ in poses], evidence.seconds, atol=1e-6)
    np.testing.assert_allclose(np.array([at[0][:2] for _, at in poses]), evidence.true[:, 0, :2], atol=1e-4)
    clouds = of(found, "/inside/r1/scan", "Points3D:positions")
    assert [len(cloud) for _, cloud in clouds] == insides["r1"].scans.counts.tolist()
    states = [state[0] for _, state in of(found, "/r1", "StateChange:state")]
    assert any(state.startswith("to r1/") for state in states) and any("blocked" in state for state in states)
    truth = [one for one in spells(evidence) if one.robot == "r1" and one.cause is Cause.DEADLOCK]
    lane = [(second, state[0]) for second, state in of(found, "/r1", "StateChange:state")]
    assert [second for second, state in lane if state == "deadlock"] == [one.begin for one in truth] != []
    assert lane[-1] == (evidence.end, ""), "the lane ends with the run"
    assert "/legend/marks" in found and "/legend/copies" in found
    table = of(found, "/knowledge/r2", "TextDocument:text")[-1][1][0]
    assert "| position |" in table and "| route |" in table
    reasons = of(found, "/why/r2", "TextDocument:text")
    assert [second for second, _ in reasons] == sorted(
        {row.at_s for row in Explainer(folder, permit=INSTALLED, isolate=False).listed("r2")}
    )
    assert any("| takes over" in text[0] or "r2 takes over" in text[0] for _, text in reasons)
    assert any(words[0].startswith("r1 ") for _, words in of(found, "/events/r1/inside", "TextLog:text"))


def test_a_view_that_lacks_something_says_so_and_fails(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(drawn, "compute", lambda *_, **__: ["r1: may not run"])
    wishes, path = ((), INSTALLED, False, False), tmp_path / "run.rrd"
    for folders in ([folder], [folder, folder]):
        monkeypatch.setattr(beside, "compute", drawn.compute)
        with pytest.raises(AcrcError, match="the view lacks what is named above"):
            look._show(folders, wishes, save=path, screenshot=None, at=None)
        *_, fault, last = capsys.readouterr().err.splitlines()
        assert fault.endswith("r1: may not run") and last.endswith(" s, without what is named above")
    assert path.is_file()


def test_the_layout_is_saved_in_the_file_and_robots_may_be_chosen(
    folder: Path, computed: None, tmp_path: Path
) -> None:
    path = tmp_path / "run.rrd"
    draw(read_story(folder), path, Wishes(robots=("r2",)), send_to=None, say=lambda sentence: None)
    (blueprint,) = RrdReader(str(path)).blueprints()
    assert blueprint.application_id == APPLICATION
    found = rows(path)
    assert "/inside/r2/scan" in found and "/inside/r1/scan" not in found
    assert {"/r1", "/knowledge/r1", "/world/intent/r1"} <= set(found)


def test_two_runs_stand_beside_one_another_on_one_timeline(
    folder: Path, computed: None, tmp_path: Path
) -> None:
    copytree(folder, tmp_path / "branch")
    said: list[str] = []
    path = tmp_path / "beside.rrd"
    beside.save((folder, tmp_path / "branch"), Wishes(), path, said.append)
    assert [sentence.partition(" after ")[0] for sentence in said] == ["first picture", "all of it"]
    draw(read_story(folder), tmp_path / "one.rrd", Wishes(), send_to=None, say=lambda sentence: None)
    one, both = rows(tmp_path / "one.rrd"), rows(path)
    drawn_there = {entity for entity in one if entity != "/__properties"}
    assert set(both) - {"/__properties"} == {f"/{n}{entity}" for n in (1, 2) for entity in drawn_there}
    for entity in ("/world/robots/r1", "/inside/r2/scan", "/r1", "/world/radio/losses"):
        whens = [[row.get("sim_time") for row in some] for some in (one[entity], both[f"/2{entity}"])]
        assert whens[0] == whens[1]
    with pytest.raises(AcrcError):
        beside.save((folder, tmp_path / "nowhere"), Wishes(), path, said.append)


def test_a_robot_that_cannot_be_executed_again_is_drawn_from_outside(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    traced = [Traced("r1", fault="r1: not to be trusted"), Traced("r2", fault="r2: neither")]
    monkeypatch.setattr(drawn, "traces", lambda *words, **more: iter(traced))
    said: list[str] = []
    draw(read_story(folder), tmp_path / "run.rrd", Wishes(), send_to=None, say=said.append)
    assert said[1:3] == ["r1: not to be trusted", "r2: neither"]
    found = rows(tmp_path / "run.rrd")
    assert {state[0] for _, state in of(found, "/r1", "StateChange:state")} & {"driving", "standing"}
    assert "/inside/r1/scan" not in found


def test_what_robots_alone_recorded_is_drawn_by_what_they_held(
    folder: Path, evidence: RunEvidence, computed: None, tmp_path: Path
) -> None:
    for robot in ("r1", "r2"):
        copytree(folder / robot, tmp_path / "trial" / robot)
    story = read_story(tmp_path / "trial")
    assert not story.true and story.robots == ("r1", "r2")
    assert len(story.heard) == len(evidence.receptions) > 0
    assert [deed.place for deed in story.reported] == [deed.place for deed in evidence.reported]
    held = evidence.held[:, 0]
    known = np.isfinite(story.tracks["r1"].poses[:, 0])
    np.testing.assert_allclose(story.tracks["r1"].poses[known], held[np.isfinite(held[:, 0])])
    draw(story, tmp_path / "trial.rrd", Wishes(), send_to=None, say=lambda sentence: None)
    found = rows(tmp_path / "trial.rrd")
    assert "/inside/r1/scan" in found and "/plots/error/r1" not in found
    assert "/plots/copies/heard" not in found


def test_a_folder_in_which_nobody_may_write_gets_its_view_elsewhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert place(folder) == folder / "view.rrd"
    monkeypatch.setattr("os.access", lambda path, mode: False)
    elsewhere = place(folder)
    assert elsewhere.name == "view.rrd" and not elsewhere.is_relative_to(folder)
    elsewhere.parent.rmdir()
