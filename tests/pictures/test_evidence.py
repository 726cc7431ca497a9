"""Data of a run from its recordings, compared with its result and in pictures."""

import math
import re
import shutil
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patches import Patch
from matplotlib.text import Annotation
from PIL import Image

from acrc_testbed.explanation.time_accounting import account_time, cause_intervals
from acrc_testbed.explanation.time_spent import BY_ROBOTS, Cause
from acrc_testbed.picture import marks, run_html, run_movie, run_page, style
from acrc_testbed.picture.floor_picture import blocked_positions
from acrc_testbed.recordings.run_recordings import RecordedOrder
from acrc_testbed.recordings.topics import LoggedMessage
from acrc_testbed.run_model import recording_readers as recorded_contents
from acrc_testbed.run_model import simulated_runs
from acrc_testbed.run_model.data import STEP_COLUMNS, RunData, RunDataError, ordered_changes
from acrc_testbed.run_model.floor import FloorObject, floor_intervals
from acrc_testbed.run_model.simulated_runs import RunReader, read_run
from actors.installation.repository import REPOSITORY as ROOT
from actors.instant import in_seconds
from actors.messages import Truth
from actors.observer import glyphs
from actors.observer.glyphs import (
    ACTIVITY_GLYPHS,
    CAUSE_GLYPHS,
    CLOSED,
    JAM,
    MARKS,
    PUT,
    StateGlyph,
    event_marks,
    item_marks,
)
from actors.orders import Obstacle, StartJam, Wall
from actors.runtime.recording import RecordingError
from actors.topic import Message
from actors.world.world_setup import TimedOrder, WorldSetup
from cleaning.task import CleaningTask
from tests.recorded_runs import HEAD_ON, record


def test_data_agree_with_the_result(evidence: RunData) -> None:
    result = evidence.result
    assert result is not None
    assert evidence.end == pytest.approx(result.simulated_s)
    done = run_page.done_events(evidence)
    assert len(done) == result.task["places_claimed"] == 6
    assert in_seconds(done[-1].instant) == result.task["completion_s"]
    assert evidence.frames_sent.sum() == result.frames["frames_sent"]
    assert evidence.frames_heard.sum() == result.frames["copies_heard"]
    error = np.hypot(*np.moveaxis(evidence.estimated[..., :2] - evidence.true[..., :2], -1, 0))
    assert np.nanmax(error) < 0.01, "its odometry is exact"


def test_places_change_hands_in_the_doorway(evidence: RunData) -> None:
    assert {event.robot for event in evidence.taken_over} == {"r1", "r2"}
    assert all(event.robot != event.key.owner for event in evidence.taken_over)
    first = evidence.taken_over[0]
    at = int(first.second * 10)
    apart = np.hypot(*(evidence.true[at, 0, :2] - evidence.true[at, 1, :2]))
    assert apart < 1.5, "the chapter's distance for an adoption"


def test_cause_intervals_have_no_gaps_or_overlaps(evidence: RunData) -> None:
    for robot in evidence.robots:
        own = [one for one in cause_intervals(evidence) if one.robot == robot]
        assert own[0].begin == 0.0 and own[-1].end == pytest.approx(evidence.end)
        assert all(a.end == b.begin and a.cause != b.cause for a, b in pairwise(own))


def test_a_picture_and_the_accounting_have_the_same_seconds(evidence: RunData) -> None:
    lasted: defaultdict[tuple[str, str], float] = defaultdict(float)
    for one in cause_intervals(evidence):
        lasted[one.robot, one.cause] += one.end - one.begin
    for robot, causes in account_time(evidence.out).robots.items():
        assert {cause: lasted[robot, cause] for cause in causes} == pytest.approx(causes)


@pytest.mark.parametrize("cause", [Cause.OFF, Cause.FROZEN], ids=str)
def test_inactive_robots_are_off_or_frozen(evidence: RunData, cause: Cause) -> None:
    stepping, powered = evidence.stepping.copy(), evidence.powered.copy()
    stepping[500:, 0] = False
    powered[500:, 0] = cause is Cause.FROZEN
    found = cause_intervals(replace(evidence, stepping=stepping, powered=powered))
    last = [one for one in found if one.robot == evidence.robots[0]][-1]
    assert last.cause is cause and last.begin == pytest.approx(50.0)


