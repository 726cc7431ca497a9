"""What one robot perceived, planned and knew, drawn into the viewer as it is computed."""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from actors.observer.drawing import places, words
from actors.observer.drawing.canvas import Canvas
from actors.observer.drawing.words import LearntExchange, Occupation
from observation.trace.rows import Doing, Trace
from observation.view.plots import InnerHappenings, at
from observation.view.story import Clock, Floats, Source

_FIRST: Final = 64
"""Points that there is room for at first; then twice as many, and so on."""


class Way:
    """One robot's way."""

    def __init__(self) -> None:
        self._points: Floats = np.zeros((_FIRST, 3))
        self._count = 0

    def extend(self, seconds: Floats, poses: Floats) -> None:
        """Go on: (n,) s, later than all before, and (n, 2 or more): x and y, m; what is NaN is left out."""
        known = np.isfinite(poses[:, 0])
        new = np.column_stack((seconds[known], poses[known, :2]))
        while self._count + len(new) > len(self._points):
            self._points = np.concatenate((self._points, np.zeros_like(self._points)))
        self._points[self._count : self._count + len(new)] = new
        self._count += len(new)

    def at(self, seconds: Floats) -> Floats:
        """(n, 2) m, between two known points in proportion; NaN where none is known."""
        known = self._points[: self._count]
        if not self._count:
            return np.full((len(seconds), 2), np.nan)
        return np.column_stack([np.interp(seconds, known[:, 0], known[:, axis]) for axis in (1, 2)])


_LINE_S: Final = 0.5
"""Between two lines to a destination."""
_AGE_S: Final = 1.0
"""Between two points of the plot of replicas' ages."""


class RobotLane:
    """The lane of a robot, which itself does not know when it was frozen or off."""

    def __init__(self, canvas: Canvas, robot: str) -> None:
        self._lane = words.Lane(canvas, robot)
        self._back: list[float] = []
        """When it acted again, s, as far as nothing is drawn from then on."""
        self._last: Occupation | None = None
        self._deadlocks: Sequence[tuple[float, float]] = ()

    def deadlocks(self, spells: Sequence[tuple[float, float]]) -> None:
        """When it was in one, s, which it does not know itself."""
        self._deadlocks = spells

    def end(self, second: float) -> None:
        """Draw nothing from an instant on."""
        self._lane.end(second)

    def act(self, acts: Sequence[tuple[float, str]]) -> None:
        """From when on it acts (""), is frozen, or off."""
        self._lane.draw([Occupation(second, state) for second, state in acts if state])
        self._back += [second for second, state in acts if not state]

    def do(self, spells: Sequence[Occupation], until: float) -> None:
        """What it has been about by its own account, until an instant, s."""
        known = [*([] if self._last is None else [self._last]), *spells]
        back = []
        for second in [one for one in self._back if one <= until]:
            self._back.remove(second)
            before = [spell for spell in known if spell.second <= second]
            back += [before[-1]._replace(second=second)] if before else []
        self._last = known[-1] if known else None
        if spells or back:
            self._lane.draw(words.settled(over(sorted((*spells, *back)), self._deadlocks)))


def over(own: Sequence[Occupation], deadlocks: Sequence[tuple[float, float]]) -> list[Occupation]:
    """Its own account, in order, but for where ground truth has a deadlock."""
    for begin, end in deadlocks:
        before = [one for one in own if one.second <= begin]
        inside = [one for one in own if begin < one.second <= end]
        after = [one for one in own if one.second > end]
        last = (inside or before)[-1:]
        going = [one for one in before if one.second < begin]
        own = [*going, Occupation(begin, "deadlock"), *(one._replace(second=end) for one in last), *after]
    return list(own)


class DrawnParts(NamedTuple):
    """What is drawn of a robot beside what it does and knows."""

    detailed: bool
    """All that it perceives."""
    goals: bool
    """Where it heads for."""


