"""Drawing of runs into a view file, read back without a window; windows and pages; glyphs."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
from coloraide import Color

from acrc_testbed.explanation.time_spent import Cause
from acrc_testbed.recordings.run_recordings import RecordedOrder
from acrc_testbed.run_model.data import ItemEvent, Route, RunData, Trajectory
from acrc_testbed.run_model.floor import FloorObject
from acrc_testbed.view import __main__ as program
from acrc_testbed.view import run_view
from acrc_testbed.view.run_drawing import RunDrawing
from actors.floor.grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from actors.geometry import Point
from actors.items import ItemKey
from actors.messages import ItemMark, TaskEvent
from actors.observer import glyphs, viewer
from actors.observer.canvas import Canvas
from actors.observer.glyphs import Colour
from actors.observer.layout import ViewerContents, ViewFile
from actors.orders import Wall
from actors.robot.introspector import ACTIVITIES
from tests.run_data import run_data
from tests.view.conftest import Rows, rows

pytestmark = pytest.mark.usefixtures("strict")
GRID = OccupancyGrid(
    np.array([[OCCUPIED, FREE, FREE], [UNKNOWN, FREE, OCCUPIED]], dtype=np.uint8), 2.0, Point(-1.0, 3.0)
)
MARKS = tuple(
    (0.0, ItemMark(owner, number, x, y, "open"))
    for owner, number, x, y in (("r1", 0, 1.0, 4.0), ("r1", 1, 2.0, 4.0), ("r2", 0, 3.0, 5.0))
)
COUNTS = {"r1": 2, "r2": 1}


def times(some: list[dict[str, Any]]) -> list[float]:
    return [row["sim_time"].total_seconds() for row in some]


def packed(colour: tuple[int, int, int]) -> int:
    """Return a colour in rerun's format."""
    return int.from_bytes((*colour, 0xFF), "big")


def track(
    steps: range, acts: tuple[tuple[float, str], ...] = ((0.0, ""),), *, still: bool = False
) -> Trajectory:
    """Return a robot's track: 10 steps/s, 0.1 m east per step, estimated 0.5 m too far."""
    seconds = np.array(steps, np.float64) / 10
    x = np.full(len(steps), 3.0) if still else np.array(steps) / 10
    poses = np.column_stack((x, np.full(len(steps), 4.0), np.full(len(steps), np.pi / 2)))
    held = poses + np.array([0.3, 0.4, 0.0])
    return Trajectory(
        seconds, poses, held, np.zeros_like(held), tuple(one for one in acts if one[0] in seconds)
    )


def run(steps: range, states: dict[str, tuple[tuple[float, str], ...]] | None = None, **more: Any) -> RunData:
    """Return a part of a run of two robots; the second one stands."""
    told = states or {}
    trajectories = {
        "r1": track(steps, told.get("r1", ((0.0, ""),))),
        "r2": track(steps, told.get("r2", ((0.0, ""),)), still=True),
    }
    true = np.stack([one.poses for one in trajectories.values()], axis=1)
    piece = run_data(("r1", "r2"), 100_000, GRID, true=true)
    since = max(0, steps[0] - 1) / 10
    description = replace(piece.description, item_counts=COUNTS)
    return replace(piece, **{"description": description, "trajectories": trajectories,
                             "end": steps[-1] / 10, "since": since, **more})  # fmt: skip


def painted(path: Path, *pieces: RunData) -> Rows:
    """Return the contents of the view file after drawing the parts in order."""
    with ViewFile(path, ViewerContents(GRID, ("r1", "r2")), name="a run") as sheet:
        drawing = RunDrawing(Canvas(sheet.recording, ("r1", "r2")), pieces[0], ())
        for piece in pieces:
            drawing.draw_recorded(piece)
    return rows(path)


def test_a_carried_robot_leaves_no_trail(tmp_path: Path) -> None:
    near, far = run(range(11)), run(range(60, 66))  # by 0.1 m a step: 5 m from one piece to the next
    found = painted(tmp_path / "view.rrd", near, far)
    pieces = [row for row in found["/world/history/r1"] if "sim_time" in row]
    np.testing.assert_allclose(times(pieces), [0.5, 1.0, 6.5], atol=1e-6)


def test_people_are_discs_at_their_positions(tmp_path: Path) -> None:
    people: Any = np.arange(24.0).reshape(3, 2, 4)
    found = painted(tmp_path / "view.rrd", replace(run(range(3)), people=people))["/world/people"]
    style, *moving = found
    assert packed(glyphs.PERSON) in style["Points3D:colors"]
    assert style["Points3D:radii"] == [pytest.approx(glyphs.PERSON_RADIUS)]
    np.testing.assert_allclose(times(moving), [0.0, 0.1, 0.2], atol=1e-6)
    drawn = np.array([row["Points3D:positions"] for row in moving])
    np.testing.assert_allclose(drawn[..., :2], people[..., :2])


