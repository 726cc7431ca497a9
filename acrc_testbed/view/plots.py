"""Plots and event texts of a run for the viewer."""

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from acrc_testbed.run_model.data import RunData, Trajectory, ordered_changes
from acrc_testbed.run_model.frame_outcomes import (
    LOSSES,
    FrameCopies,
    concatenate_copies,
    outcome_name,
    outcome_rates,
)
from acrc_testbed.run_model.task_state import FirstEvents
from actors.array_types import Floats
from actors.instant import in_seconds
from actors.messages import TaskEvent
from actors.observer import panels
from actors.observer.canvas import Canvas
from actors.observer.glyphs import GREY, OUTCOME_COLOURS, WHITE
from actors.observer.panels import DrawnEvent, LaneActivity
from actors.radio.medium.state import Outcome
from actors.runtime.errors import printable


class RunEventTexts:
    """Event texts of a run."""

    def __init__(self) -> None:
        self._first = FirstEvents()
        self._notes: set[str] = set()
        self._initialised: set[str] = set()

    def events(self, run: RunData) -> Iterator[DrawnEvent]:
        """Yield the events of a run, or of its next part."""
        for one in self._first.take(run.task_events):
            words = printable(", ".join(_event_words(one, run.robots)))
            yield DrawnEvent(in_seconds(one.instant), one.robot, words)
        for event in run.given_up:
            yield DrawnEvent(event.second, event.robot, f"gives up {printable(str(event.key))}", "ERROR")
        for event in run.taken_over:
            yield DrawnEvent(event.second, event.robot, f"adopts {printable(str(event.key))}", "WARN")
        for robot, track in run.trajectories.items():
            for second, state in track.states:
                if state or robot in self._initialised:
                    yield DrawnEvent(second, robot, f"is {state}" if state else "is active again", "WARN")
                self._initialised.add(robot)
        for change in ordered_changes(run):
            yield DrawnEvent(change.second, change.robot, change.words, "WARN")
        for note in run.notes:
            if note not in self._notes:
                self._notes.add(note)
                yield DrawnEvent(run.since, "", note, "WARN")


def _event_words(event: TaskEvent, robots: Sequence[str]) -> Iterator[str]:
    """Yield the parts of a description such as "delivers r1/3, adopted from r1"."""
    kind = event.kind or "goes on"
    yield kind if event.key is None else f"{kind} {event.key}"
    if event.owner in robots and event.owner != event.robot:
        yield f"adopted from {event.owner}"
    if event.text:
        yield event.text


_PLOT_S: Final = 0.5
"""Interval between points of a plot, s."""
_BIN_S: Final = 5.0
"""Length of a bin of copies, s."""
_NEVER: Final = -1e9
_SPREAD: Final = {"mean_per_robot": WHITE, "percentile_10": GREY, "percentile_90": GREY}
"""Lines of items done if there are too many robots for one line each."""


