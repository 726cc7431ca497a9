"""Draws a story: what was recorded at once, then what was computed, as it comes."""

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.observer.colours import FATES
from actors.observer.drawing import floor, insides, layout, places, radio, robots, words
from actors.observer.drawing.canvas import FEW, Canvas
from actors.observer.drawing.words import Event, Exchange, Spell
from actors.radio.medium.state import Outcome
from actors.task.words import PlaceKey
from deploy.evidence.run_evidence import Deed
from deploy.explanation.explain import Explanation
from deploy.inside.fates import LOSSES, Fates, by_outcome
from deploy.inside.telemetry import Inside
from deploy.view.place_history import draw_place_history
from deploy.view.story import Clock, Floats, Source, Story, Track

DETAILED: Final = 8
"""Of so many robots everything is drawn; of the others what they do, know and want: a file of fifty robots'
scans and particles would have gigabytes."""
_PLOT_S: Final = 0.5
"""Between two points of a plot."""
_BIN_S: Final = 5.0
"""Copies are counted over so long."""
_LASTING: Final = 10.0
"""So long an exchange shows in the graph of ensembles."""
_LINE_S: Final = 0.5
"""Between two lines to a destination."""


class Painting:
    """One story on one canvas."""

    def __init__(self, canvas: Canvas, story: Story, detailed: Sequence[str]) -> None:
        """`detailed`: the robots of which everything is drawn."""
        self._canvas, self._story, self._detailed = canvas, story, frozenset(detailed)
        self._exchanges: list[Exchange] = []

    def recorded(self) -> None:
        """What was recorded: floor, robots, trails, places, links, plots, events."""
        canvas, story = self._canvas, self._story
        floor.draw_floor(canvas, story.grid)
        for robot, track in story.tracks.items():
            robots.introduce(canvas, robot)
            places.introduce_intent(canvas, robot)
            known = np.isfinite(track.poses[:, 0])
            seconds, poses = track.seconds[known], track.poses[known]
            robots.draw_poses(canvas, robot, seconds, poses)
            robots.draw_trail(canvas, robot, seconds, poses[:, :2])
            for second, state in track.acts:
                robots.draw_name(canvas, robot, second, state)
        draw_place_history(canvas, story)
        self._links()
        self._plots()
        words.draw_events(canvas, "recorded", list(_events(story)))
        self._adoptions()

    def fates(self, fates: Fates) -> None:
        """What became of frames: rings where copies are lost, and how many there were of each fate."""
        canvas, story = self._canvas, self._story
        radio_s = radio.period(canvas)
        seconds = _every(radio_s, story.end)
        rows = zip(fates.seconds.tolist(), fates.receivers.tolist(), fates.outcomes.tolist(), strict=True)
        lost = [(second, who, _fate(Outcome(what))) for second, who, what in rows if Outcome(what) in LOSSES]
        radio.draw_losses(canvas, seconds, self._positions(seconds), lost)
        table = by_outcome(fates, story.end, _BIN_S)
        middles = np.minimum((np.arange(len(table)) + 0.5) * _BIN_S, story.end)
        for outcome in (Outcome.HEARD, *LOSSES):
            if table[:, outcome].any():
                name = _fate(outcome)
                path = f"plots/copies/{name.replace(' ', '_')}"
                words.introduce_line(canvas, path, name, FATES[name])
                words.draw_line(canvas, path, middles, table[:, outcome])

    def inside(self, source: Source, inside: Inside) -> None:
        """What a robot perceived, meant and knew."""
        canvas, robot, clock = self._canvas, source.robot, source.clock
        if robot in self._detailed:
            _draw_inside(canvas, robot, clock, inside)
        spells = [Spell(_at(clock, one.instant), one.activity, one.destination) for one in inside.doings]
        words.draw_lane(canvas, robot, _with_absence(spells, self._story.tracks[robot]))
        tables = [(_at(clock, one.instant), one.rows) for one in inside.knowledge]
        words.draw_knowledge(canvas, robot, tables)
        self._intent(source, inside)
        self._ages(source, inside)
        words.draw_events(canvas, "inside", list(_inner_events(source, inside)))
        self._exchanges += [
            Exchange(_at(clock, one.instant), one.by.partition(".")[0], one.source, robot)
            for one in inside.learnt
            if one.source != robot
        ]

    def outside(self, source: Source, spells: Sequence[Spell], fault: str) -> None:
        """What is known of a robot that could not be looked into, and why it could not."""
        words.draw_lane(self._canvas, source.robot, spells)
        words.draw_events(self._canvas, "fault", [Event(0.0, source.robot, fault, "WARN")])

    def reasons(self, robot: str, explanations: Sequence[Explanation]) -> None:
        """Why it decided what it did: each decision's causes, until the next one."""
        told = [
            (second, [(link.at_s, link.depth, link.says) for one in made for link in one.chain])
            for second, made in groupby(explanations, lambda one: one.at_s)
        ]
        words.draw_reasons(self._canvas, robot, told)

    def ensembles(self) -> None:
        """Who has learnt from whom."""
        words.draw_ensembles(self._canvas, self._exchanges, _LASTING)

    def _links(self) -> None:
        canvas, story = self._canvas, self._story
        radio.introduce_radio(canvas)
        seconds = _every(radio.period(canvas), story.end)
        radio.draw_links(canvas, seconds, self._positions(seconds), story.heard)

    def _positions(self, seconds: Floats) -> Floats:
        """(n, robots, 2): where robots are, m."""
        return np.stack([_where(track, seconds) for track in self._story.tracks.values()], axis=1)

    def _plots(self) -> None:
        canvas, story = self._canvas, self._story
        for robot, track in story.tracks.items():
            colour = canvas.colour(robot)
            mine = sorted(deed.second for deed in _first(story.reported) if deed.robot == robot)
            words.introduce_line(canvas, f"plots/places/{robot}", robot, colour, steps=True)
            counts = np.array([*range(len(mine) + 1), len(mine)], np.float64)
            words.draw_line(canvas, f"plots/places/{robot}", [0.0, *mine, story.end], counts)
            every = slice(None, None, max(1, round(_PLOT_S / _spacing(track))))
            seconds, poses, held = track.seconds[every], track.poses[every], track.held[every]
            lines = {"speed": _speeds(seconds, poses)}
            if story.true:
                lines["error"] = np.hypot(*(poses[:, :2] - held[:, :2]).T)
            for name, values in lines.items():
                known = np.isfinite(values)
                words.introduce_line(canvas, f"plots/{name}/{robot}", robot, colour)
                words.draw_line(canvas, f"plots/{name}/{robot}", seconds[known], values[known])
        self._strengths()

    def _strengths(self) -> None:
        """RSSI of each link, by its sender's colour; of many robots the strongest copy heard of each."""
        canvas, heard, names = self._canvas, self._story.heard, self._story.robots
        pairs = heard[:, 1] if len(names) > FEW else heard[:, 1] * len(names) + heard[:, 2]
        for pair in np.unique(pairs).tolist():
            mine = heard[pairs == pair]
            sender = names[int(mine[0, 1])]
            receiver = "" if len(names) > FEW else names[int(mine[0, 2])]
            path = f"plots/rssi/{sender}_at_{receiver or 'all'}"
            words.introduce_line(
                canvas, path, f"{sender} at {receiver or 'all'}", canvas.colour(sender), dots=True
            )
            words.draw_line(canvas, path, mine[:, 0], mine[:, 3])

    def _adoptions(self) -> None:
        story = self._story
        for deed in story.taken_over:
            if deed.place.place < len(story.places.get(deed.place.owner, ())):
                point = story.places[deed.place.owner][deed.place.place]
                x, y = _where(story.tracks[deed.robot], np.array([deed.second]))[0].tolist()
                name = f"{deed.place.owner}/{deed.place.place}"
                places.draw_adoption(self._canvas, deed.robot, deed.second, (x, y), point, name)

    def _intent(self, source: Source, inside: Inside) -> None:
        """Where the robot heads for, several times a second."""
        if not inside.doings:
            return
        begins = source.clock(np.array([one.instant for one in inside.doings], np.int64))
        points = np.array([one.point or (np.nan, np.nan) for one in inside.doings], np.float64)
        last = _at(source.clock, int(inside.instants[-1])) if len(inside.instants) else float(begins[-1])
        seconds = np.union1d(np.arange(begins[0], last, _LINE_S), begins)
        there = points[np.searchsorted(begins, seconds, side="right") - 1]
        here = _where(self._story.tracks[source.robot], seconds)
        places.draw_intents(self._canvas, source.robot, seconds, here, there)

    def _ages(self, source: Source, inside: Inside) -> None:
        """How old what it knows of each other robot is."""
        canvas, robot = self._canvas, source.robot
        peers = list(dict.fromkeys(one.peer for one in inside.contacts))
        if robot not in self._detailed:
            return
        for peer in peers:
            mine = [one for one in inside.contacts if one.peer == peer]
            begins = source.clock(np.array([one.instant for one in mine], np.int64))
            heard = source.clock(np.array([one.heard or 0 for one in mine], np.int64))
            heard[[one.heard is None for one in mine]] = np.nan
            seconds = np.arange(begins[0], self._story.end, 2 * _PLOT_S)
            ages = seconds - heard[np.searchsorted(begins, seconds, side="right") - 1]
            known = np.isfinite(ages)
            path = f"plots/ages/{peer}_at_{robot}"
            words.introduce_line(canvas, path, f"{peer} at {robot}", canvas.colour(peer))
            words.draw_line(canvas, path, seconds[known], ages[known])