def test_items_show_their_states_and_holders_part_by_part(tmp_path: Path) -> None:
    cleaned = TaskEvent("r2", 200_000, "cleaned", "r1", 1)
    done = run(
        range(3), marks=(*MARKS, (0.2, ItemMark("r1", 1, 2.0, 4.0, "done", "r2"))), task_events=(cleaned,) * 2
    )
    gone = run(
        range(3, 5),
        marks=((0.4, ItemMark("r2", 0, 3.0, 5.0, "given up", "r2")),),
        given_up=(ItemEvent("r2", 0.4, ItemKey("r2", 0)),),
    )
    taken = ItemKey("r1", 0)
    route = run(
        range(5, 7),
        routes=(Route("r2", 0.5, (taken, ItemKey("r2", 0))),),
        taken_over=(ItemEvent("r2", 0.5, taken),),
    )
    found = painted(tmp_path / "view.rrd", done, gone, route)
    own, other = (packed(colour) for colour in glyphs.ROBOTS[:2])
    dim, grey = packed(glyphs.faded(glyphs.ROBOTS[0], 0.55)), packed(glyphs.GREY)
    first, second = found["/world/items/r1"], found["/world/items/r2"]
    np.testing.assert_allclose(times(first), [0.0, 0.2, 0.5], atol=1e-6)
    np.testing.assert_allclose(times(second), [0.0, 0.4], atol=1e-6)
    assert [row["LineStrips3D:colors"] for row in first] == [[own, own], [own, dim], [own, other, dim]]
    assert [row["LineStrips3D:colors"] for row in second] == [[other], [grey, grey]]
    words = [row["TextLog:text"][0] for row in found["/events/r2/recorded"]]
    assert words == ["r2 cleaned r1/1, adopted from r1", "r2 gives up r2/0", "r2 adopts r1/0"]
    assert found["/plots/items/r2"][-1]["Scalars:scalars"] == [1.0]
    arrow = found["/world/adoptions/r2"]
    np.testing.assert_allclose(times(arrow), [0.5, 6.5], atol=1e-6)


@pytest.mark.parametrize("batteries", [True, False])
def test_the_charge_is_drawn_once_a_second_with_batteries_only(batteries: bool, tmp_path: Path) -> None:
    piece = run(range(26))
    charge = np.column_stack((np.linspace(0.9, 0.4, 26), np.full(26, np.nan)))
    description = replace(piece.description, has_batteries=batteries)
    found = painted(tmp_path / "view.rrd", replace(piece, description=description, charge=charge))
    assert ("/plots/charge/r1" in found) == batteries
    if batteries:
        drawn = [row for row in found["/plots/charge/r1"] if "sim_time" in row]
        np.testing.assert_allclose(times(drawn), [0.0, 1.0, 2.0], atol=1e-6)
        np.testing.assert_allclose([row["Scalars:scalars"][0] for row in drawn], [0.9, 0.7, 0.5])
        assert all("sim_time" not in row for row in found["/plots/charge/r2"])


def test_the_map_lies_where_the_grid_says_north_edge_first(tmp_path: Path) -> None:
    (row,) = painted(tmp_path / "view.rrd", run(range(2)))["/world/map"]
    around, free, wall = glyphs.GROUND, glyphs.FLOOR, glyphs.WALL
    cells = [around, free, wall, wall, free, free]
    assert bytes(row["GridMap:data"][0]) == bytes(part for cell in cells for part in (cell,) * 3)
    assert row["GridMap:translation"] == [[-1.0, 3.0, 0.0]]
    assert row["GridMap:cell_size"] == [2.0]


def test_an_inactive_robot_is_labelled_with_its_state(tmp_path: Path) -> None:
    acts = {"r1": ((0.0, "frozen"), (0.3, "")), "r2": ((0.0, "off"),)}
    found = painted(tmp_path / "view.rrd", run(range(3), acts), run(range(3, 5), acts))
    names = [[row["Points3D:labels"][0] for row in found[f"/world/robots/{r}/name"]] for r in ("r1", "r2")]
    assert names == [["r1 (frozen)", "r1"], ["r2 (off)"]]
    lanes = [
        [row["StateChange:state"][0] for row in found[f"/{robot}"] if "sim_time" in row]
        for robot in ("r1", "r2")
    ]
    assert lanes == [["frozen"], ["off"]]
    told = [row["TextLog:text"][0] for row in found["/events/r1/recorded"]]
    assert told == ["r1 is frozen", "r1 is active again"]


def test_floor_objects_are_drawn_until_they_are_removed(tmp_path: Path) -> None:
    wall = FloorObject("wall", ((0.0, 4.0), (1.0, 4.0)), 0.05)
    jammer = FloorObject("jammer", ((2.0, 5.0),), 1.0)
    orders = (RecordedOrder(1, Wall(0.0, 4.0, 1.0, 4.0)),)
    told = run(range(5), floor=((0.1, (wall, jammer)), (0.3, (wall,))), orders=orders)
    found = painted(tmp_path / "view.rrd", told)
    assert [row["Points3D:labels"] for row in found["/world/put/names"]] == [["wall", "jammer"], ["wall"]]
    assert times(found["/world/put"]) == [0.1, 0.3]
    widths = [row["LineStrips3D:strips"] for row in found["/world/put"]]
    assert len(widths[0]) == 1 + 12 and len(widths[1]) == 1, "a ring of dashes"
    assert [row["TextLog:text"][0] for row in found["/events/run/recorded"]] == [
        "wall placed from (0.0, 4.0) to (1.0, 4.0)"
    ]