class PaintedInside:
    """One process of a robot."""

    def __init__(self, canvas: Canvas, source: Source, way: Way, lane: RobotLane, shown: DrawnParts) -> None:
        self._canvas, self._source, self._way, self._lane = canvas, source, way, lane
        self._shown = shown
        self._happenings = InnerHappenings(source)
        self._doing: Doing | None = None
        self._line_due: float | None = None
        self._met: dict[str, tuple[float, float]] = {}
        """By peer: when the plot of its age goes on, and when it was heard last, s."""
        if shown.detailed:
            words.introduce_inside(canvas, source.robot)

    def draw(self, inside: Trace, end: float | None = None) -> Iterator[LearntExchange]:
        """Draw what is new; what it has learnt from others. `end`: of the run, s, if nothing will follow."""
        canvas, robot, clock = self._canvas, self._source.robot, self._source.clock
        if self._shown.detailed:
            _draw(canvas, robot, clock, inside)
            self._ages(inside, end)
        until = at(clock, int(inside.instants[-1])) if len(inside.instants) else 0.0
        spells = [Occupation(at(clock, one.instant), one.activity, one.destination) for one in inside.doings]
        self._lane.do(spells, until if end is None else max(until, end))
        tables = [(at(clock, one.instant), one.rows) for one in inside.knowledge]
        words.draw_knowledge(canvas, robot, tables)
        if self._shown.goals:
            self._intents(inside, until)
        words.draw_events(canvas, "inside", list(self._happenings.of(inside)))
        for one, _ in inside.decisions():
            if one.peer:
                yield LearntExchange(at(clock, one.instant), one.by.partition(".")[0], one.peer, robot)

    def _intents(self, inside: Trace, until: float) -> None:
        """Where the robot heads for, twice a second."""
        doings = [*([] if self._doing is None else [self._doing]), *inside.doings]
        if not doings:
            return
        begins = self._source.clock(np.array([one.instant for one in doings], np.int64))
        points = np.array([one.point or (np.nan, np.nan) for one in doings], np.float64)
        first = begins[0] if self._line_due is None else self._line_due
        lines = np.arange(first, until, _LINE_S)
        self._line_due = float(first + len(lines) * _LINE_S)
        self._doing = doings[-1]
        seconds = np.union1d(lines, begins if len(doings) == len(inside.doings) else begins[1:])
        if not len(seconds):
            return
        there = points[np.maximum(np.searchsorted(begins, seconds, side="right") - 1, 0)]
        places.draw_intents(self._canvas, self._source.robot, seconds, self._way.at(seconds), there)

    def _ages(self, inside: Trace, end: float | None) -> None:
        """How old what it knows of each other robot is."""
        canvas, robot, clock = self._canvas, self._source.robot, self._source.clock
        until = at(clock, int(inside.instants[-1])) if len(inside.instants) else 0.0
        until = until if end is None else end
        for peer in dict.fromkeys((*self._met, *(one.peer for one in inside.contacts))):
            mine = [one for one in inside.contacts if one.peer == peer]
            begins = clock(np.array([one.instant for one in mine], np.int64))
            heard = clock(np.array([one.heard or 0 for one in mine], np.int64))
            heard[[one.heard is None for one in mine]] = np.nan
            path = f"plots/ages/{peer}_at_{robot}"
            if peer not in self._met:
                words.introduce_line(canvas, path, f"{peer} at {robot}", canvas.colour(peer))
                self._met[peer] = float(begins[0]), np.nan
            due, last = self._met[peer]
            begins, heard = np.concatenate(([-np.inf], begins)), np.concatenate(([last], heard))
            seconds = np.arange(due, until, _AGE_S)
            ages = seconds - heard[np.searchsorted(begins, seconds, side="right") - 1]
            known = np.isfinite(ages)
            words.draw_line(canvas, path, seconds[known], ages[known])
            self._met[peer] = due + len(seconds) * _AGE_S, float(heard[-1])


def _draw(canvas: Canvas, robot: str, clock: Clock, inside: Trace) -> None:
    """Scan, particles, estimate, costs, plan and arc."""
    seconds: Floats = clock(inside.instants)
    words.draw_clouds(canvas, robot, "scan", seconds, inside.scans.counts, inside.scans.values)
    when = clock(inside.particles_at)
    words.draw_clouds(canvas, robot, "particles", when, inside.particles.counts, inside.particles.values)
    words.draw_estimates(canvas, robot, seconds, inside.estimates, inside.covariances)
    words.draw_arcs(canvas, robot, seconds, inside.estimates, inside.twists)
    words.draw_plans(canvas, robot, clock(inside.plans_at), inside.plans.rows())
    costs = clock(inside.costs_at)
    words.draw_costs(canvas, robot, costs, inside.costs, inside.corners, inside.cell)