def arrangement(story: Story, detailed: Sequence[str], *, reasons: bool = False) -> layout.Arrangement:
    """What the window is to show of a story."""
    return layout.Arrangement(story.grid, story.robots, detailed, story.end, story.true, reasons)


def _draw_inside(canvas: Canvas, robot: str, clock: Clock, inside: Inside) -> None:
    """Scan, particles, estimate, costs, plan and arc."""
    insides.introduce_inside(canvas, robot)
    seconds = clock(inside.instants)
    insides.draw_clouds(canvas, robot, "scan", seconds, inside.scans.counts, inside.scans.values)
    at = clock(inside.particles_at)
    insides.draw_clouds(canvas, robot, "particles", at, inside.particles.counts, inside.particles.values)
    insides.draw_estimates(canvas, robot, seconds, inside.estimates, inside.covariances)
    insides.draw_arcs(canvas, robot, seconds, inside.estimates, inside.twists)
    insides.draw_plans(canvas, robot, clock(inside.plans_at), inside.plans.rows())
    costs = inside.costs_at
    insides.draw_costs(canvas, robot, clock(costs), inside.costs, inside.corners, inside.cell)


def _with_absence(spells: Sequence[Spell], track: Track) -> list[Spell]:
    """With when it was frozen or off, which it does not know itself."""
    absent = [Spell(second, state) for second, state in track.acts if state]
    back = []
    for second, state in track.acts[1:]:
        if not state:
            before = [spell for spell in spells if spell.second <= second]
            back += [before[-1]._replace(second=second)] if before else []
    return sorted((*spells, *absent, *back))


