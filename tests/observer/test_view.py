"""The file that a run leaves for rerun, read back without a window."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.messages import Drive, RobotTruth, Truth
from actors.observer import viewer
from actors.observer.observer import Observer, ViewSummary
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceGivenUp, PlaceReport

GRID = OccupancyGrid(
    np.array([[OCCUPIED, FREE, FREE], [UNKNOWN, FREE, OCCUPIED]], dtype=np.uint8), 2.0, Point(-1.0, 3.0)
)
Rows = dict[str, list[dict[str, Any]]]


@pytest.fixture(autouse=True)
def strict() -> Iterator[None]:
    """Let rerun raise where it would only warn."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


def truth(step: int, step_us: int = 100_000, **changes: dict[str, bool]) -> Truth:
    """Two robots; the first drives east by 0.1 m a step."""
    robots = [
        RobotTruth("r1", 0.1 * step, 4.0, np.pi / 2, 1.0, 0.0, 0.0, True, True, 0),
        RobotTruth("r2", 3.0, 5.0, 0.0, 0.0, 0.0, 0.0, True, True, 0),
    ]
    changed = [
        RobotTruth(
            r.id, r.x, r.y, r.heading, r.vx, r.vy, r.omega, c.get("stepping", True), c.get("powered", True), 0
        )
        for r in robots
        for c in [changes.get(r.id, {})]
    ]
    return Truth(step, step * step_us, tuple(changed))


def rows(path: Path) -> Rows:
    """Everything that was logged, by entity, in the order of time; static rows have no sim_time."""
    found: Rows = {}
    for chunk in RrdReader(str(path)).stream():
        found.setdefault(str(chunk.entity_path), []).extend(chunk.to_record_batch().to_pylist())
    for some in found.values():
        some.sort(key=lambda row: row["sim_time"].total_seconds() if "sim_time" in row else -1.0)
    return found


def times(some: list[dict[str, Any]]) -> list[float]:
    return [row["sim_time"].total_seconds() for row in some]


