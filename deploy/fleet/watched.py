"""Live robots drawn from what they say: where they hold themselves to be, places, radio; truth nobody knows.

Time is the laptop's, from when it began to listen, and what is said is drawn at the instant at which it came.
"""

import queue
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from acrc_testbed.results.field_recordings import FRAME_OUTCOMES
from acrc_testbed.run_model.data import RunDescription
from acrc_testbed.run_model.model import RunModel, robot_of, with_instants
from acrc_testbed.view.command import say_at_once
from acrc_testbed.view.run_drawing import RunDrawing
from actors.floor.map_file import load_map
from actors.messages import DRIVE, RECEIVED, Board, Drive, Progress, Received
from actors.observer import viewer, words
from actors.observer.canvas import Canvas
from actors.observer.glyphs import FATES, GREY
from actors.observer.layout import Arrangement, Sheet
from actors.observer.words import DrawnEvent
from actors.processes.launch import scratch_folder
from actors.runtime.core import at
from actors.topic import Message
from deploy.fleet import watch
from deploy.fleet.fleet_file import Fleet

_PERIOD_S: Final = 0.2
"""Between two pictures."""
_SILENT_S: Final = 2.0
"""A robot of which nothing has been heard for so long is said not to be: it has ten steps a second."""
_COUNTED_S: Final = 5.0
"""Radio events are counted over so long."""
_MOST: Final = 20_000
"""Messages that may wait to be drawn: those of ten robots for a minute and a half."""


class HeardMessage(NamedTuple):
    """A message, and when it came."""

    second: float
    endpoint: str
    key: str
    message: Message


class Inbox:
    """Takes messages from the threads that listen, which never wait for whoever draws."""

    def __init__(self) -> None:
        self.missed = 0
        """Messages for which there was no room."""
        self._began = time.monotonic()
        self._waiting: queue.Queue[HeardMessage] = queue.Queue(_MOST)

    @property
    def now(self) -> float:
        """Since it was made, s."""
        return time.monotonic() - self._began

    def take(self, endpoint: str, key: str, message: Message) -> None:
        """Keep one message."""
        try:
            self._waiting.put_nowait(HeardMessage(self.now, endpoint, key, message))
        except queue.Full:
            self.missed += 1

    def all(self) -> list[HeardMessage]:
        """What has come since the last call."""
        return [self._waiting.get_nowait() for _ in range(self._waiting.qsize())]


