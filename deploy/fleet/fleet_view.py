"""Live view of physical robots from their reports: pose estimates, items of the task, radio; no ground truth.

Messages are drawn at their time of arrival, in s since the view started.
"""

import math
import queue
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.results.field_recordings import EVENT_COUNTERS
from acrc_testbed.run_model.data import RunDescription
from acrc_testbed.run_model.model import RunModel, convert_instants, robot_of
from acrc_testbed.view.run_drawing import RunDrawing
from acrc_testbed.view.run_view import print_now
from actors.floor.map_file import load_map
from actors.messages import (
    DRIVE,
    RECEIVED,
    TASK_CHANGED,
    Board,
    Drive,
    Progress,
    RadioEvents,
    TaskChanged,
)
from actors.observer import panels, viewer
from actors.observer.canvas import Canvas
from actors.observer.glyphs import GREY, OUTCOME_COLOURS
from actors.observer.layout import ViewerContents, ViewFile
from actors.observer.panels import DrawnEvent
from actors.processes.launcher import scratch_folder
from actors.runtime.core import at
from actors.settings import decode
from actors.task.checked_judge import CheckedJudge
from actors.task.loading import ReportError, decode_items, decode_reports, load_task
from actors.task.task import JudgeSetup
from actors.topic import Message
from deploy.fleet import operator_station
from deploy.fleet.fleet_file import Fleet

_PERIOD_S: Final = 0.2
"""Period of drawing."""
_SILENT_S: Final = 2.0
"""Time without messages after which a robot is shown as disconnected; robots send ten times per second."""
_RATE_WINDOW_S: Final = 5.0
"""Time window of radio frame rates."""
_MAX_QUEUED: Final = 20_000
"""Maximum number of queued messages: those of ten robots for 90 s."""


class ReceivedMessage(NamedTuple):
    """A message with its time of arrival."""

    second: float
    endpoint: str
    key: str
    message: Message


