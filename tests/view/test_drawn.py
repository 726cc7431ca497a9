"""The view file of a run, read back without a window: every entity that a person looks at is there."""

from collections import Counter
from io import BytesIO
from pathlib import Path
from shutil import copytree
from typing import Any, NamedTuple

import numpy as np
import pytest
from PIL import Image
from rerun.chunk import RrdReader

from acrc_testbed.accounting.account import spells
from acrc_testbed.accounting.time_spent import Cause
from acrc_testbed.command_line import look
from acrc_testbed.explanation.explain import Explainer
from acrc_testbed.run_model.collected import whole_run
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.frames import by_outcome
from acrc_testbed.trace.rows import Trace, in_words
from acrc_testbed.trace.traces import Traced
from acrc_testbed.view import beside, drawn
from acrc_testbed.view.drawn import Wishes, draw, place
from actors.geometry import Point
from actors.observer import glyphs, viewer
from actors.observer.drawing.layout import APPLICATION
from actors.radio.medium.state import Outcome
from actors.robot.behaviour.foreign import INSTALLED
from actors.runtime.errors import AcrcError
from actors.task.task import PlaceKey
from cleaning.cleaner import State
from tests.view.conftest import Rows, rows

pytestmark = pytest.mark.usefixtures("strict")
WORLD = {
    *("map", "robots/r1", "robots/r1/turn", "robots/r1/turn/body", "robots/r1/turn/nose", "robots/r1/name"),
    *("trails/r1", "history/r1", "places/r1", "intent/r1", "heading/r1", "radio/links", "radio/losses"),
}
INSIDE = {"scan", "particles", "estimate", "costs", "plan", "arc"}


class View(NamedTuple):
    """Everything in the view file of the run, drawn once, and the messages of drawing it."""

    rows: Rows
    said: list[str]


@pytest.fixture(scope="module")
def view(
    folder: Path, insides: dict[str, Trace], strict: None, tmp_path_factory: pytest.TempPathFactory
) -> View:
    said: list[str] = []
    path = tmp_path_factory.mktemp("view") / "run.rrd"
    traced = [Traced(actor, (inside,)) for actor, inside in insides.items()]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawn, "traces", lambda *words, **more: iter(traced))
        draw(whole_run(folder), path, Wishes(why=True), send_to=None, say=said.append)
    assert [file.name for file in path.parent.iterdir()] == ["run.rrd"]
    return View(rows(path), said)


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
    folder: Path, evidence: RunData, insides: dict[str, Trace], view: View
) -> None:
    found, said = view
    assert [sentence.partition(" after ")[0] for sentence in said] == ["first picture", "all of it"]
    assert said[-1].endswith("with what 2 robots perceived and meant")
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


def test_layout_and_chosen_robots(folder: Path, computed: None, tmp_path: Path) -> None:
    path = tmp_path / "run.rrd"
    draw(whole_run(folder), path, Wishes(robots=("r2",)), send_to=None, say=lambda sentence: None)
    (blueprint,) = RrdReader(str(path)).blueprints()
    assert blueprint.application_id == APPLICATION
    found = rows(path)
    assert "/inside/r2/scan" in found and "/inside/r1/scan" not in found
    assert {"/r1", "/knowledge/r1", "/world/intent/r1"} <= set(found)


def test_two_runs_share_a_timeline(folder: Path, view: View, computed: None, tmp_path: Path) -> None:
    copytree(folder, tmp_path / "branch")
    said: list[str] = []
    path = tmp_path / "beside.rrd"
    beside.save((folder, tmp_path / "branch"), Wishes(), path, said.append)
    assert [sentence.partition(" after ")[0] for sentence in said] == ["first picture", "all of it"]
    one, both = view.rows, rows(path)
    drawn_there = {entity for entity in one if entity != "/__properties" and not entity.startswith("/why/")}
    assert set(both) - {"/__properties"} == {f"/{n}{entity}" for n in (1, 2) for entity in drawn_there}
    for entity in ("/world/robots/r1", "/inside/r2/scan", "/r1", "/world/radio/losses"):
        whens = [[row.get("sim_time") for row in some] for some in (one[entity], both[f"/2{entity}"])]
        assert whens[0] == whens[1]
    with pytest.raises(AcrcError):
        beside.save((folder, tmp_path / "nowhere"), Wishes(), path, said.append)


