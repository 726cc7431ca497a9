"""Follows a run from now to its end, for `acrc view` and for `acrc run --view`."""

import sys
import time
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

import numpy as np

from acrc_testbed.accounting.episodes import STANDARD
from acrc_testbed.recordings.topics import Standing, standing
from acrc_testbed.replay.run_recordings import recordings
from acrc_testbed.run_model.data import Route, RunData, Trajectory
from acrc_testbed.run_model.introspection import RecordedProcess
from acrc_testbed.run_model.recorded import NO_FRAMES
from acrc_testbed.run_model.simulated import RunReader
from acrc_testbed.trace.following import Followed
from acrc_testbed.trace.perception import PERIOD
from acrc_testbed.trace.traces import Traced
from acrc_testbed.view.drawn import Say
from acrc_testbed.view.painting import Painting, looked_into
from actors.instant import in_seconds
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.layout import Arrangement, Sheet
from actors.observer.drawing.words import DrawnEvent, Occupation
from actors.observer.viewer import OpenViewer
from actors.processes.signals import Interrupted
from actors.robot.behaviour.foreign import Permit
from actors.runtime.recording import read_notes


class Seen:
    """One robot, piece by piece. It stands as the accounting has it, which is known only `pause_s` later."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._state = ""
        self._holds = True
        """There are places that it means to visit."""
        self._lately: deque[tuple[float, float, float]] = deque()
        """When, s, and where, m, it was seen in the last `pause_s`, while it acted."""
        self._acts = True
        """False: it is frozen or off, which others tell."""

    def of(self, track: Trajectory, routes: Iterable[Route]) -> Iterator[Occupation]:
        """What it seems to be about, wherever that becomes another thing."""
        for route in routes:
            if route.robot == self._robot:
                self._holds = bool(route.places)
        acts = deque(track.states)
        for second, (x, y, _) in zip(track.seconds.tolist(), track.poses.tolist(), strict=True):
            while acts and acts[0][0] <= second:
                self._acts, self._state = not acts.popleft()[1], ""
                self._lately.clear()
            if not self._acts or np.isnan(x):
                continue
            begin, stays = self._stays(second, x, y)
            state = "driving" if not stays else "standing" if self._holds else "idle"
            if state != self._state:
                self._state = state
                yield Occupation(begin if stays else second, state)

    def _stays(self, second: float, x: float, y: float) -> tuple[float, bool]:
        """Since when it is looked at, s, and whether it has stayed where it was then, for `pause_s`."""
        lately = self._lately
        lately.append((second, x, y))
        while len(lately) > 1 and second - lately[1][0] >= STANDARD.pause_s:
            lately.popleft()
        begin, *there = lately[0]
        near = all(np.hypot(one - there[0], other - there[1]) <= STANDARD.still for _, one, other in lately)
        return begin, near and second - begin >= STANDARD.pause_s


_LATE_S: Final = 10.0
"""What is computed may lie so far behind what is recorded, s; then the events say so."""
_STANDING_S: Final = 5.0
"""Between two looks at that, s of the clock on the wall."""


@dataclass(frozen=True)
class Lack:
    """What a view has not got of its run."""

    steps: int
    """That were recorded, and are not drawn."""
    computed: tuple[tuple[str, float], ...]
    """By what was to be computed, in words, until when it is drawn, s, where that is not the end."""

    def sentences(self, end: float) -> Iterator[str]:
        """For a person; `end`: until when the run is drawn, s."""
        if self.steps:
            yield f"the view ends at {end:g} s: {self.steps} steps that were recorded later are not in it"
        for what, until in self.computed:
            yield f"the view lacks {what} from {until:.1f} s on"


class Following:
    """One run that goes on, on one sheet; a context manager that ends what computes, and closes files."""

    def __init__(self, out: Path, robots: Sequence[str], *, permit: Permit, isolate: bool) -> None:
        """`robots`: to look into; as `looked_into` has it. AcrcError where no run has begun."""
        self.run = RunReader(out)
        self._detailed = looked_into(self.run.robots, robots)
        self._stack = ExitStack()
        self._followed = Followed(out, permit=permit, isolate=isolate)
        self._painting: Painting | None = None
        self._sheet: Sheet | None = None
        self._sources: dict[str, RecordedProcess] = {}
        """By actor, of the robots that are looked into."""
        self._waiting: list[Traced] = []
        """Told, but of what is not recorded wholly yet."""
        self._inside_s: dict[str, float] = {}
        """By actor, until when it is drawn."""
        self._met_s = 0.0
        """Until when it is drawn who has learnt from whom, s."""
        self._outside: dict[str, Seen] = {}
        """Robots that are not looked into."""
        self._late: dict[str, float] = {}
        """What the events have said to be late, and by how much, s."""
        self._look = time.monotonic() + _STANDING_S
        """When it is looked for what is late again."""
        self.end = 0.0
        """Until when the run is drawn, s."""

    def __enter__(self) -> Self:
        self._stack.enter_context(self.run)
        self._stack.enter_context(self._followed)
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def arrangement(self) -> Arrangement:
        """What the window is to show."""
        return Arrangement(self.run.description.grid, self.run.robots, self._detailed)

    def begin(self, sheet: Sheet) -> None:
        """Draw on this sheet from now on."""
        self._sheet = sheet
        canvas = Canvas(sheet.recording, self.run.robots)
        self._painting = Painting(canvas, self.run.beginning(), self._detailed)

    def draw(self, *, last: bool = False) -> bool:
        """Draw what is new; True if there was anything. `last`: no step will follow.

        Raises RecordingError and RunDataError for damaged recordings.
        """
        piece = self.run.poll(last=last)
        if piece is not None:
            self._recorded(piece, last=last)
        drawn = [piece is not None, self._perceived()]
        if any(drawn):
            self._ensembles()
        self._tell_late()
        return any(drawn)

    def finish(self) -> None:
        """The run is over: lanes end."""
        assert self._painting is not None
        self._painting.end(self.end)

    @property
    def complete(self) -> bool:
        """All that was recorded and can be computed is drawn."""
        return not self.run.behind and not any(True for _ in self._behind())

    def lack(self) -> Lack:
        """What is not drawn of what has been recorded by now."""
        return Lack(self.run.unread(), tuple(self._behind()))

    def _recorded(self, piece: RunData, *, last: bool) -> None:
        assert self._painting is not None
        self.end = piece.end
        self._painting.recorded(piece)
        if piece.description.records_frames:
            self._painting.copies(piece.copies, piece.end, last=last)
        elif not piece.since:
            self._say(0.0, "", NO_FRAMES)
        for source in piece.processes:
            if source.robot not in self._detailed:
                self._outside.setdefault(source.robot, Seen(source.robot))
            elif source.actor not in self._sources:
                self._sources[source.actor] = source
                self._inside_s[source.actor] = 0.0
                self._waiting += self._followed.follow([source.actor])
        for robot, seen in self._outside.items():
            self._painting.outside(robot, list(seen.of(piece.trajectories[robot], piece.routes)), piece.end)

    def _perceived(self) -> bool:
        """What robots perceived and meant; True if there is anything new."""
        assert self._painting is not None
        told, self._waiting = [*self._waiting, *self._followed.poll()], []
        for traced in told:
            source, parts = self._sources[traced.actor], traced.parts
            if fault := traced.fault or (parts and parts[-1].fault):
                self._say(self._inside_s[traced.actor], source.robot, fault.removeprefix(f"{source.robot}: "))
                self._outside.setdefault(source.robot, Seen(source.robot))
            for part in (one for one in parts if len(one.instants)):
                until = float(source.clock(part.instants[-1:])[0])
                if until > self.end and self.run.behind:
                    self._waiting.append(Traced(traced.actor, (part,)))
                    continue
                self._painting.inside(source, part)
                self._inside_s[traced.actor] = until
        return bool(told)

    def _ensembles(self) -> None:
        assert self._painting is not None
        going = [self._inside_s[actor] for actor in self._followed.going if actor in self._inside_s]
        self._painting.ensembles(self._met_s)
        self._met_s = min(going, default=self.end)

    def _behind(self) -> Iterator[tuple[str, float]]:
        """What is computed and not drawn to its end: what, in words, and until when it is, s."""
        step_s = in_seconds(self.run.description.step_us)
        for actor in self._followed.going:
            until = self._inside_s.get(actor, 0.0)
            if until + in_seconds(PERIOD) + step_s < min(self.end, self.run.recorded_s(actor)):
                yield f"what {actor} perceived and meant", until

    def _tell_late(self) -> None:
        """Say in the events what has fallen behind, and again where it is twice as far."""
        if time.monotonic() < self._look:
            return
        self._look = time.monotonic() + _STANDING_S
        for what, until in self._behind():
            late = self.end - until
            if late > max(_LATE_S, 2 * self._late.get(what, 0.0)):
                self._late[what] = late
                self._say(self.end, "", f"{what} is drawn up to {until:.0f} s: it follows")

    def _say(self, second: float, robot: str, words: str) -> None:
        assert self._painting is not None
        self._painting.tell([DrawnEvent(second, robot, words, "WARN")])


_POLL_S: Final = 0.1
_LOOK_S: Final = 1.0
"""Between two looks at whether the run goes on, and whether the viewer keeps up, s."""
_STUCK_S: Final = 120.0
"""What is replayed has to come on within so long, s, or it is not waited for: a strategy may hang."""
_SETTLING_S: Final = 0.5
"""So long recordings may still grow when world and radio have closed theirs, s."""


def follow(
    out: Path,
    path: Path,
    robots: Sequence[str],
    opened: OpenViewer | None,
    say: Say,
    *,
    permit: Permit,
    isolate: bool,
) -> None:
    """Draw a run that goes on into `path` and to a viewer, until it has ended and all is drawn.

    Or until the viewer's window is closed. However it comes to its end, what the view lacks is told.
    `robots`: to look into; `trust`: execute their code, whoever wrote it; `isolate`: shut it off.
    AcrcError where the folder holds no run, a damaged one, or `path` cannot be written.
    """
    while standing(out) is Standing.GOING_ON and not _begun(out):
        time.sleep(_POLL_S)
    with Following(out, robots, permit=permit, isolate=isolate) as following:
        address = None if opened is None else opened.address
        with Sheet(path, following.arrangement, name="a run that goes on", send_to=address) as sheet:
            try:
                following.begin(sheet)
                _draw_all(out, following, sheet, opened, say)
            finally:
                if not isinstance(sys.exception(), Interrupted):  # then nothing stays of the view
                    for sentence in following.lack().sentences(following.end):
                        say(sentence)


def _begun(out: Path) -> bool:
    """True once world and radio have said what they are."""
    files = recordings(out)
    return all(actor in files and "run" in read_notes(files[actor]) for actor in ("world", "radio"))


def _draw_all(out: Path, following: Following, sheet: Sheet, opened: OpenViewer | None, say: Say) -> None:
    look, how = time.monotonic(), Standing.GOING_ON
    while how is Standing.GOING_ON:
        if not following.draw():
            time.sleep(_POLL_S)
        if time.monotonic() > look + _LOOK_S:
            if opened is not None and opened.process.poll() is not None:
                say("the viewer was closed before the run's end")
                return
            sheet.flush()
            look, how = time.monotonic(), standing(out)
    if how is Standing.DIED:
        say("the run has died: its processes are gone, and there is no result")
    settled = time.monotonic() + _SETTLING_S
    while time.monotonic() < settled and following.draw():
        time.sleep(_POLL_S)
    following.draw(last=True)
    _draw_rest(following)
    following.finish()


def _draw_rest(following: Following) -> None:
    """What is computed later than it was recorded, as long as that comes on."""
    moved = time.monotonic()
    while not following.complete and time.monotonic() < moved + _STUCK_S:
        if following.draw(last=True):
            moved = time.monotonic()
        else:
            time.sleep(_POLL_S)
