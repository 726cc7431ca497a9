"""Views of running runs, which end up equal to those of the finished run."""

import os
import shutil
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from acrc_testbed.recordings.topics import RunState, run_state
from acrc_testbed.run_model.data import RunDataError
from acrc_testbed.run_model.simulated_runs import RunReader, recorded_run
from acrc_testbed.view.run_drawing import RunDrawing
from acrc_testbed.view.run_view import LiveView, save_view
from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.items import ItemKey
from actors.messages import DRIVE, PROGRESS, RECEIVED, Drive, FrameReceived, Progress, RadioEvents
from actors.observer.layout import ViewerContents, ViewFile
from cleaning.place import VisitReport
from deploy.fleet.fleet_file import load_fleet
from deploy.fleet.fleet_view import FleetView, ReceivedMessage
from tests.view.conftest import rows

MORE = {f"/{what}{robot}" for what in ("plots/items/", "world/heading/", "") for robot in ("r1", "r2")}
"""At the borders of parts a state may be repeated, or a short one may remain."""


class GrowingRun:
    """A copy of a run's folder with recordings truncated to a share of their bytes."""

    def __init__(self, whole: Path, out: Path) -> None:
        self._whole, self.out = whole, out
        shutil.copytree(whole, out, ignore=shutil.ignore_patterns("*.mcap", "run.json"))

    def grow(self, share: float) -> None:
        for path in self._whole.glob("*/*.mcap"):
            data = path.read_bytes()
            (self.out / path.relative_to(self._whole)).write_bytes(data[: round(share * len(data))])


@pytest.fixture
def growing(folder: Path, tmp_path: Path) -> GrowingRun:
    return GrowingRun(folder, tmp_path / "growing")


def test_a_growing_run_is_drawn_like_a_finished_one(
    growing: GrowingRun, folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(RunDrawing, "_draw_deadlocks", lambda *_: None)  # known once a run has ended
    save_view([folder], (), tmp_path / "whole.rrd", lambda sentence: None)
    growing.grow(0.31)
    with RunReader(growing.out, internals=True) as reader:
        what = ViewerContents(reader.description.grid, reader.robots, reader.robots)
        with ViewFile(tmp_path / "grown.rrd", what, name="it goes on") as sheet:
            view = LiveView(reader, sheet, reader.robots)
            view.draw()
            assert 5.0 < view.end < 15.0
            growing.grow(0.74)
            time.sleep(1.2)  # robots' messages of a step are waited for so long where they are cut off
            view.draw()
            growing.grow(1.0)
            while view.draw():
                pass
            view.draw(last=True)
            assert view.end == pytest.approx(30.0) and reader.count_unread() == 0
    grown, whole = (
        {
            entity: {row.get("sim_time") for row in some}
            for entity, some in rows(tmp_path / f"{name}.rrd").items()
        }
        for name in ("grown", "whole")
    )
    assert set(grown) == set(whole)
    for entity, instants in whole.items():
        if entity in MORE:
            assert grown[entity] >= instants, entity
        else:
            assert grown[entity] == instants, entity


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.dictionaries(st.sampled_from(["world", "radio", "r1", "r2"]), st.floats(0.05, 1.0), min_size=1))
def test_a_recording_cut_at_any_byte_opens(short_run: Path, cuts: dict[str, float]) -> None:
    with TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        shutil.copytree(short_run, out, ignore=shutil.ignore_patterns("run.json", "seal.json"))
        for actor, share in cuts.items():
            path = out / actor / f"{actor}.mcap"
            os.truncate(path, max(12_000, round(share * path.stat().st_size)))
        try:
            run = recorded_run(out, internals=True)
        except RunDataError as error:
            assert "ended before its first step" in str(error)
            return
        assert run.end <= 3.0 and len(run.true) == len(run.seconds) == len(run.items_left)
        assert np.isfinite(run.true).all() and len(run.internals) <= 2
        assert all(one.end <= run.end for one in run.internals)