def test_a_machine_without_a_display_gets_a_page_which_ends_with_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(viewer, "open_window", lambda: pytest.fail("a window was opened"))
    for name in ("exit_on_sigterm", "die_with_parent"):
        monkeypatch.setattr(program, name, lambda *words: None)
    monkeypatch.setattr("os.nice", lambda more: 0)
    pages: list[str] = []

    def follow(out: Path, path: Path, robots: list[str], opened: Any, say: Any, **more: bool) -> None:
        page = opened.page.partition("?")[0]
        with urlopen(page, timeout=10) as shown:
            assert b"Rerun" in shown.read()
        pages.append(page)

    monkeypatch.setattr(run_view, "follow_run", follow)
    assert program.main(["--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"To watch the run live, open {pages[0]}?url=")
    assert said.endswith(" in a browser on this machine.\n")
    with pytest.raises(URLError):
        urlopen(pages[0], timeout=10)


def test_a_viewer_that_cannot_open_is_reported_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def start() -> viewer.OpenViewer:
        raise RuntimeError("rerun's viewer exited at once with code 1")

    monkeypatch.setattr(viewer, "open_window", start)
    monkeypatch.setattr(viewer, "open_page", start)
    said: list[str] = []
    assert viewer.open_any(said.append, "the view is written to its file only") is None
    assert said == [
        "Cannot open the viewer (rerun's viewer exited at once with code 1); "
        "the view is written to its file only."
    ]


def test_where_a_window_can_open() -> None:
    assert viewer.has_display({"DISPLAY": ":0"}, "linux") and viewer.has_display({}, "darwin")
    assert viewer.has_display({"WAYLAND_DISPLAY": "wayland-0"}, "linux")
    assert not viewer.has_display({}, "linux") and not viewer.has_display({"DISPLAY": ""}, "linux")


LEAST = 10.0
EYES = ("", "protan", "deutan")
METHODS = ("brettel", "vienot", "machado")


def seen(colour: Colour, eye: str, method: str) -> Color:
    shown = Color("srgb", [part / 255 for part in colour])
    return shown.filter(eye, method=method).clip() if eye else shown


def nearest(named: Mapping[str, Colour]) -> tuple[float, str]:
    """Return the smallest CIEDE2000 difference of two colours, the pair, and the kind of vision."""
    found = []
    for eye in EYES:
        for method in METHODS if eye else METHODS[:1]:
            shown = {name: seen(colour, eye, method) for name, colour in named.items()}
            for one, other in combinations(shown, 2):
                far = shown[one].delta_e(shown[other], method="2000")
                found.append((far, f"{one} and {other} for {eye or 'normal'} eyes by {method}"))
    return min(found)


@pytest.mark.parametrize("states", [glyphs.CAUSE_GLYPHS, glyphs.ACTIVITY_GLYPHS], ids=["seen", "own"])
def test_any_two_states_of_a_picture_differ_for_all_eyes(states: Mapping[str, glyphs.StateGlyph]) -> None:
    far, which = nearest({word: glyph.colour for word, glyph in states.items()})
    assert far >= LEAST, which


def test_robots_and_floor_objects_differ_for_all_eyes() -> None:
    named = {f"robot {index}": colour for index, colour in enumerate(glyphs.ROBOTS)}
    far, which = nearest({**named, "put": glyphs.PUT, "jammer": glyphs.JAM})
    assert far >= LEAST, which


def test_states_of_like_colour_differ_by_their_hatch_in_grey() -> None:
    for states in (glyphs.CAUSE_GLYPHS, glyphs.ACTIVITY_GLYPHS):
        for one, other in combinations(states.values(), 2):
            grey = glyphs.contrast(one.colour, other.colour)
            assert grey >= 1.25 or one.hatch != other.hatch, (one, other)


def test_each_word_has_one_glyph() -> None:
    assert set(glyphs.CAUSE_GLYPHS) == {cause.value for cause in Cause}
    assert {*ACTIVITIES, "driving", "standing", "frozen", "off", "not heard"} <= set(glyphs.ACTIVITY_GLYPHS)
    for word in set(glyphs.CAUSE_GLYPHS) & set(glyphs.ACTIVITY_GLYPHS):
        assert glyphs.CAUSE_GLYPHS[word] == glyphs.ACTIVITY_GLYPHS[word]


def test_floor_objects_are_visible_on_both_backgrounds() -> None:
    floor = (glyphs.FLOOR,) * 3
    for colour in (glyphs.PUT, glyphs.JAM, glyphs.CLOSED, *glyphs.ROBOTS[:4]):
        assert glyphs.contrast(colour, floor) >= 3 and glyphs.contrast(colour, glyphs.WHITE) >= 3
