"""The file that a run leaves for rerun, read back without a window."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.messages import Drive, RobotTruth, Truth
from actors.observer import colours, viewer
from actors.observer.observer import Observer, ViewSummary
from actors.observer.sheet import APPLICATION
from actors.runtime.errors import AcrcError
from actors.task.words import PlaceGivenUp, PlaceKey, PlaceReport

GRID = OccupancyGrid(
    np.array([[OCCUPIED, FREE, FREE], [UNKNOWN, FREE, OCCUPIED]], dtype=np.uint8), 2.0, Point(-1.0, 3.0)
)
PLACES = {"r1": [Point(1.0, 4.0), Point(2.0, 4.0)], "r2": [Point(3.0, 5.0)]}
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


def packed(colour: tuple[int, int, int]) -> int:
    """As rerun keeps it."""
    return int.from_bytes((*colour, 0xFF), "big")


def drive(step: int, **more: Any) -> Drive:
    return Drive(step, 0.0, 0.0, 0.0, 0, **more)


def test_the_file_holds_map_places_robots_and_trails_over_time(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    for step in range(16):
        observer.truth(truth(step))
    assert observer.close() == ViewSummary(missed=0, shown=16, expected=16, whole=False)
    found = rows(tmp_path / "view.rrd")
    robots = {
        f"/world/robots/{robot}{part}"
        for robot in ("r1", "r2")
        for part in ("", "/turn", "/turn/body", "/turn/nose", "/marker", "/name")
    }
    assert {entity for entity in found if entity.startswith("/world")} == robots | {
        *("/world/map", "/world/places/r1", "/world/places/r2"),
        *(f"/world/{trail}/{robot}" for trail in ("trails", "history") for robot in ("r1", "r2")),
    }
    poses = found["/world/robots/r1"]
    np.testing.assert_allclose(times(poses), np.arange(16) / 10, atol=1e-6)
    np.testing.assert_allclose(poses[4]["Transform3D:translation"], [[0.4, 4.0, 0.0]], atol=1e-6)
    turned = np.array(found["/world/robots/r1/turn"][4]["Transform3D:quaternion"])[0]
    np.testing.assert_allclose(turned, [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)], atol=1e-6)
    pieces = [row for row in found["/world/trails/r1"] if "sim_time" in row]
    ways = np.array([row["LineStrips3D:strips"][0] for row in pieces])
    np.testing.assert_allclose(times(pieces), [0.5, 1.0, 1.5], atol=1e-6)
    np.testing.assert_allclose(ways[:, :, 0], [[0.0, 0.5], [0.5, 1.0], [1.0, 1.5]], atol=1e-6)
    assert [row for row in found["/world/trails/r2"] if "sim_time" in row] == [], "it has not moved"


def test_a_robot_put_elsewhere_leaves_no_trail_to_there(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    for step in (0, 5, 10, 60, 65):  # by 0.1 m a step: 5 m from one truth to the next
        observer.truth(truth(step))
    observer.close()
    pieces = [row for row in rows(tmp_path / "view.rrd")["/world/history/r1"] if "sim_time" in row]
    np.testing.assert_allclose(times(pieces), [0.5, 1.0, 6.5], atol=1e-6)


def test_places_show_what_became_of_them_and_who_holds_them(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    observer.truth(truth(0))
    observer.drive("r1", drive(1))
    observer.truth(truth(1))
    observer.drive("r2", drive(2, reports=(PlaceReport("r1", 1, 200_000),)))
    observer.drive("r2", drive(2, given_up=(PlaceGivenUp("r2", 0, 200_000, "shut"),)))
    observer.truth(truth(2))
    observer.drive("r2", drive(3, route=(PlaceKey("r1", 0), PlaceKey("r2", 0))))
    observer.truth(truth(3))
    observer.close()
    found = rows(tmp_path / "view.rrd")
    own, other = (packed(colour) for colour in colours.ROBOTS[:2])
    dim, grey = packed(colours.faded(colours.ROBOTS[0], 0.55)), packed(colours.GREY)
    first, second = found["/world/places/r1"], found["/world/places/r2"]
    np.testing.assert_allclose(times(first), [0.0, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(times(second), [0.0, 0.2], atol=1e-6)
    assert [row["LineStrips3D:colors"] for row in first] == [[own, own], [own, dim], [own, other, dim]]
    assert [row["LineStrips3D:colors"] for row in second] == [[other], [grey, grey]]
    words = [row["TextLog:text"][0] for robot in ("r2",) for row in found[f"/events/{robot}/live"]]
    assert words == ["r2 cleaned r1/1", "r2 gives up r2/0", "r2 adopts r1/0"]
    assert found["/plots/places/r2"][-1]["Scalars:scalars"] == [1.0]


def test_the_map_lies_where_the_grid_says_north_edge_first(tmp_path: Path) -> None:
    Observer(tmp_path, GRID, PLACES, window=False).close()
    (row,) = rows(tmp_path / "view.rrd")["/world/map"]
    around, free, wall = colours.GROUND, colours.FLOOR, colours.WALL
    assert bytes(row["GridMap:data"][0]) == bytes([around, free, wall, wall, free, free])
    assert row["GridMap:translation"] == [[-1.0, 3.0, 0.0]]
    assert row["GridMap:cell_size"] == [2.0]


def test_the_file_opens_with_its_own_layout(tmp_path: Path) -> None:
    Observer(tmp_path, GRID, PLACES, window=False).close()
    (blueprint,) = RrdReader(str(tmp_path / "view.rrd")).blueprints()
    (recording,) = RrdReader(str(tmp_path / "view.rrd")).recordings()
    assert blueprint.application_id == recording.application_id == APPLICATION


def test_colours_follow_the_scenarios_order(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    observer.truth(truth(0))
    observer.close()
    found = rows(tmp_path / "view.rrd")
    drawn = [found[f"/world/robots/{robot}/turn/body"][0]["Cylinders3D:colors"] for robot in ("r1", "r2")]
    assert drawn == [[packed(colour)] for colour in colours.ROBOTS[:2]]


def test_a_robot_that_does_not_act_says_so(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    observer.truth(truth(0, r1={"stepping": False}, r2={"powered": False, "stepping": False}))
    observer.truth(truth(1, r2={"powered": False, "stepping": False}))
    observer.close()
    found = rows(tmp_path / "view.rrd")
    names = [[row["Points3D:labels"][0] for row in found[f"/world/robots/{r}/name"]] for r in ("r1", "r2")]
    assert [told[-1] for told in names] == ["r1", "r2 (off)"] and "r1 (frozen)" in names[0]
    lanes = [
        [row["StateChange:state"][0] for row in found[f"/states/{robot}"] if "sim_time" in row]
        for robot in ("r1", "r2")
    ]
    assert lanes == [["frozen", "driving"], ["off"]]


def test_how_far_off_a_robot_held_itself_to_be_is_plotted(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    observer.truth(truth(0))
    observer.drive("r1", drive(0, pose=(0.3, 4.4, 0.0)))
    observer.truth(truth(1))
    observer.drive("r1", drive(0, pose=(9.0, 9.0, 0.0)))  # late: of a step whose truth is gone
    observer.truth(truth(2))
    observer.close()
    values = [row for row in rows(tmp_path / "view.rrd")["/plots/error/r1"] if "sim_time" in row]
    np.testing.assert_allclose([row["Scalars:scalars"][0] for row in values], [0.5])


def test_at_most_ten_pictures_a_second_and_the_last_truth_always(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    for step in range(26):
        observer.truth(truth(step, step_us=10_000))
    assert observer.close() == ViewSummary(missed=0, shown=4, expected=26, whole=False)
    shown = times(rows(tmp_path / "view.rrd")["/world/robots/r1"])
    np.testing.assert_allclose(shown, [0.0, 0.1, 0.2, 0.25], atol=1e-6)


def test_steps_that_never_came_are_counted_and_shown(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    for step in (2, 3, 7):
        observer.truth(truth(step))
    assert observer.close() == ViewSummary(missed=5, shown=3, expected=8, whole=False)
    told = [row["TextLog:text"][0] for row in rows(tmp_path / "view.rrd")["/events/run/live"]]
    assert told == [f"the view lacks {steps} steps that were not received" for steps in (2, 3)]


def test_a_halt_without_robots_keeps_the_last_picture(tmp_path: Path) -> None:
    observer = Observer(tmp_path, GRID, PLACES, window=False)
    for step in range(3):
        observer.truth(truth(step, step_us=10_000))
    observer.truth(Truth(3, 30_000, (), halt=True))
    assert observer.close() == ViewSummary(missed=0, shown=2, expected=4, whole=True)


def test_a_machine_without_a_display_gets_a_page_which_ends_with_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(viewer, "open_window", lambda: pytest.fail("a window was opened"))
    said: list[str] = []
    observer = Observer(tmp_path, GRID, PLACES, say=said.append)
    (sentence,) = said
    opened = re.fullmatch(
        r"To see the run while it goes on, open (http://127\.0\.0\.1:\d+/)\?url=\S+ in a browser on this "
        r"machine\.",
        sentence,
    )
    assert opened is not None
    with urlopen(opened[1], timeout=10) as page:
        assert b"Rerun" in page.read()
    observer.truth(truth(0))
    assert observer.close() == ViewSummary(missed=0, shown=1, expected=1, whole=False)
    with pytest.raises(URLError):
        urlopen(opened[1], timeout=10)


def test_a_viewer_that_does_not_open_costs_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def start() -> viewer.OpenViewer:
        raise RuntimeError("rerun's viewer ended at once with status 1")

    monkeypatch.setattr(viewer, "open_window", start)
    monkeypatch.setattr(viewer, "open_page", start)
    said: list[str] = []
    observer = Observer(tmp_path, GRID, PLACES, say=said.append)
    assert said == [
        "The viewer does not open (rerun's viewer ended at once with status 1): "
        f"the view goes to {tmp_path}/view.rrd only."
    ]
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
        Observer(tmp_path / "nowhere", GRID, PLACES, window=False)
    path = tmp_path / "nowhere" / "view.rrd"
    assert str(error.value) == f"{path}: the view cannot be written: No such file or directory."