def test_a_robot_alone_is_not_blocked_by_robots(evidence: RunData) -> None:
    alone = replace(
        evidence,
        description=replace(evidence.description, robots=("r1",)),
        **{column.name: getattr(evidence, column.name)[:, :1] for column in STEP_COLUMNS},
    )
    assert not {one.cause for one in cause_intervals(alone)} & {*BY_ROBOTS}


def test_blocked_positions_last_as_long_as_the_union_of_their_intervals(evidence: RunData) -> None:
    found = blocked_positions(cause_intervals(evidence))
    assert found, "they block each other"
    for x, y, lasted in found:
        assert 5.0 <= lasted <= evidence.end
        assert 11.5 < x < 13.5 and 8.0 < y < 11.5, "in the passage, or before it"


def test_errors_for_invalid_runs(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"not a run folder: it contains no \*/\*\.mcap"):
        read_run(tmp_path)
    part = tmp_path / "part"
    shutil.copytree(folder / "r1", part / "r1")
    with pytest.raises(RunDataError, match=r"no recording of the world; give the folder of a simulated"):
        read_run(part)
    wrong = tmp_path / "wrong"
    shutil.copytree(folder, wrong)
    (wrong / "run.json").write_text("{}")
    with pytest.raises(RunDataError, match=r"run\.json: not a valid run result"):
        read_run(wrong)