class FleetView:
    """Incremental drawing of a fleet from its messages."""

    def __init__(self, fleet: Fleet, sheet: ViewFile) -> None:
        self.robots = tuple(robot.id for robot in fleet.robots)
        self._task = task = load_task(fleet.task.use)
        settings = decode(task.settings, fleet.task_settings, task.declaration.table)
        items = {robot.id: decode_items(task, robot.items) for robot in fleet.robots}
        setup = JudgeSetup(robots=self.robots, items=items, settings=settings, has_truth=False)
        self._judge = CheckedJudge(task, setup)
        description = RunDescription(
            out=Path(),
            title="a fleet",
            robots=self.robots,
            grid=load_map(fleet.map),
            step_us=0,
            task=task.declaration,
            item_counts={robot.id: len(robot.items) for robot in fleet.robots},
            addresses={robot.address: robot.id for robot in fleet.robots},
            has_truth=False,
        )
        self._model = RunModel(description)
        self._add_task_changes(0.0)
        self._canvas = Canvas(sheet.recording, self.robots)
        self._last: dict[str, float] = {}
        """Time of the last message by robot, s."""
        self._endpoints: dict[str, str] = {}
        """Robot by endpoint, known from its first message."""
        self._reports: dict[str, str] = {}
        """Text of the last progress report by robot or endpoint."""
        self._counts = Counter[str]()
        """Number of frames by outcome since they were last drawn, from the first such frame on."""
        self._counted = 0.0
        self._missed = 0
        self._drawing = RunDrawing(self._canvas, self._model.take_reports(0.0), ())
        for robot in self.robots:
            panels.set_line_style(self._canvas, f"plots/ages/{robot}", robot, self._canvas.colour(robot))

    def draw(self, messages: Sequence[ReceivedMessage], now: float, missed: int) -> None:
        """Draw messages up to `now`, s; `missed`: total of messages dropped by the view."""
        events = [event for one in messages for event in self._add_message(one)]
        if missed > self._missed:
            text = f"view dropped {missed - self._missed} messages: too many to draw"
            events.append(DrawnEvent(now, "", text, "WARN"))
            self._missed = missed
        for robot in self.robots:
            is_silent = now - self._last.get(robot, -math.inf) > _SILENT_S
            self._model.set_state(robot, self._model.since, "not heard" if is_silent else "")
        run = self._model.take_reports(now)
        self._drawing.draw_recorded(run)
        self._drawing.draw_computed(run)
        self._drawing.draw_notices(events)
        for robot, last in self._last.items():
            panels.draw_line(self._canvas, f"plots/ages/{robot}", [now], np.array([now - last]))
        if now >= self._counted + _RATE_WINDOW_S:
            self._plot_frames(now)

    def _add_message(self, received: ReceivedMessage) -> Iterator[DrawnEvent]:
        """Add a message to the model at its time of arrival; yield its events."""
        second, endpoint, key, message = received
        robot = robot_of(key) or self._endpoints.get(endpoint, "")
        if robot in self.robots:
            self._endpoints[endpoint] = robot
            self._last[robot] = second
        match message:
            case Drive() | RadioEvents() if robot in self.robots:
                if isinstance(message, RadioEvents):
                    for event in message.events:
                        self._count_frame(EVENT_COUNTERS[type(event)])
                message = convert_instants(message, lambda _: round(second * 1e6))
                self._model.extend(key, message, second)
                if isinstance(message, Drive):
                    yield from self._judged(robot, message, second)
            case Progress():
                source, report = robot or endpoint, operator_station.progress_text(message)
                if self._reports.get(source) != report:
                    self._reports[source] = report
                    yield DrawnEvent(second, source, report, "WARN" if message.held else "INFO")
            case Board():
                yield from (DrawnEvent(second, robot, f"board: {note}") for note in message.notes)

    def _judged(self, robot: str, drive: Drive, second: float) -> Iterator[DrawnEvent]:
        """Pass a robot's reports to the task's judge, as of their arrival; yield its fault."""
        instant = round(second * 1e6)
        try:
            reports = decode_reports(self._task, drive).reports
            reports = tuple(
                msgspec.structs.replace(one, instant=instant) if hasattr(one, "instant") else one
                for one in reports
            )
            answer = msgspec.structs.replace(drive, reports=reports)
            fault = self._judge.take(robot, answer, instant, instant + 1)
        except ReportError as error:
            fault = str(error)
        if fault is not None:
            yield DrawnEvent(second, robot, fault, "WARN")
        self._add_task_changes(second)

    def _add_task_changes(self, second: float) -> None:
        if any(changes := self._judge.take_changes()):
            self._model.extend(TASK_CHANGED.key(), TaskChanged(0, *changes), second)

    def _count_frame(self, name: str) -> None:
        if name not in self._counts:
            colour = OUTCOME_COLOURS["heard"] if name == "copies_heard" else GREY
            panels.set_line_style(self._canvas, f"plots/copies/{name}", name.replace("_", " "), colour)
        self._counts[name] += 1

    def _plot_frames(self, now: float) -> None:
        """Plot frames per second by outcome."""
        for name, count in self._counts.items():
            rate = count / (now - self._counted)
            panels.draw_line(self._canvas, f"plots/copies/{name}", [now], np.array([rate]))
            self._counts[name] = 0
        self._counted = now


def show(endpoints: Sequence[str], keys: Path, fleet: Fleet) -> None:
    """Show robots in the viewer and print their reports, until interrupted.

    The viewer is a window if there is a display, else a browser page. Raises AcrcError for invalid endpoints,
    keys or map.
    """
    waiting, lines = queue.Queue[ReceivedMessage](_MAX_QUEUED), queue.SimpleQueue[str]()
    grid, started, missed = load_map(fleet.map), time.monotonic(), 0

    def on_message(endpoint: str, key: str, message: Message) -> None:
        nonlocal missed
        try:
            waiting.put_nowait(ReceivedMessage(time.monotonic() - started, endpoint, key, message))
        except queue.Full:
            missed += 1

    operator_station.start_listeners(
        endpoints, keys, lines, further_addresses=(at(DRIVE, "*"), at(RECEIVED, "*")), on_message=on_message
    )
    opened = viewer.open_any(print_now, "reports are printed only")
    try:
        if opened is not None and opened.page:
            print_now(f"open {opened.page} in a browser on this machine to see the robots; Ctrl-C to quit")
        with scratch_folder() as folder:
            contents = ViewerContents(grid, [robot.id for robot in fleet.robots], true=False)
            address = None if opened is None else opened.address
            with ViewFile(folder / "view.rrd", contents, name="a fleet", send_to=address) as sheet:
                view = FleetView(fleet, sheet)
                while True:
                    messages = [waiting.get_nowait() for _ in range(waiting.qsize())]
                    view.draw(messages, time.monotonic() - started, missed)
                    while not lines.empty():
                        print_now(lines.get())
                    time.sleep(_PERIOD_S)
    finally:
        viewer.terminate(opened)
