"""Robots' entries from recordings that somebody has tampered with."""

from collections import Counter
from pathlib import Path

import msgspec
import numpy as np
import pytest

from actors.messages import Odometry, Scan, Senses
from actors.robot_model import load_model
from observation.robot_logs import log_file, robot_entries
from observation.robot_logs.contents import LogEntry, RobotWords
from observation.robot_logs.logging_run import form_of
from observation.view.story import Source, Track

MODEL = load_model("turtlebot2")
SCAN = Scan(0, b"\0\0" * MODEL.sensor.rays)
GOOD = Senses(
    step=0, instant=0, events=0, odometry=Odometry(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), bumper=0,
    scan=SCAN,
)  # fmt: skip


def entries(monkeypatch: pytest.MonkeyPatch, *told: Senses) -> tuple[list[LogEntry], Counter[str]]:
    """What comes of these messages of a robot that never says where it is."""
    left_out = Counter[str]()
    monkeypatch.setattr(robot_entries, "taken", lambda path, topic: (("r1", one) for one in told))
    source = Source("r1", "r1", lambda instants: instants / 1e6)
    track = Track(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), ())
    found = robot_entries.sensed_entries(Path("r1.mcap"), source, track, MODEL, left_out)
    return list(found), +left_out


def test_what_no_sensor_says_is_left_out_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    replace = msgspec.structs.replace
    short, late = Scan(0, b"\0\0\0"), replace(SCAN, stamp=2**63)
    nowhere = replace(GOOD, odometry=Odometry(float("nan"), 0.0, 0.0, 0.0, 0.0, 0.0))
    found, left_out = entries(
        monkeypatch,
        GOOD,
        replace(GOOD, scan=short),
        replace(GOOD, earlier_scans=(late,)),
        replace(GOOD, instant=-(2**63)),
        nowhere,
        replace(GOOD, halt=True),
    )
    assert left_out == {"/r1/scan": 2, "/r1/odom": 2}
    assert Counter(one.topic for one in found) == {"/tf": 3, "/r1/odom": 3, "/r1/scan": 2}


@pytest.mark.parametrize("instant", [-1, 2**31 * 1_000_000])
def test_an_instant_that_no_log_can_have_is_left_out(instant: int, tmp_path: Path) -> None:
    left_out = Counter[str]()
    given = [
        LogEntry(0, "/rosout", RobotWords("r1", "a"), 0),
        LogEntry(0, "/rosout", RobotWords("r1", "b"), instant),
    ]
    counts = log_file.write(tmp_path / "a.mcap", form_of("ros2"), given, left_out)
    assert (counts["/rosout"], left_out["/rosout"]) == (1, 1)