class Plots:
    """Plots of a run, drawn part by part."""

    def __init__(self, canvas: Canvas, *, true: bool, batteries: bool) -> None:
        """Set up the lines; `true`: the run has ground truth, `batteries`: it simulates batteries."""
        self._canvas, self._true, self._batteries = canvas, true, batteries
        self._done = dict.fromkeys(canvas.robots, 0)
        self._first = FirstEvents()
        self._last: dict[str, tuple[float, float, float]] = {}
        """Last point of each robot's plots: time, s, and position, m."""
        self._pairs: set[int] = set()
        self._copies: list[FrameCopies] = []
        self._bins = 0
        """Number of drawn bins of copies."""
        self._counted: set[Outcome] = set()
        self._many = not canvas.is_small_swarm
        lines = _SPREAD if self._many else {robot: canvas.colour(robot) for robot in canvas.robots}
        for name, colour in lines.items():
            panels.set_line_style(canvas, f"plots/items/{name}", name.replace("_", " "), colour, steps=True)
        for robot in canvas.robots:
            for name in ("speed", *["error"] * true, *["charge"] * batteries):
                panels.set_line_style(canvas, f"plots/{name}/{robot}", robot, canvas.colour(robot))

    def extend(self, run: RunData) -> None:
        """Draw a run or its next part."""
        new = self._first.take(run.task_events)
        first = [one for one in new if one.kind == run.description.task.done]
        seconds = [max(run.since, in_seconds(one.instant)) for one in first]
        ends = [run.since, *seconds, max([run.end, *seconds])]
        rows = [list(self._done.values())]
        for event in first:
            self._done[event.robot] += 1
            rows.append(list(self._done.values()))
        counts = np.array([*rows, rows[-1]], np.float64)
        lines = _spread_lines(counts) if self._many else dict(zip(self._done, counts.T, strict=True))
        for name, values in lines.items():
            panels.draw_line(self._canvas, f"plots/items/{name}", ends, values)
        for robot, track in run.trajectories.items():
            self._draw_motion(robot, track)
        if self._batteries:
            self._draw_charges(run)
        self._draw_rssi(run.heard)

    def _draw_motion(self, robot: str, track: Trajectory) -> None:
        """Draw speed and localisation error twice a second."""
        rows, due = [], self._last.get(robot, (_NEVER,))[0] + _PLOT_S
        for row, second in enumerate(track.seconds.tolist()):
            if second >= due - 1e-6:
                rows.append(row)
                due = second + _PLOT_S
        if not rows:
            return
        seconds, poses, estimates = track.seconds[rows], track.poses[rows], track.estimated[rows]
        points = np.column_stack((seconds, poses[:, :2]))
        known = np.concatenate((np.array([self._last.get(robot, points[0])]), points))
        self._last[robot] = tuple(points[-1].tolist())
        steps = np.diff(known, axis=0)
        speeds = np.hypot(steps[:, 1], steps[:, 2]) / np.maximum(steps[:, 0], 1e-6)
        lines = {"speed": speeds}
        if self._true:
            lines["error"] = np.hypot(*(poses[:, :2] - estimates[:, :2]).T)
        for name, values in lines.items():
            valid = np.isfinite(values)
            panels.draw_line(self._canvas, f"plots/{name}/{robot}", seconds[valid], values[valid])

    def _draw_charges(self, run: RunData) -> None:
        """Draw the charge of each battery once a second."""
        rows = run.seconds % 1.0 < run.duration(1) - 1e-6
        for robot, charges in zip(run.robots, run.charge[rows].T, strict=True):
            known = np.isfinite(charges)
            path = f"plots/charge/{robot}"
            panels.draw_line(self._canvas, path, run.seconds[rows][known], charges[known])

    def _draw_rssi(self, received: Floats) -> None:
        """Draw the RSSI of each link in the sender's colour; with many robots one line per sender."""
        canvas, names = self._canvas, self._canvas.robots
        pairs = received[:, 1] if self._many else received[:, 1] * len(names) + received[:, 2]
        for pair in np.unique(pairs).tolist():
            frames = received[pairs == pair]
            sender = names[int(frames[0, 1])]
            receiver = "all" if self._many else names[int(frames[0, 2])]
            path = f"plots/rssi/{sender}_at_{receiver}"
            if pair not in self._pairs:
                self._pairs.add(pair)
                panels.set_line_style(
                    canvas, path, f"{sender} at {receiver}", canvas.colour(sender), dots=True
                )
            panels.draw_line(canvas, path, frames[:, 0], frames[:, 3])

    def add_copies(self, copies: FrameCopies, until: float, *, last: bool) -> None:
        """Count copies up to an instant, s; `last`: the run ends there, within a bin."""
        self._copies.append(copies)
        begin = self._bins * _BIN_S
        bins = max(0, int(np.ceil((until - begin) / _BIN_S) if last else (until - begin) // _BIN_S))
        if not bins:
            return
        waiting = concatenate_copies(self._copies)
        now = waiting.seconds < (np.inf if last else begin + bins * _BIN_S)
        self._copies = [waiting.select(~now)]
        table = outcome_rates(waiting.select(now), begin, bins, _BIN_S)
        middles = np.minimum(begin + (np.arange(bins) + 0.5) * _BIN_S, until)
        for outcome in (Outcome.HEARD, *LOSSES):
            if table[:, outcome].any() or outcome in self._counted:
                self._draw_counts(outcome, middles, table[:, outcome])
        self._bins += bins

    def _draw_counts(self, outcome: Outcome, middles: Floats, counts: Floats) -> None:
        name = outcome_name(outcome)
        path = f"plots/copies/{name.replace(' ', '_')}"
        if outcome not in self._counted:
            self._counted.add(outcome)
            panels.set_line_style(self._canvas, path, name, OUTCOME_COLOURS[name])
            earlier = [(bin_ + 0.5) * _BIN_S for bin_ in range(self._bins)]
            panels.draw_line(self._canvas, path, earlier, np.zeros(self._bins))
        panels.draw_line(self._canvas, path, middles, counts)


def _spread_lines(counts: Floats) -> dict[str, Floats]:
    """Return mean and percentiles, (n,) each, of items done, (n, robots)."""
    low, high = np.percentile(counts, [10, 90], axis=1)
    return dict(zip(_SPREAD, (counts.mean(axis=1), low, high), strict=True))


class PositionHistory:
    """Positions of one robot over time."""

    def __init__(self) -> None:
        self._points: Floats = np.zeros((0, 3))

    def extend(self, seconds: Floats, poses: Floats) -> None:
        """Add times, (n,), s, later than all before, and x, y, m, (n, 2 or more), without NaN."""
        known = np.isfinite(poses[:, 0])
        self._points = np.concatenate((self._points, np.column_stack((seconds, poses[:, :2]))[known]))

    def at(self, seconds: Floats) -> Floats:
        """Return positions, (n, 2), m, interpolated linearly; NaN without any point."""
        if not len(self._points):
            return np.full((len(seconds), 2), np.nan)
        times, x, y = self._points.T
        return np.column_stack([np.interp(seconds, times, axis) for axis in (x, y)])


class RobotLane:
    """Lane of a robot: its own activities, overridden by states that it cannot observe."""

    def __init__(self, canvas: Canvas, robot: str) -> None:
        self._lane = panels.Lane(canvas, robot)
        self._back: list[float] = []
        """Times when it became active again, s, not drawn yet."""
        self._last: list[LaneActivity] = []
        self.deadlocks: Sequence[tuple[float, float]] = ()
        """Intervals of deadlocks, s."""

    def end(self, second: float) -> None:
        """End the lane at an instant, s."""
        self._lane.end(second)

    def draw_states(self, states: Sequence[tuple[float, str]]) -> None:
        """Draw changes of state: time, s, and "" (active), frozen or off."""
        self._lane.draw([LaneActivity(second, state) for second, state in states if state])
        self._back += [second for second, state in states if not state]

    def draw_activities(self, activities: Sequence[LaneActivity], until: float) -> None:
        """Draw the robot's own activities until an instant, s."""
        known = [*self._last, *activities]
        back = []
        for second in [one for one in self._back if one <= until]:
            self._back.remove(second)
            before = [one for one in known if one.second <= second]
            back += [before[-1]._replace(second=second)] if before else []
        self._last = known[-1:]
        if activities or back:
            self._lane.draw(panels.drop_short(with_deadlocks(sorted((*activities, *back)), self.deadlocks)))


def with_deadlocks(
    own: Sequence[LaneActivity], deadlocks: Sequence[tuple[float, float]]
) -> list[LaneActivity]:
    """Return the robot's activities in order, overridden by deadlocks."""
    for begin, end in deadlocks:
        before = [one for one in own if one.second <= begin]
        inside = [one for one in own if begin < one.second <= end]
        after = [one for one in own if one.second > end]
        last = (inside or before)[-1:]
        going = [one for one in before if one.second < begin]
        own = [*going, LaneActivity(begin, "deadlock"), *(one._replace(second=end) for one in last), *after]
    return list(own)
