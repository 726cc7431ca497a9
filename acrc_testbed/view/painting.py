"""Draws a run, whole or piece by piece: first what was recorded, then what is computed."""

from collections.abc import Mapping, Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np

from acrc_testbed.explanation.explain import Explanation
from acrc_testbed.trace.frame_fates import LOSSES, Fates, fate_name
from acrc_testbed.trace.rows import Trace
from acrc_testbed.view.plots import DrawnParts, Happenings, PaintedInside, Plots, RobotLane, Way, name
from acrc_testbed.view.story import Floats, Source, Story
from actors.installation.usage import wrong_value
from actors.observer.drawing import layout, places, robots, words
from actors.observer.drawing.canvas import FEW, Canvas
from actors.observer.drawing.places import PlaceState, draw_places
from actors.observer.drawing.words import DrawnEvent, LearntExchange, Occupation
from actors.observer.glyphs import FATES
from actors.radio.medium.state import Outcome
from actors.task.task import PlaceKey


class _RobotWord(NamedTuple):
    """Something that a robot said."""

    second: float
    robot: str
    what: str
    """route, done or given_up."""
    places: tuple[PlaceKey, ...]


class PlaceHistory:
    """Draws the places of each owner whenever one of them stands otherwise."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._states: dict[PlaceKey, PlaceState] = {}
        self._shown: dict[PlaceKey, PlaceState] = {}
        """Those that somebody has spoken of, and those that were there from the beginning."""
        self._held: dict[str, frozenset[PlaceKey]] = {}

    def extend(self, story: Story) -> None:
        """Take in a story, or its next piece."""
        self._come(story)
        for word in _words(story):
            touched = set(word.places)
            if word.what == "route":
                now = frozenset(word.places)
                touched = set(now ^ self._held.get(word.robot, frozenset()))
                self._held[word.robot] = now
            changed = set()
            for key in touched & self._states.keys():
                new = self._after(key, word.what)
                if new != self._shown.get(key):
                    self._states[key] = self._shown[key] = new
                    changed.add(key.owner)
            self._draw(word.second, changed)

    def _come(self, story: Story) -> None:
        """The places that are new: shown at once if they are of the beginning, else once spoken of."""
        owners = set()
        for owner, points in story.places.items():
            for number, (x, y) in enumerate(points):
                key = PlaceKey(owner, number)
                if key in self._states:
                    continue
                self._states[key] = PlaceState(x, y, holders=(owner,))
                if number < story.begun_with[owner]:
                    self._shown[key] = self._states[key]
                    self._held[owner] = self._held.get(owner, frozenset()) | {key}
                    owners.add(owner)
        self._draw(0.0, owners)

    def _after(self, key: PlaceKey, what: str) -> PlaceState:
        """How a place stands once something was said of it."""
        state = self._states[key]
        if what == "route":
            robots = self._canvas.robots
            return state._replace(
                holders=tuple(robot for robot in robots if key in self._held.get(robot, ()))
            )
        return state._replace(done=True) if what == "done" else state._replace(given_up=True)

    def _draw(self, second: float, owners: set[str]) -> None:
        for owner in sorted(owners):
            mine = [state for key, state in self._shown.items() if key.owner == owner]
            if mine:
                draw_places(self._canvas, owner, second, mine)


def _words(story: Story) -> list[_RobotWord]:
    """In order of time; at one instant what has become of a place comes before who holds it."""
    said = [_RobotWord(deed.second, deed.robot, "done", (deed.place,)) for deed in story.reported]
    said += [_RobotWord(deed.second, deed.robot, "given_up", (deed.place,)) for deed in story.given_up]
    said += [_RobotWord(route.second, route.robot, "route", route.places) for route in story.routes]
    return sorted(said, key=lambda word: (word.second, word.what))


DETAILED: Final = 8
"""Of so many robots everything is drawn; of the others what they do, know and want: a file of fifty robots'
scans and particles would have gigabytes."""
_LASTING: Final = 10.0
"""So long an exchange shows in the graph of ensembles."""


class Painting:
    """One story on one canvas, or one piece of it after another."""

    def __init__(self, canvas: Canvas, story: Story, detailed: Sequence[str]) -> None:
        """`detailed`: the robots of which everything is drawn."""
        self._canvas, self._detailed = canvas, frozenset(detailed)
        self._chosen = self._detailed if len(detailed) < DETAILED else frozenset[str]()
        """Robots of which all links, goals and adoptions are drawn, however many robots there are."""
        self._ways = {robot: Way() for robot in story.robots}
        self._trails = {robot: robots.DrawnTrail() for robot in story.robots}
        self._lanes = {robot: RobotLane(canvas, robot) for robot in story.robots}
        self._insides: dict[str, PaintedInside] = {}
        self._places = PlaceHistory(canvas)
        self._plots = Plots(canvas, true=story.true)
        self._happenings = Happenings()
        self._heard: Floats = np.zeros((0, 4))
        """What was heard lately."""
        self._lost: list[tuple[float, int, str]] = []
        """Copies that were lost lately."""
        self._fates_since = 0.0
        self._exchanges: list[LearntExchange] = []
        places.draw_floor(canvas, story.grid, story.doors)
        places.draw_marks(canvas)
        places.draw_lines(canvas, "copies", FATES)
        robots.introduce_radio(canvas)
        for robot in story.robots:
            robots.introduce(canvas, robot)
            places.introduce_intent(canvas, robot)

    def recorded(self, story: Story) -> None:
        """What was recorded: robots, trails, places, links, plots, events."""
        canvas = self._canvas
        for robot, track in story.tracks.items():
            known = np.isfinite(track.poses[:, 0])
            seconds, poses = track.seconds[known], track.poses[known]
            self._ways[robot].extend(seconds, poses)
            robots.draw_poses(canvas, robot, seconds, poses)
            robots.draw_trail(canvas, robot, seconds, poses[:, :2], self._trails[robot])
            for second, state in track.acts:
                robots.draw_name(canvas, robot, second, state)
            self._lanes[robot].act(track.acts)
        for second, put in story.things:
            places.draw_things(canvas, second, [(one.kind, one.points, one.radius) for one in put])
        self._places.extend(story)
        self._links(story)
        self._plots.extend(story)
        words.draw_events(canvas, "recorded", list(self._happenings.of(story)))
        self._adoptions(story)

    def fates(self, fates: Fates, until: float, *, last: bool = True) -> None:
        """What became of frames: rings where copies are lost, and how many there were of each fate.

        Up to an instant, s; `last`: nothing will follow.
        """
        canvas = self._canvas
        rows = zip(fates.seconds.tolist(), fates.receivers.tolist(), fates.outcomes.tolist(), strict=True)
        self._lost += [(s, who, fate_name(Outcome(what))) for s, who, what in rows if Outcome(what) in LOSSES]
        shown = robots.shown_s(canvas)
        seconds = _every(robots.period(canvas), max(0.0, self._fates_since - shown), until)
        robots.draw_losses(canvas, seconds, self._positions(seconds), self._lost, self._fates_since)
        self._fates_since = until
        self._lost = [one for one in self._lost if one[0] > until - shown - robots.period(canvas)]
        self._plots.copies(fates, until, last=last)

    def inside(self, source: Source, inside: Trace, end: float | None = None) -> None:
        """What a robot perceived, meant and knew. `end`: of the run, s, if nothing will follow."""
        if source.actor not in self._insides:
            way, lane = self._ways[source.robot], self._lanes[source.robot]
            shown = DrawnParts(source.robot in self._detailed, self._in_full(source.robot))
            painted = PaintedInside(self._canvas, source, way, lane, shown)
            self._insides[source.actor] = painted
        self._exchanges += self._insides[source.actor].draw(inside, end)

    def outside(self, robot: str, spells: Sequence[Occupation], until: float) -> None:
        """What is known of a robot that is not looked into."""
        self._lanes[robot].do(spells, until)

    def deadlocks(self, spells: Mapping[str, Sequence[tuple[float, float]]]) -> None:
        """When robots were in deadlocks, s, by ground truth; before what they perceived is drawn."""
        for robot, mine in spells.items():
            self._lanes[robot].deadlocks(mine)
        told = [DrawnEvent(begin, robot, "is in a deadlock", "ERROR") for robot in spells
                for begin, _ in spells[robot]]  # fmt: skip
        words.draw_events(self._canvas, "truth", told)

    def end(self, second: float) -> None:
        """The run is over: nobody does anything any more."""
        for lane in self._lanes.values():
            lane.end(second)

    def tell(self, events: Sequence[DrawnEvent]) -> None:
        """Tell of the view itself: what it lacks, and why."""
        words.draw_events(self._canvas, "view", events)

    def reasons(self, robot: str, explanations: Sequence[Explanation]) -> None:
        """Why it decided what it did: each decision's causes, until the next one."""
        told = [
            (second, [(link.at_s, link.depth, link.says) for one in made for link in one.chain])
            for second, made in groupby(explanations, lambda one: one.at_s)
        ]
        words.draw_reasons(self._canvas, robot, told)

    def ensembles(self, since: float = 0.0) -> None:
        """Who has learnt from whom, from an instant on, s."""
        words.draw_ensembles(self._canvas, self._exchanges, _LASTING, since)
        self._exchanges = [one for one in self._exchanges if one.second + 2 * _LASTING > since]

    def _links(self, story: Story) -> None:
        canvas = self._canvas
        heard = np.concatenate((self._heard, story.heard))
        self._heard = heard[heard[:, 0] > story.end - 2 * robots.LASTING]
        seconds = _every(robots.period(canvas), story.since, story.end)
        robots.draw_links(canvas, seconds, self._positions(seconds), heard, self._chosen)

    def _positions(self, seconds: Floats) -> Floats:
        """(n, robots, 2): where robots are, m."""
        return np.stack([way.at(seconds) for way in self._ways.values()], axis=1)

    def _in_full(self, robot: str) -> bool:
        """What a robot heads for and adopts is drawn: of a few all, of many the chosen."""
        return len(self._canvas.robots) <= FEW or robot in self._chosen

    def _adoptions(self, story: Story) -> None:
        for deed in story.taken_over:
            if self._in_full(deed.robot) and deed.place.place < len(story.places.get(deed.place.owner, ())):
                point = story.places[deed.place.owner][deed.place.place]
                x, y = self._ways[deed.robot].at(np.array([deed.second]))[0].tolist()
                places.draw_adoption(self._canvas, deed.robot, deed.second, (x, y), point, name(deed.place))


def looked_into(robots: Sequence[str], wished: Sequence[str]) -> list[str]:
    """The robots of which everything is drawn: those that are wished, else the first DETAILED.

    Raises OptionError for one that is none of them.
    """
    for robot in wished:
        if robot not in robots:
            raise wrong_value("--robot", robot, f"one of {', '.join(robots)}")
    return [robot for robot in robots if robot in wished] or list(robots[:DETAILED])


def arrangement(story: Story, detailed: Sequence[str], *, reasons: bool = False) -> layout.Arrangement:
    """What the window is to show of a story."""
    return layout.Arrangement(story.grid, story.robots, detailed, story.end, story.true, reasons)


def _every(period: float, since: float, end: float) -> Floats:
    """(n,) s: the multiples of the period from `since` to before `end`."""
    first, last = (int(np.ceil(second / period - 1e-9)) for second in (since, end))
    return np.arange(first, max(first, last)).astype(np.float64) * period
