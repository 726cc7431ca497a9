"""Runs with people: results, recordings, pictures, map page; digests are in tests.swarm.test_transports."""

import json
import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from acrc_testbed.experiments.metrics import task_metrics, value_of
from acrc_testbed.export import table_rows
from acrc_testbed.picture import run_movie, run_page
from acrc_testbed.results.summary import result_sentences
from acrc_testbed.run_model.data import RunData
from acrc_testbed.run_model.simulated_runs import read_run
from actors.floor.map_file import load_map
from actors.geometry import Point
from actors.messages import TRUTH, Loss, PersonTruth, Truth
from actors.observer.glyphs import MARKS
from actors.runtime.codec import decode, encode
from actors.runtime.errors import AcrcError
from actors.runtime.replay_bus import topic_of
from deploy.control.scene import Scene
from deploy.scenario.map_survey import sentences
from deploy.scenario.resolve import resolve
from deploy.scenario.scenario_file import Overrides, load_scenario, parse
from deploy.scenario.survey import survey
from tests.recorded_runs import record
from tests.swarm.command import ROOT

PEOPLE = ROOT / "scenarios" / "people.toml"
DURATION = 12.0
WITHOUT = PEOPLE.read_text().partition("[people]")[0]
AREAS = PEOPLE.read_text().partition("[[area]]")[2]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("people") / "run"
    record(out, PEOPLE, duration=DURATION)
    return out


@pytest.fixture(scope="module")
def data(made: Path) -> RunData:
    return read_run(made)


def test_people_are_in_recording_result_and_tables(made: Path, data: RunData) -> None:
    content = json.loads((made / "run.json").read_bytes())
    assert content["people_contacts"] >= 0 and content["people_contact_s"] >= 0
    assert data.people.shape == (round(DURATION * 10), 6, 4)
    grid = load_map(ROOT / "maps" / "corridor.yaml")
    assert all(
        grid.clearance_at(Point(x, y), 1.0) > 0.24
        for x, y in data.people[::10, :, :2].reshape(-1, 2).tolist()
    )
    walked = np.linalg.norm(np.diff(data.people[..., :2], axis=0), axis=-1).sum(axis=0)
    assert (walked > 3.0).sum() >= 4
    assert data.result is not None
    metrics = task_metrics(data.result.declaration)
    assert value_of(metrics["people_contacts"], data.result) == content["people_contacts"]
    assert value_of(metrics["people_contact_s"], data.result) == content["people_contact_s"]
    assert any(line.startswith("Contacts with people: ") for line in result_sentences(data.result))
    rows = table_rows.tables(made).rows["people"]
    assert len(rows) == round(DURATION * 10) * 6
    assert rows[7] == (1, 0.1, 2, *data.people[1, 1].tolist())


def test_the_scenario_in_the_folder_repeats_the_run(made: Path, tmp_path: Path, data: RunData) -> None:
    assert data.result is not None
    again = record(tmp_path / "again", made / "scenario.toml")
    assert again.digest == data.result.digest


def test_no_people_leave_no_trace(tmp_path: Path) -> None:
    none = record(tmp_path / "none", WITHOUT, duration=2.0)
    zero = record(tmp_path / "zero", WITHOUT + "[people]\ncount = 0\n", duration=2.0)
    assert zero.digest == none.digest
    assert "people_contact" not in (tmp_path / "none" / "run.json").read_text()
    assert math.isnan(value_of(task_metrics(none.declaration)["people_contacts"], none) or 0.0)
    assert b'"people"' not in msgspec.json.encode(resolve(parse(WITHOUT, PEOPLE)).world)


def test_truth_without_people_keeps_its_bytes() -> None:
    def fields(truth: Truth) -> int:
        return len(msgspec.msgpack.decode(encode(truth)[1:]))

    person = PersonTruth(1.0, 2.0, 0.5, 0.0)
    plain, lossy = Truth(3, 300_000, ()), Truth(3, 300_000, (), losses=(Loss("r1", "r2"),))
    peopled = Truth(3, 300_000, (), people=(person,))
    assert [fields(one) for one in (plain, lossy, peopled)] == [5, 6, 8]
    for truth in (plain, lossy, peopled):
        assert decode(topic_of(TRUTH.key()), TRUTH.key(), encode(truth)) == truth


def test_pictures_show_people(data: RunData, tmp_path: Path) -> None:
    figure = run_page.draw(data)
    floor = figure.axes[0]
    labels = [text.get_text() for text in floor.get_legend().get_texts()]  # type: ignore[union-attr]
    assert MARKS["person"].meaning in labels
    centres = {tuple(np.round(patch.center, 6)) for patch in floor.patches if hasattr(patch, "center")}
    assert {tuple(np.round(at, 6)) for at in data.people[-1, :, :2]} <= centres
    run_movie.write(data, tmp_path / "movie.gif", 40.0)
    assert (tmp_path / "movie.gif").stat().st_size > 10_000


def test_the_map_page_shows_people(made: Path) -> None:
    setup = resolve(load_scenario(made / "scenario.toml"))
    scene = Scene(setup.world, setup.radio, 1.0)
    assert scene.floor()["legend"]["person"][0] == "filled ring"
    scene.take(TRUTH.key(), Truth(0, 0, (), people=(PersonTruth(1.0, 2.0004, 0.5, 0.0),)))
    assert scene.state()["people"] == [(1.0, 2.0)]
    empty = resolve(load_scenario(ROOT / "scenarios" / "corridor.toml"))
    assert "person" not in Scene(empty.world, empty.radio, 1.0).floor()["legend"]


def test_a_survey_counts_people() -> None:
    found = survey(resolve(load_scenario(PEOPLE)))
    assert "people: 6, walking between rooms" in sentences(found)


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ("count = 101", "people.count is 101, but must be a whole number from 0 to 100"),
        ("speed = 0.0", "people.speed is 0.0, but must be a number of metres per second from 0.1 to 2.5"),
        ('between = "walls"', 'people.between is "walls", but must be "rooms", "doors" or "areas"'),
        ('areas = ["Office1"]', 'people.between is "rooms"'),
        ('between = "areas"\nareas = ["Ofice1"]', 'did you mean "Office1"?'),
    ],
)
def test_a_wrong_table_is_one_sentence(table: str, sentence: str) -> None:
    with pytest.raises(AcrcError) as caught:
        parse(WITHOUT + f"[people]\n{table}\n[[area]]{AREAS}", PEOPLE)
    assert sentence in str(caught.value) and "\n" not in str(caught.value)


def test_areas_of_people_are_kept_apart_from_those_of_places() -> None:
    table = '[people]\nbetween = "areas"\nareas = ["Corridor"]\n[[area]]'
    scenario = parse(
        (WITHOUT + table + AREAS).replace("per_robot = 10", 'areas = ["Office1"]'),
        PEOPLE,
        Overrides(robots=1),
    )
    resolved = resolve(scenario)
    people = resolved.scenario.people
    assert people is not None and [area.name for area in people.area] == ["Corridor"]
    assert [area.name for area in resolved.scenario.area] == ["Office1"]
    assert resolve(resolved.scenario).world == resolved.world