def _events(story: Story) -> Iterator[Event]:
    for deed in _first(story.reported):
        own = "" if deed.place.owner == deed.robot else f", adopted from {deed.place.owner}"
        yield Event(deed.second, deed.robot, f"cleaned {_name(deed.place)}{own}")
    for deed in story.given_up:
        yield Event(deed.second, deed.robot, f"gives up {_name(deed.place)}", "ERROR")
    for deed in story.taken_over:
        yield Event(deed.second, deed.robot, f"adopts {_name(deed.place)}", "WARN")
    for robot, track in story.tracks.items():
        for second, state in track.acts:
            if state or second > track.seconds[0]:
                yield Event(second, robot, f"is {state}" if state else "acts again", "WARN")
    for note in story.notes:
        yield Event(0.0, "", note, "WARN")


def _inner_events(source: Source, inside: Inside) -> Iterator[Event]:
    blocked: float | None = None
    before = ""
    for one in inside.doings:
        second = _at(source.clock, one.instant)
        if one.activity == "BLOCKED" and blocked is None:
            blocked = second
            yield Event(second, source.robot, "is blocked", "WARN")
        elif one.activity != "BLOCKED" and blocked is not None:
            yield Event(second, source.robot, f"free again after {second - blocked:.0f} s")
            blocked = None
        if one.activity == "aborted" and before != "aborted":
            yield Event(second, source.robot, "navigation gives its goal up", "ERROR")
        before = one.activity
    for learnt in inside.learnt:
        by = learnt.by.partition(".")[0]
        second = _at(source.clock, learnt.instant)
        told = "" if learnt.source == source.robot else f" from {learnt.source}, {learnt.age / 1e6:.1f} s old"
        yield Event(second, source.robot, f"{learnt.words} ({by}{told})", "WARN")
    if inside.fault is not None:
        last = _at(source.clock, int(inside.instants[-1])) if len(inside.instants) else 0.0
        yield Event(last, source.robot, inside.fault, "ERROR")


def _first(deeds: Sequence[Deed]) -> list[Deed]:
    """Who said so first of each place."""
    found: dict[PlaceKey, Deed] = {}
    for deed in deeds:
        found.setdefault(deed.place, deed)
    return list(found.values())


def _name(place: PlaceKey) -> str:
    return f"{place.owner}/{place.place}"


def _every(period: float, end: float) -> Floats:
    """(n,) s, from 0 on."""
    return np.arange(0.0, end, period).astype(np.float64)


def _fate(outcome: Outcome) -> str:
    return outcome.name.lower().replace("_", " ")


def _at(clock: Clock, instant: int) -> float:
    return float(clock(np.array([instant], np.int64))[0])


def _where(track: Track, seconds: Floats) -> Floats:
    """(n, 2), m."""
    known = np.isfinite(track.poses[:, 0])
    when, poses = track.seconds[known], track.poses[known]
    if not len(when):
        return np.full((len(seconds), 2), np.nan)
    return np.column_stack([np.interp(seconds, when, poses[:, axis]) for axis in (0, 1)])


def _spacing(track: Track) -> float:
    return float(np.median(np.diff(track.seconds))) if len(track.seconds) > 1 else _PLOT_S


def _speeds(seconds: Floats, poses: Floats) -> Floats:
    """(n,) m/s, over what lies between two points of the plot."""
    speeds: NDArray[np.float64] = np.zeros(len(seconds))
    if len(seconds) > 1:
        speeds[1:] = np.hypot(*np.diff(poses[:, :2], axis=0).T) / np.diff(seconds)
    return speeds