def test_the_state_of_a_run_follows_from_its_writing_processes(growing: GrowingRun, folder: Path) -> None:
    assert run_state(folder) is RunState.ENDED
    growing.grow(0.5)
    assert run_state(growing.out) is RunState.DIED
    with (growing.out / "world" / "world.mcap").open("ab") as file:
        writer = subprocess.Popen(["sleep", "60"], stdout=file)
    assert run_state(growing.out) is RunState.RUNNING
    writer.kill()
    writer.wait()
    assert run_state(growing.out) is RunState.DIED
    growing.grow(1.0)
    assert run_state(growing.out) is RunState.ENDED


FLEET = """
map = "{root}/maps/corridor.yaml"
[[robot]]
id = "r1"
address = 1
start = [12.0, 13.0, 0.0]
places = [[20.0, 12.5], [4.0, 12.5]]
base = "/dev/base1"
radio = "/dev/board1"
[[robot]]
id = "r2"
address = 2
start = [14.0, 13.0, 0.0]
places = [[6.0, 12.5]]
base = "/dev/base2"
radio = "/dev/board2"
"""
ENDS = {"r1": "tls/10.0.0.1:7447", "r2": "tls/10.0.0.2:7447"}


def said(robot: str, second: float, topic: Any, message: Any) -> ReceivedMessage:
    key = topic.key(robot) if "{id}" in topic.pattern else topic.key()
    return ReceivedMessage(second, ENDS[robot], key, message)


def test_watched_robots_are_drawn_at_their_estimates_and_timeouts_are_shown(tmp_path: Path) -> None:
    (tmp_path / "fleet.toml").write_text(FLEET.format(root=REPOSITORY))
    fleet = load_fleet(tmp_path / "fleet.toml")
    arranged = ViewerContents(load_map(fleet.map), ("r1", "r2"), true=False)
    with ViewFile(tmp_path / "view.rrd", arranged, name="a fleet") as sheet:
        view = FleetView(fleet, sheet)
        view.draw((), 0.1, 0)
        words = [
            said("r1", 0.2, DRIVE, Drive(5, 0.3, 0.0, 0.0, 0, pose=(12.0, 13.0, 0.0))),
            said("r1", 0.3, DRIVE, Drive(6, 0.3, 0.0, 0.0, 0, pose=(12.1, 13.0, 0.0))),
            said("r1", 0.3, PROGRESS, Progress(6, 0, 2, 0, False, held=("bumper pressed",))),
            said("r2", 0.4, DRIVE, Drive(9, 0.0, 0.0, 0.0, 0, reports=(VisitReport("r2", 0, 10**15),))),
            said("r2", 0.4, RECEIVED, RadioEvents(9, (FrameReceived(10**15, 1, -71.0, 200, b"x"),))),
        ]
        view.draw(words, 0.5, 0)
        view.draw([said("r1", 2.9, DRIVE, Drive(7, 0.0, 0.0, 0.0, 0, route=(ItemKey("r2", 0),)))], 3.0, 4)
        view.draw((), 6.0, 4)
    found = {
        entity: [row for row in some if "sim_time" in row]
        for entity, some in rows(tmp_path / "view.rrd").items()
    }
    poses = [row["Transform3D:translation"][0][:2] for row in found["/world/robots/r1"]]
    np.testing.assert_allclose(poses, [[12.0, 13.0], [12.1, 13.0]], atol=1e-5)
    names = {
        robot: [row["Points3D:labels"][0] for row in found[f"/world/robots/{robot}/name"]] for robot in ENDS
    }
    assert names["r1"] == ["r1 (not heard)", "r1", "r1 (not heard)"]
    assert names["r2"] == ["r2 (not heard)", "r2", "r2 (not heard)"]
    ages = [row["Scalars:scalars"][0] for row in found["/plots/ages/r2"]]
    np.testing.assert_allclose(ages, [0.1, 2.6, 5.6])
    events = [row["TextLog:text"][0] for name in found for row in found[name] if name.startswith("/events")]
    assert "r1 2 items left, 0 reported, running, bumper pressed" in events
    assert "r2 cleaned r2/0" in events and "r1 adopts r2/0" in events
    assert "view dropped 4 messages: too many to draw" in events
    assert len(found["/plots/rssi/r1_at_r2"]) == 1
    assert found["/plots/copies/copies_heard"][0]["Scalars:scalars"] == [pytest.approx(1 / 6.0)]
    assert "/plots/error/r1" not in found