def test_the_file_holds_map_places_robots_and_trajectories_over_time(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, {"r1": [Point(1.0, 4.0)]}, window=False)
    for step in range(5):
        observer.truth(truth(step))
    assert observer.close() == ViewSummary(missed=0, shown=5, expected=5, whole=False)
    found = rows(tmp_path / "view.rrd")
    assert {entity for entity in found if entity.startswith("/world")} == {
        "/world/map",
        "/world/places/r1",
        "/world/labels",
        "/world/robots/r1",
        "/world/robots/r1/body",
        "/world/robots/r1/nose",
        "/world/robots/r2",
        "/world/robots/r2/body",
        "/world/robots/r2/nose",
        "/world/trajectories/r1/recent",
    }
    poses = found["/world/robots/r1"]
    assert times(poses) == [0.0, 0.1, 0.2, 0.3, 0.4]
    np.testing.assert_allclose(poses[4]["Transform3D:translation"], [[0.4, 4.0, 0.0]], atol=1e-6)
    turned = np.array(poses[4]["Transform3D:quaternion"])[0]
    np.testing.assert_allclose(turned, [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)
    way = found["/world/trajectories/r1/recent"][-1]["LineStrips3D:strips"][0]
    np.testing.assert_allclose(np.array(way)[:, :2], [[0.1 * i, 4.0] for i in range(5)], atol=1e-6)


def test_places_turn_pale_when_reported_and_lose_a_stroke_when_given_up(tmp_path: Path) -> None:
    places = {"r1": [Point(1.0, 4.0), Point(2.0, 4.0)], "r2": [Point(3.0, 5.0)]}
    observer = Observer(tmp_path, GRID, places, window=False)
    observer.truth(truth(0))
    observer.drive(Drive(1, 0.0, 0.0, 0.0, 0))
    observer.truth(truth(1))
    observer.drive(Drive(2, 0.0, 0.0, 0.0, 0, (PlaceReport("r1", 1, 200_000),)))
    observer.drive(Drive(2, 0.0, 0.0, 0.0, 0, (), (PlaceGivenUp("r2", 0, 200_000, "shut"),)))
    observer.truth(truth(2))
    observer.drive(Drive(3, 0.0, 0.0, 0.0, 0, (PlaceReport("r2", 0, 300_000),)))
    observer.truth(truth(3))
    observer.close()
    found = rows(tmp_path / "view.rrd")
    red, pale_red, blue, pale_blue = 0xD62728FF, 0xF5C9C9FF, 0x1F55D6FF, 0xC7D4F5FF
    first, second = found["/world/places/r1"], found["/world/places/r2"]
    assert (times(first), times(second)) == ([0.0, 0.2], [0.0, 0.2, 0.3])
    assert [row["LineStrips3D:colors"] for row in first] == [[red] * 4, [red] * 2 + [pale_red] * 2]
    assert [row["LineStrips3D:colors"] for row in second] == [[blue] * 2, [blue], [pale_blue] * 2]
    assert [len(row["LineStrips3D:strips"]) for row in second] == [2, 1, 2]


def test_the_map_lies_where_the_grid_says_north_edge_first(tmp_path: Path) -> None:
    Observer(tmp_path, GRID, window=False).close()
    (row,) = rows(tmp_path / "view.rrd")["/world/map"]
    assert bytes(row["GridMap:data"][0]) == bytes([205, 255, 0, 0, 255, 255])
    assert row["GridMap:translation"] == [[-1.0, 3.0, 0.0]]
    assert row["GridMap:cell_size"] == [2.0]


def test_the_file_opens_with_its_own_layout(tmp_path: Path) -> None:
    Observer(tmp_path, GRID, window=False).close()
    (blueprint,) = RrdReader(str(tmp_path / "view.rrd")).blueprints()
    (recording,) = RrdReader(str(tmp_path / "view.rrd")).recordings()
    assert blueprint.application_id == recording.application_id == "acrc-testbed"


def test_colours_follow_the_scenarios_order(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, window=False)
    observer.truth(truth(0))
    observer.close()
    found = rows(tmp_path / "view.rrd")
    colours = [found[f"/world/robots/{robot}/body"][0]["Cylinders3D:colors"] for robot in ("r1", "r2")]
    assert colours == [[0xD62728FF], [0x1F55D6FF]]


def test_a_robot_that_does_not_act_says_so(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, window=False)
    observer.truth(truth(0, r1={"stepping": False}, r2={"powered": False, "stepping": False}))
    observer.close()
    (row,) = rows(tmp_path / "view.rrd")["/world/labels"]
    assert row["Points3D:labels"] == ["r1 (frozen)", "r2 (off)"]


def test_at_most_ten_pictures_a_second_and_the_last_truth_always(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, window=False)
    for step in range(26):
        observer.truth(truth(step, step_us=10_000))
    assert observer.close() == ViewSummary(missed=0, shown=4, expected=26, whole=False)
    assert times(rows(tmp_path / "view.rrd")["/world/labels"]) == [0.0, 0.1, 0.2, 0.25]


def test_steps_that_never_came_are_counted(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, window=False)
    for step in (2, 3, 7):
        observer.truth(truth(step))
    assert observer.close() == ViewSummary(missed=5, shown=3, expected=8, whole=False)


def test_a_halt_without_robots_keeps_the_last_picture(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, window=False)
    for step in range(3):
        observer.truth(truth(step, step_us=10_000))
    observer.truth(Truth(3, 30_000, (), halt=True))
    assert observer.close() == ViewSummary(missed=0, shown=2, expected=4, whole=True)


def test_a_machine_without_a_display_gets_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(viewer, "spawn", lambda: pytest.fail("a window was opened"))
    observer = Observer(tmp_path, GRID)
    assert observer.notice == f"There is no display: the view goes to {tmp_path}/view.rrd only."
    observer.close()


def test_a_window_that_does_not_open_costs_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def spawn() -> str:
        raise RuntimeError("rerun's viewer ended at once with status 1")

    monkeypatch.setattr(viewer, "spawn", spawn)
    observer = Observer(tmp_path, GRID, window=True)
    assert observer.notice == (
        "The window does not open (rerun's viewer ended at once with status 1): "
        f"the view goes to {tmp_path}/view.rrd only."
    )
    observer.truth(truth(0))
    assert observer.close() == ViewSummary(missed=0, shown=1, expected=1, whole=False)


@pytest.mark.parametrize(
    ("environment", "platform", "display"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ""}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({}, "darwin", True),
    ],
)
def test_where_a_window_can_open(environment: dict[str, str], platform: str, display: bool) -> None:
    assert viewer.has_display(environment, platform) is display


def test_a_place_where_nothing_can_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(AcrcError) as error:
        Observer(tmp_path / "nowhere", GRID, window=False)
    path = tmp_path / "nowhere" / "view.rrd"
    assert str(error.value) == f"{path}: the view cannot be written: No such file or directory."
