"""View files of runs, read back without a window."""

from collections import Counter
from io import BytesIO
from pathlib import Path
from shutil import copytree
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader

from acrc_testbed.command_line import visualisation
from acrc_testbed.explanation.time_accounting import cause_intervals
from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.frame_outcomes import outcome_rates
from acrc_testbed.run_model.hardware_runs import whole_run
from acrc_testbed.view.run_view import draw_runs, save_view, view_path
from actors.observer import glyphs, viewer
from actors.observer.layout import APPLICATION
from actors.radio.medium.state import Outcome
from actors.runtime.errors import AcrcError
from tests.view.conftest import Rows, rows

pytestmark = pytest.mark.usefixtures("strict")
WORLD = {
    *("map", "robots/r1", "robots/r1/turn", "robots/r1/turn/body", "robots/r1/turn/nose", "robots/r1/name"),
    *("trails/r1", "history/r1", "items/r1", "intent/r1", "heading/r1", "radio/links", "radio/losses"),
}
INSIDE = {"scan", "particles", "estimate", "costs", "plan", "arc"}


class View(NamedTuple):
    """Everything in the view file of the run, drawn once, and the messages of drawing it."""

    rows: Rows
    said: list[str]


@pytest.fixture(scope="module")
def view(folder: Path, strict: None, tmp_path_factory: pytest.TempPathFactory) -> View:
    said: list[str] = []
    path = tmp_path_factory.mktemp("view") / "run.rrd"
    assert save_view([folder], (), path, said.append)
    assert [file.name for file in path.parent.iterdir()] == ["run.rrd"]
    return View(rows(path), said)


def of(found: Rows, entity: str, component: str) -> list[tuple[float, Any]]:
    """Return the values of one component with their times."""
    return [
        (row["sim_time"].total_seconds(), row[component])
        for row in found[entity]
        if "sim_time" in row and row.get(component) is not None
    ]


def test_the_file_contains_all_entities(folder: Path, evidence: RunData, view: View) -> None:
    found, said = view
    assert [sentence.partition(" after ")[0] for sentence in said] == [
        "ground truth and messages shown",
        "all data shown",
    ]
    assert {f"/world/{name}" for name in WORLD} <= set(found)
    assert {f"/inside/r2/{name}" for name in INSIDE} <= set(found)
    assert {"/r1", "/knowledge/r1", "/plots/items/r1", "/plots/error/r1", "/plots/speed/r2"} <= set(found)
    assert {"/plots/copies/heard", "/plots/rssi/r1_at_r2", "/plots/ages/r2_at_r1"} <= set(found)
    assert {"/ensembles/robots", "/ensembles/exchanges"} <= set(found)
    poses = of(found, "/world/robots/r1", "Transform3D:translation")
    np.testing.assert_allclose([second for second, _ in poses], evidence.seconds, atol=1e-6)
    np.testing.assert_allclose(np.array([at[0][:2] for _, at in poses]), evidence.true[:, 0, :2], atol=1e-4)
    clouds = of(found, "/inside/r1/scan", "Points3D:positions")
    assert [len(cloud) for _, cloud in clouds] == evidence.internals[0].scans.counts.tolist()
    states = [state[0] for _, state in of(found, "/r1", "StateChange:state")]
    assert any(state.startswith("to r1/") for state in states) and any("blocked" in state for state in states)
    truth = [one for one in cause_intervals(evidence) if one.robot == "r1" and one.cause is Cause.DEADLOCK]
    lane = [(second, state[0]) for second, state in of(found, "/r1", "StateChange:state")]
    assert [second for second, state in lane if state == "deadlock"] == [one.begin for one in truth] != []
    assert lane[-1] == (evidence.end, ""), "the lane ends with the run"
    assert "/legend/marks" in found and "/legend/copies" in found
    table = of(found, "/knowledge/r2", "TextDocument:text")[-1][1][0]
    assert "| position |" in table and "| route |" in table
    decisions = dict(of(found, "/decisions/r2", "TextDocument:text"))
    made = [
        one for inside in evidence.internals if inside.process.robot == "r2" for one in inside.decisions()
    ]
    assert sorted(decisions) == pytest.approx(sorted({change.second for change, _ in made})) and made
    adopting = next(text[0] for text in decisions.values() if "takes over" in text[0])
    assert "- knowledge of r1, " in adopting and " dBm\n- " in adopting and "- attempt: 0 → 1" in adopting
    assert any(words[0].startswith("r1 ") for _, words in of(found, "/events/r1/inside", "TextLog:text"))