def test_a_changing_set_of_robots_is_an_error(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    say = LoggedMessage.message

    def fickle(one: LoggedMessage) -> Message | None:
        told = say(one)
        if isinstance(told, Truth) and one.step == 5:
            return msgspec.structs.replace(told, robots=told.robots[:1])
        return told

    monkeypatch.setattr(LoggedMessage, "message", fickle)
    with pytest.raises(RunDataError, match=r"radio\.mcap: the set of robots changes between steps"):
        read_run(folder)


EVENTS = """
event = [
    { at = 2.0, close = [17.25, 9.4] },
    { at = 3.0, obstacle = [9.0, 11.5], radius = 0.3 },
    { at = 4.0, jam = [20.0, 11.5], radius = 2.0, duration = 5.0 },
    { at = 6.0, freeze = "r1" },
    { at = 8.0, thaw = "r1" },
    { at = 9.0, give = "r1", places = [[14.0, 12.5]] },
    { at = 10.0, open = [17.25, 9.4] },
    { at = 11.0, move = "r2", to = [20.0, 11.5, 0.0] },
    { at = 13.0, kill = "r2" },
]
"""
SPANS = [("closed door", 2.0, 10.0), ("obstacle", 3.0, 16.0), ("jammer", 4.0, 9.0), ("wall", 5.0, 16.0)]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    out = tmp_path_factory.mktemp("things") / "run"
    record(out, EVENTS + HEAD_ON.read_text(), duration=16.0)
    return read_run(out)


@pytest.fixture(scope="module")
def ordered_run(recorded: RunData) -> RunData:
    """Return the run with a wall, which only an operator can order."""
    wall = RecordedOrder(50, Wall(7.0, 11.0, 7.0, 12.0))
    orders = tuple(sorted((*recorded.orders, wall), key=lambda one: one.step))
    own = FloorObject("wall", ((7.0, 11.0), (7.0, 12.0)), 0.05)
    floor = [(second, (*state, *((own,) if second > 5.0 else ()))) for second, state in recorded.floor]
    before = next(state for second, state in reversed(recorded.floor) if second < 5.0)
    floor = sorted([*floor, (5.0, (*before, own))], key=lambda one: one[0])
    return replace(recorded, orders=orders, floor=tuple(floor))


def test_intervals_of_floor_objects(ordered_run: RunData) -> None:
    found = floor_intervals(ordered_run.floor, ordered_run.end)
    assert [(one.object.kind, one.begin, one.end) for one in found] == SPANS
    door = found[0].object
    (x, y), (to_x, to_y) = door.points
    assert math.dist((x, y), (to_x, to_y)) == pytest.approx(0.85, abs=0.1), "across the passage"


def test_a_run_read_in_parts_is_the_same(recorded: RunData) -> None:
    whole = list(recorded.floor)
    pieces: list[tuple[float, tuple[FloorObject, ...]]] = []
    with RunReader(recorded.out) as reader:
        while (piece := reader.poll(last=bool(pieces))) is not None:
            pieces += piece.floor
    assert pieces == whole and len(whole) == 5


def test_orders_without_another_mark_are_listed(ordered_run: RunData) -> None:
    assert [(one.second, one.robot, one.words) for one in ordered_changes(ordered_run)] == [
        (2.0, "", "door at (17.2, 9.4) is closing"),
        (3.0, "", "obstacle of 0.6 m placed at (9.0, 11.5)"),
        (4.0, "", "jammer of 2 m at (20.0, 11.5) for 5 s"),
        (5.0, "", "wall placed from (7.0, 11.0) to (7.0, 12.0)"),
        (9.0, "r1", "receives 1 more place"),
        (10.0, "", "door at (17.2, 9.4) opens"),
        (11.0, "r2", "is carried to (20.0, 11.5)"),
    ]


def test_a_frozen_robot_is_frozen_and_a_killed_one_off(ordered_run: RunData) -> None:
    found = [(one.robot, one.cause, one.begin) for one in cause_intervals(ordered_run)]
    assert ("r1", Cause.FROZEN, 6.0) in found and ("r2", Cause.OFF, 13.0) in found
    assert not any(cause in (Cause.NO_PROGRESS, Cause.OPEN_FLOOR) for _, cause, _ in found)


def test_the_page_has_all_marks_with_a_legend(ordered_run: RunData, tmp_path: Path) -> None:
    with style.context(style.LOOK):
        figure = run_page.draw(ordered_run)
        style.save(figure, tmp_path / "run.png")
    with Image.open(tmp_path / "run.png") as image:
        seen = set(map(tuple, np.asarray(image.convert("RGB")).reshape(-1, 3).tolist()))
    assert {PUT, JAM, CLOSED} <= seen
    says = {text.get_text() for text in legend_of(figure.axes[0]).get_texts()}
    own = ("wall", "obstacle", "jammer", "closed door", "door", "off", "frozen", "carried", "start")
    assert {*(MARKS[name].meaning for name in own), "place added during the run"} <= says
    told = {text.get_text() for text in figure.axes[0].texts}
    assert {"closed 2 to 10 s", "obstacle 3 to 16 s", "jammer 4 to 9 s", "wall 5 to 16 s"} <= told


def test_the_html_page_lists_events_and_orders(ordered_run: RunData) -> None:
    page = run_html.html(ordered_run, b"")
    rows = re.findall(r"<tr><td[^>]*>([^<]*)</td><td>([^<]*)</td><td>([^<]*)</td></tr>", page)
    assert ("5.0", "", "wall placed from (7.0, 11.0) to (7.0, 12.0)") in rows
    assert ("6.0", "r1", "is frozen until 8 s") in rows and ("13.0", "r2", "is off until 16 s") in rows


def test_the_movie_shows_an_object_during_its_interval(ordered_run: RunData, tmp_path: Path) -> None:
    run_movie.write(ordered_run, tmp_path / "m.gif", 10.0)
    with Image.open(tmp_path / "m.gif") as film:
        seen = []
        for second in (1, 6, 12):
            film.seek(second)
            above_the_legend = np.asarray(film.convert("RGB"))[: round(0.8 * film.height)]
            colours = above_the_legend.reshape(-1, 3).astype(int)
            near = [int((np.abs(colours - wanted).max(axis=1) < 24).sum()) for wanted in (PUT, JAM, CLOSED)]
            seen.append([count > 40 for count in near])
    assert seen == [[False, False, False], [True, True, True], [True, False, False]]


def legend_of(axes: Axes) -> Legend:
    found = axes.get_legend()
    assert found is not None
    return found


def test_labels_of_near_points_do_not_overlap() -> None:
    with style.context(style.LOOK):
        figure = style.new_figure(6.0, 4.0)
        axes = figure.add_subplot()
        axes.set_xlim(0.0, 10.0)
        axes.set_ylim(0.0, 6.0)
        marks.fix_layout(figure)
        crowd = [marks.PointLabel(f"r{number}", 5 + number % 5 / 50, 3.0, "#000000") for number in range(20)]
        left_out = marks.place_labels(axes, [*crowd, marks.PointLabel("far", 1.0, 1.0, "#000000")])
        written = [text for text in axes.texts if text.get_text()]
        placed = [text.get_window_extent() for text in written if isinstance(text, Annotation)]
    assert len(placed) == 21 - left_out and left_out < 10
    assert not any(one.overlaps(other) for number, one in enumerate(placed) for other in placed[:number])


def test_lanes_of_delayed_robots_come_first(ordered_run: RunData, monkeypatch: pytest.MonkeyPatch) -> None:
    doing = cause_intervals(ordered_run)
    assert run_page.lane_order(ordered_run, doing) == list(ordered_run.robots)
    monkeypatch.setattr(glyphs, "_FEW", 1)
    kept = dict.fromkeys(ordered_run.robots, 0.0)
    for one in doing:
        kept[one.robot] += 0.0 if one.cause in (Cause.DRIVING, Cause.IDLE) else one.end - one.begin
    assert run_page.lane_order(ordered_run, doing) == sorted(kept, key=lambda robot: -kept[robot])


TASK = CleaningTask.declaration
ALL_MARKS = (*item_marks(TASK).values(), *MARKS.values(), *event_marks(TASK).values())


def glyph_sheet() -> Figure:
    """Draw all states and marks of the drawing language with their names."""
    figure = style.new_figure(9.5, 3.1)
    columns = figure.subplots(1, 4, width_ratios=[1.1, 0.8, 1.9, 0.5])
    _column(columns[0], "by ground truth", _states(CAUSE_GLYPHS))
    _column(columns[1], "reported by the robot", _states(ACTIVITY_GLYPHS))
    _column(columns[2], "on the floor and in lanes", [marks.legend_entry(mark) for mark in ALL_MARKS])
    robots = [Patch(facecolor=colour, label=f"r{number}") for number, colour in enumerate(style.ROBOTS, 1)]
    _column(columns[3], "robots", robots)
    return figure


def _states(states: Mapping[str, StateGlyph]) -> list[Artist]:
    return [Patch(label=word, **run_page.state_style(glyph)) for word, glyph in states.items()]


def _column(axes: Axes, title: str, handles: Sequence[Artist]) -> None:
    axes.set_axis_off()
    axes.set_title(title, loc="left", fontweight="bold", fontsize=9)
    axes.legend(
        handles=handles, loc="upper left", frameon=False, fontsize=8, handlelength=2.4, handleheight=1.1,
        borderaxespad=0.0, borderpad=0.0,
    )  # fmt: skip


def test_the_glyphs_in_the_documentation_are_current(tmp_path: Path) -> None:
    with style.context(style.LOOK):
        figure = glyph_sheet()
        style.save(figure, tmp_path / "glyphs.png")
    with Image.open(tmp_path / "glyphs.png") as drawn, Image.open(ROOT / "docs/pictures/glyphs.png") as kept:
        assert drawn.size == kept.size
        far = np.abs(np.asarray(drawn.convert("RGB")).astype(int) - np.asarray(kept.convert("RGB")))
    assert far.max() == 0, f"copy {tmp_path}/glyphs.png to docs/pictures"
    told = {text.get_text() for axes in figure.axes for text in legend_of(axes).get_texts()}
    assert {*CAUSE_GLYPHS, *ACTIVITY_GLYPHS, *(mark.meaning for mark in ALL_MARKS)} <= told


def test_invalid_orders_are_left_out(short_run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hostile = (
        Obstacle(9.0, 11.5, math.inf),
        Obstacle(9.0, 11.5, 1e5),
        Wall(0.0, 0.0, 1e9, 0.0),
        StartJam(math.nan, 0.0, 1.0, 1),
    )
    orders = (*hostile, Obstacle(9.0, 11.5, 0.3))
    told = recorded_contents.world_setup

    def setup(world: Path) -> WorldSetup:
        return msgspec.structs.replace(told(world), events=tuple(TimedOrder(0, order) for order in orders))

    monkeypatch.setattr(simulated_runs, "world_setup", setup)
    assert [one.order for one in read_run(short_run).orders] == [Obstacle(9.0, 11.5, 0.3)]
