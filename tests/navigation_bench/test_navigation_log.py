"""A log of what navigation decides: whoever reads it by its page has all that the local planner had."""

import csv
import io
import re
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from actors.installation.repository import REPOSITORY
from actors.robot.cost_maps.inflation import INSCRIBED, LETHAL
from benchmarks.localisation.log import CourseLogError
from benchmarks.navigation import log as navigation_log
from benchmarks.navigation.course import NavigationCourse
from benchmarks.navigation.navigation import NavigationTask, write_log

CORRIDOR = REPOSITORY / "maps" / "corridor.yaml"
SHORT = NavigationCourse(CORRIDOR, 2, 1, 3, patience=20.0)


def load(file: Path) -> Any:
    """By the reader that the page shows."""
    page = (REPOSITORY / "docs" / "navigation-log.md").read_text()
    code = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert code is not None
    names: dict[str, Any] = {}
    exec(code[1], names)
    return names["load"](file)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("log") / "cycles.zip"
    written = navigation_log.write(file, SHORT)
    assert written.cycles > 20 and written.plans > 1
    return file


def test_each_cycle_has_plan_pose_velocity_costs_and_command(log: Path) -> None:
    about, cycles = load(log)
    side = about["window"]
    assert side == round(about["local_map"]["size"] / about["local_map"]["cell"])
    times = [int(row["time_us"]) for row, _, _ in cycles]
    assert times == sorted(times) and min(np.diff(times)) >= about["dwa"]["period"]
    moved = 0.0
    for row, plan, costs in cycles:
        assert len(costs) == side * side and plan
        x, y = float(row["map_x"]), float(row["map_y"])
        assert min(np.hypot(x - a, y - b) for a, b in plan) < 0.5  # the robot is on its way
        valid, speed, turn = int(row["valid"]), float(row["command_vx"]), float(row["command_omega"])
        assert valid or speed == turn == 0.0
        moved += abs(float(row["vx"]))
    assert moved > 1.0


def test_the_window_lies_where_its_corner_says(log: Path) -> None:
    """The robot is in its middle, and stands in no cell that its body must not be in."""
    about, cycles = load(log)
    cell, side = about["local_map"]["cell"], about["window"]
    for row, _, costs in cycles:
        column = float(row["odometry_x"]) / cell - int(row["corner_column"])
        line = float(row["odometry_y"]) / cell - int(row["corner_row"])
        assert side / 2 <= column <= side / 2 + 1 and side / 2 <= line <= side / 2 + 1
        assert costs[int(line) * side + int(column)] < LETHAL
    assert {INSCRIBED, LETHAL} <= set(b"".join(costs for _, _, costs in cycles))


def test_what_stands_in_the_map_was_seen_in_the_last_scans(log: Path) -> None:
    """Every end of a scan that is near enough to be marked lies in or beside a cell that holds something."""
    about, cycles = load(log)
    with zipfile.ZipFile(log) as archive:
        rows = list(csv.reader(io.TextIOWrapper(archive.open("scans.csv"), "ascii")))[1:]
    sensor, cell, side = about["sensor"], about["local_map"]["cell"], about["window"]
    angles = -np.pi + 2 * np.pi / sensor["rays"] * np.arange(1, sensor["rays"] + 1)
    scans = {int(row[0]): np.array(row[1:], float) for row in rows}
    found = []
    for row, _, costs in cycles:
        scan = scans[max(time for time in scans if time <= int(row["time_us"]))]
        (x, y, heading), ranges = scan[:3], scan[3:] / 1000
        eye = x + sensor["x"] * np.cos(heading), y + sensor["x"] * np.sin(heading)
        near = ranges < about["local_map"]["obstacle_range"] - cell
        ends = [
            eye[0] + (ranges * np.cos(heading + angles))[near],
            eye[1] + (ranges * np.sin(heading + angles))[near],
        ]
        column = np.floor(ends[0] / cell).astype(int) - int(row["corner_column"])
        line = np.floor(ends[1] / cell).astype(int) - int(row["corner_row"])
        inside = (column >= 0) & (column < side) & (line >= 0) & (line < side)
        seen = np.frombuffer(costs, np.uint8).reshape(side, side)[line[inside], column[inside]]
        found.append(np.mean(seen >= INSCRIBED))
    assert np.mean(found) > 0.99


def test_equal_courses_give_equal_files(log: Path, tmp_path: Path) -> None:
    navigation_log.write(tmp_path / "again.zip", SHORT)
    assert (tmp_path / "again.zip").read_bytes() == log.read_bytes()


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    task = NavigationTask((CORRIDOR,), (1,), goals=8)
    with pytest.raises(CourseLogError, match="the log cannot be written: No such file or directory"):
        write_log(task, tmp_path / "nowhere" / "log.zip")
    (said,) = write_log(task, tmp_path / "log.zip").shown
    assert "cycles of r1 among 1 on corridor, seed 1" in str(said)