def test_a_robot_without_replay_is_drawn_from_outside(
    folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    traced = [Traced("r1", fault="r1: not to be trusted"), Traced("r2", fault="r2: neither")]
    monkeypatch.setattr(drawn, "traces", lambda *words, **more: iter(traced))
    said: list[str] = []
    draw(whole_run(folder), tmp_path / "run.rrd", Wishes(), send_to=None, say=said.append)
    assert said[1:3] == ["r1: not to be trusted", "r2: neither"]
    found = rows(tmp_path / "run.rrd")
    assert {state[0] for _, state in of(found, "/r1", "StateChange:state")} & {"driving", "standing"}
    assert "/inside/r1/scan" not in found


def test_recordings_of_robots_alone(folder: Path, evidence: RunData, computed: None, tmp_path: Path) -> None:
    for robot in ("r1", "r2"):
        copytree(folder / robot, tmp_path / "trial" / robot)
    run = whole_run(tmp_path / "trial")
    assert not run.description.has_truth and run.robots == ("r1", "r2")
    assert len(run.heard) == len(evidence.heard) > 0
    assert [deed.place for deed in run.reported] == [deed.place for deed in evidence.reported]
    held = evidence.estimated[:, 0]
    known = np.isfinite(run.trajectories["r1"].poses[:, 0])
    np.testing.assert_allclose(run.trajectories["r1"].poses[known], held[np.isfinite(held[:, 0])])
    draw(run, tmp_path / "trial.rrd", Wishes(), send_to=None, say=lambda sentence: None)
    found = rows(tmp_path / "trial.rrd")
    assert "/inside/r1/scan" in found and "/plots/error/r1" not in found
    assert "/plots/copies/heard" not in found


def test_a_read_only_folder_gets_its_view_elsewhere(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert place(folder) == folder / "view.rrd"
    monkeypatch.setattr("os.access", lambda path, mode: False)
    elsewhere = place(folder)
    assert elsewhere.name == "view.rrd" and not elsewhere.is_relative_to(folder)
    elsewhere.parent.rmdir()


SHOWN = {
    "Swarm, ground truth": "3D",
    "r1: what it sees and plans": "3D",
    "What each robot does": "StateTimeline",
    "Places done": "TimeSeries",
    "Copies of frames per second, by fate": "TimeSeries",
    "Events": "TextLog",
    "Ensembles": "Graph",
    "r1: knowledge": "TextDocument",
}


@pytest.mark.nightly
def test_the_viewer_shows_everything(folder: Path, computed: None, tmp_path: Path) -> None:
    view = tmp_path / "view.rrd"
    draw(whole_run(folder), view, Wishes(), send_to=None, say=lambda sentence: None)
    try:
        shot = viewer.take(view, 20.0, 1200, 800)
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
    table = by_outcome(copies, 0.0, 6, 5.0)
    assert table[:, Outcome.HEARD].sum() * 5.0 == pytest.approx(counts[Outcome.HEARD])


def test_knowledge_is_told_in_words() -> None:
    told = [in_words(one) for one in (None, (), 1.0, State.FREE, PlaceKey("r1", 3), Point(1.0, 2.5), True)]
    assert told == ["-", "-", "1.00", "free", "r1/3", "1.00, 2.50", "True"]
    assert in_words((PlaceKey("r1", 3), PlaceKey("r2", 0))) == "r1/3 r2/0"
    assert in_words(((((1,),),),)) == "…"
    assert in_words(frozenset({"b", "a"})) == "a b"