def test_an_incomplete_view_is_reported_and_fails(
    lean: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.rrd"
    for folders in ([lean], [lean, lean]):
        with pytest.raises(AcrcError, match="the view is incomplete, see above"):
            visualisation._show_runs(folders, (), save=path, screenshot=None, at=None)
        told = capsys.readouterr().err
        assert "r1: introspection was not recorded; record the run with --record full" in told
        assert told.splitlines()[-1].startswith("view without the data listed above after ")
    states = {state[0] for _, state in of(rows(path), "/1/r1", "StateChange:state")}
    assert states & {"driving", "standing"}, "as seen from outside"
    assert "/1/inside/r1/scan" not in rows(path)


def test_layout_and_chosen_robots(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    save_view([folder], ("r2",), path, lambda sentence: None)
    (blueprint,) = RrdReader(str(path)).blueprints()
    assert blueprint.application_id == APPLICATION
    found = rows(path)
    assert "/inside/r2/scan" in found and "/inside/r1/scan" not in found
    assert {"/r1", "/knowledge/r1", "/world/intent/r1"} <= set(found)


def test_two_runs_share_a_timeline(folder: Path, view: View, tmp_path: Path) -> None:
    copytree(folder, tmp_path / "branch")
    said: list[str] = []
    path = tmp_path / "beside.rrd"
    save_view((folder, tmp_path / "branch"), (), path, said.append)
    assert [sentence.partition(" after ")[0] for sentence in said] == [
        "ground truth and messages shown",
        "all data shown",
    ]
    one, both = view.rows, rows(path)
    drawn_there = {entity for entity in one if entity != "/__properties"}
    assert set(both) - {"/__properties"} == {f"/{n}{entity}" for n in (1, 2) for entity in drawn_there}
    for entity in ("/world/robots/r1", "/inside/r2/scan", "/r1", "/world/radio/losses"):
        whens = [[row.get("sim_time") for row in some] for some in (one[entity], both[f"/2{entity}"])]
        assert whens[0] == whens[1]
    with pytest.raises(AcrcError):
        save_view((folder, tmp_path / "nowhere"), (), path, said.append)


def test_recordings_of_robots_alone(folder: Path, evidence: RunData, tmp_path: Path) -> None:
    for robot in ("r1", "r2"):
        copytree(folder / robot, tmp_path / "trial" / robot)
    run = whole_run(tmp_path / "trial")
    assert not run.description.has_truth and run.robots == ("r1", "r2")
    assert len(run.heard) == len(evidence.heard) > 0
    seen = [[(event.kind, event.key) for event in one.task_events] for one in (run, evidence)]
    assert seen[0] == seen[1]
    assert [mark for _, mark in run.marks] == [mark for _, mark in evidence.marks]
    assert run.description.task == evidence.description.task and len(run.items) == 6
    held = evidence.estimated[:, 0]
    known = np.isfinite(run.trajectories["r1"].poses[:, 0])
    np.testing.assert_allclose(run.trajectories["r1"].poses[known], held[np.isfinite(held[:, 0])])
    assert draw_runs([run], tmp_path / "trial.rrd", (), None, lambda sentence: None, 0.0)
    found = rows(tmp_path / "trial.rrd")
    assert "/inside/r1/scan" in found and "/plots/error/r1" not in found
    assert "/plots/copies/heard" not in found


def test_the_view_of_a_read_only_folder_is_written_elsewhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert view_path(folder) == folder / "view.rrd"
    monkeypatch.setattr("os.access", lambda path, mode: False)
    elsewhere = view_path(folder)
    assert elsewhere.name == "view.rrd" and not elsewhere.is_relative_to(folder)
    elsewhere.parent.rmdir()


SHOWN = {
    "Swarm, ground truth": "3D",
    "r1: perception and plan": "3D",
    "Activities of robots": "StateTimeline",
    "Places done": "TimeSeries",
    "Copies of frames per second, by outcome": "TimeSeries",
    "Events": "TextLog",
    "Ensembles": "Graph",
    "r1: knowledge": "TextDocument",
}


@pytest.mark.nightly
def test_the_viewer_shows_everything(folder: Path, tmp_path: Path) -> None:
    view = tmp_path / "view.rrd"
    save_view([folder], (), view, lambda sentence: None)
    try:
        shot = viewer.take_screenshot(view, 20.0, 1200, 800)
    except viewer.ScreenshotError as error:
        pytest.skip(f"what a person sees is not looked at: {error}")
    assert {one.name: one.kind for one in shot.views}.items() >= SHOWN.items()
    assert [one for one in shot.views if one.reports] == []
    picture = Image.open(BytesIO(shot.png)).convert("RGB")
    assert picture.size == (1200, 800)
    pixels = np.asarray(picture).astype(int)
    seen = Counter(map(tuple, pixels.reshape(-1, 3).tolist()))
    assert len(seen) > 500
    for colour in glyphs.ROBOTS[:2]:
        near = np.abs(pixels[:520, :800] - colour).max(axis=2) < 12
        assert near.sum() > 30, f"nothing on the floor has the colour {colour}"
    lanes = pixels[560:, :400]
    assert (lanes.max(axis=2) - lanes.min(axis=2) > 40).sum() > 2000, "no lane is coloured"


def test_recorded_copies_of_frames_are_those_the_radio_counted(evidence: RunData) -> None:
    copies = evidence.copies
    assert evidence.result is not None
    counted = evidence.result.frames
    counts = np.bincount(copies.outcomes, minlength=len(Outcome))
    for outcome in (Outcome.HEARD, Outcome.COLLISION, Outcome.HALF_DUPLEX, Outcome.BELOW_SENSITIVITY):
        name = f"copies_{'' if outcome is Outcome.HEARD else 'lost_'}{outcome.name.lower()}"
        assert counts[outcome] == counted[name], name
    assert counts.sum() == counted["frames_sent"] * (len(evidence.robots) - 1) > 0
    assert (copies.senders != copies.receivers).all()
    heard = copies.outcomes == Outcome.HEARD
    told = sorted((second, int(receiver)) for second, _, receiver, _ in evidence.heard.tolist())
    mine = sorted(zip(copies.seconds[heard].tolist(), copies.receivers[heard].tolist(), strict=True))
    assert mine == told
    table = outcome_rates(copies, 0.0, 6, 5.0)
    assert table[:, Outcome.HEARD].sum() * 5.0 == pytest.approx(counts[Outcome.HEARD])