class WatchedFleet:
    """Draws what has been said, piece by piece."""

    def __init__(self, fleet: Fleet, sheet: Sheet) -> None:
        self.robots = tuple(robot.id for robot in fleet.robots)
        self._model = RunModel(
            RunDescription(
                out=Path(),
                title="a fleet",
                robots=self.robots,
                grid=load_map(fleet.map),
                step_us=0,
                own_places={robot.id: robot.places for robot in fleet.robots},
                addresses={robot.address: robot.id for robot in fleet.robots},
                has_truth=False,
            )
        )
        self._canvas = Canvas(sheet.recording, self.robots)
        self._last: dict[str, float] = {}
        """When each was heard last, s."""
        self._endpoints: dict[str, str] = {}
        """Who is behind an endpoint, as soon as that is known."""
        self._told: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._drawn: set[str] = set()
        self._counted = 0.0
        self._missed = 0
        self._drawing = RunDrawing(self._canvas, self._model.observed(0.0), ())
        for robot in self.robots:
            words.introduce_line(self._canvas, f"plots/ages/{robot}", robot, self._canvas.colour(robot))

    def draw(self, said: Sequence[HeardMessage], now: float, missed: int) -> None:
        """Draw what came until `now`, s; `missed`: messages so far that were lost here."""
        events: list[DrawnEvent] = []
        for one in said:
            robot = robot_of(one.key) or self._endpoints.get(one.endpoint, "")
            if robot in self.robots:
                self._endpoints[one.endpoint] = robot
                self._last[robot] = one.second
            match one.message:
                case Drive() | Received() if robot in self.robots:
                    self._fold(one, robot)
                case Progress():
                    events += self._progress(robot or one.endpoint, one.second, one.message)
                case Board():
                    events += [DrawnEvent(one.second, robot, f"board: {note}") for note in one.message.notes]
        if missed > self._missed:
            lacks = f"the view lacks {missed - self._missed} messages: too many came"
            events.append(DrawnEvent(now, "", lacks, "WARN"))
            self._missed = missed
        self._note_silence(now)
        run = self._model.observed(now)
        self._drawing.recorded(run)
        self._drawing.computed(run)
        self._drawing.tell(events)
        self._plot(now)

    def _fold(self, said: HeardMessage, robot: str) -> None:
        """Fold a robot's message; everything in it counts as of the instant at which it came."""
        if isinstance(said.message, Received):
            self._counts.update(FRAME_OUTCOMES[type(event)] for event in said.message.events)
        instant = round(said.second * 1e6)
        self._model.extend(said.key, with_instants(said.message, lambda _: instant), said.second)

    def _progress(self, who: str, second: float, progress: Progress) -> list[DrawnEvent]:
        """How a robot gets on, where that has changed."""
        told = watch.told(progress)
        if self._told.get(who) == told:
            return []
        self._told[who] = told
        return [DrawnEvent(second, who, told, "WARN" if progress.held else "INFO")]

    def _note_silence(self, now: float) -> None:
        """Note which robots are no longer heard, or again."""
        for robot in self.robots:
            last = self._last.get(robot)
            silent = last is None or now - last > _SILENT_S
            self._model.set_state(robot, self._model.since, "not heard" if silent else "")

    def _plot(self, now: float) -> None:
        """How old each robot's last word is; and what became of frames."""
        for robot, last in self._last.items():
            words.draw_line(self._canvas, f"plots/ages/{robot}", [now], np.array([now - last]))
        if now < self._counted + _COUNTED_S:
            return
        for name in FRAME_OUTCOMES.values():
            path = f"plots/copies/{name}"
            if self._counts[name] and name not in self._drawn:
                self._drawn.add(name)
                colour = FATES["heard"] if name == "copies_heard" else GREY
                words.introduce_line(self._canvas, path, name.replace("_", " "), colour)
            if name in self._drawn:
                rate = self._counts[name] / (now - self._counted)
                words.draw_line(self._canvas, path, [now], np.array([rate]))
        self._counts.clear()
        self._counted = now


def show(endpoints: Sequence[str], keys: Path, fleet: Fleet, seconds: float | None = None) -> None:
    """Show robots in the viewer, and print their words, until interrupted or for so many seconds.

    In a window if there is a display, else in a browser. Raises an AcrcError for endpoints, keys or a map
    that make no sense.
    """
    inbox, lines = Inbox(), queue.SimpleQueue[str]()
    grid = load_map(fleet.map)
    watch.listen(endpoints, keys, lines, more=(at(DRIVE, "*"), at(RECEIVED, "*")), take=inbox.take)
    opened = viewer.open_any(say_at_once, "words are printed only")
    try:
        if opened is not None and opened.page:
            say_at_once(f"to see them, open {opened.page} in a browser on this machine; Ctrl-C ends it")
        with scratch_folder() as folder:
            arranged = Arrangement(grid, [robot.id for robot in fleet.robots], true=False)
            address = None if opened is None else opened.address
            with Sheet(folder / "view.rrd", arranged, name="a fleet", send_to=address) as sheet:
                watched = WatchedFleet(fleet, sheet)
                while seconds is None or inbox.now < seconds:
                    watched.draw(inbox.all(), inbox.now, inbox.missed)
                    while not lines.empty():
                        say_at_once(lines.get())
                    time.sleep(_PERIOD_S)
    finally:
        viewer.end(opened)
