"""Live robots in the viewer: what they say of themselves, and how old that is."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.floor.map_file import load_map
from actors.installation.repository import REPOSITORY
from actors.messages import DRIVE, PROGRESS, RECEIVED, Drive, Heard, Progress, Received
from actors.observer.drawing.layout import Arrangement
from actors.observer.sheet import Sheet
from actors.task.words import PlaceKey, PlaceReport
from deploy.fleet import watched
from deploy.fleet.fleet_file import load_fleet
from deploy.fleet.watched import HeardMessage, Inbox, WatchedFleet
from tests.view.rrd import rows, timed

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


def said(robot: str, second: float, topic: Any, message: Any) -> HeardMessage:
    key = topic.key(robot) if "{id}" in topic.pattern else topic.key()
    return HeardMessage(second, ENDS[robot], key, message)


def test_robots_are_drawn_where_they_hold_themselves_to_be_and_silence_is_seen(tmp_path: Path) -> None:
    (tmp_path / "fleet.toml").write_text(FLEET.format(root=REPOSITORY))
    fleet = load_fleet(tmp_path / "fleet.toml")
    arranged = Arrangement(load_map(fleet.map), ("r1", "r2"), true=False)
    with Sheet(tmp_path / "view.rrd", arranged, name="a fleet") as sheet:
        view = WatchedFleet(fleet, sheet)
        view.draw((), 0.1, 0)
        words = [
            said("r1", 0.2, DRIVE, Drive(5, 0.3, 0.0, 0.0, 0, pose=(12.0, 13.0, 0.0))),
            said("r1", 0.3, DRIVE, Drive(6, 0.3, 0.0, 0.0, 0, pose=(12.1, 13.0, 0.0))),
            said("r1", 0.3, PROGRESS, Progress(6, 0, 2, 0, False, held=("the bumper is pressed",))),
            said("r2", 0.4, DRIVE, Drive(9, 0.0, 0.0, 0.0, 0, reports=(PlaceReport("r2", 0, 10**15),))),
            said("r2", 0.4, RECEIVED, Received(9, (Heard(10**15, 1, -71.0, 200, b"x"),))),
        ]
        view.draw(words, 0.5, 0)
        view.draw([said("r1", 2.9, DRIVE, Drive(7, 0.0, 0.0, 0.0, 0, route=(PlaceKey("r2", 0),)))], 3.0, 4)
        view.draw((), 6.0, 4)
    found = {entity: timed(some) for entity, some in rows(tmp_path / "view.rrd").items()}
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
    assert "r1 2 places left, 0 reported, running, the bumper is pressed" in events
    assert "r2 cleaned r2/0" in events and "r1 adopts r2/0" in events
    assert "the view lacks 4 messages: too many came" in events
    assert len(found["/plots/rssi/r1_at_r2"]) == 1
    assert found["/plots/copies/copies_heard"][0]["Scalars:scalars"] == [pytest.approx(1 / 6.0)]
    assert "/plots/error/r1" not in found


def test_an_inbox_that_is_full_counts_what_it_misses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watched, "_MOST", 3)
    inbox = Inbox()
    for _ in range(5):
        inbox.take(ENDS["r1"], PROGRESS.key(), Progress(3, 0, 2, 0, False))
    assert inbox.missed == 2 and len(inbox.all()) == 3 and inbox.all() == []
