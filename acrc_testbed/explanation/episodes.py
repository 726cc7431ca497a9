"""Parameters of the accounting, and intervals of steps."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.run_model.data import Route, RunData, Trajectory
from actors.robot.navigation.navigation_counts import GivenGoal

NO_GOAL: Final = -1
REACHED: Final = "succeeded"
"""How a goal ended to which the robot came."""
ABORTED: Final = frozenset({"no plan", "blocked", "no progress"})
"""How goals ended that navigation gave up."""


def pursued(goals: Sequence[GivenGoal], run: RunData) -> NDArray[np.int64]:
    """(steps,): which of the goals a robot has and has not reached; NO_GOAL: none.

    A goal that navigation gave up counts until the next one, or until the end of the run: nobody has told the
    robot that it need not go there any more.
    """
    pursuing = np.full(len(run.true), NO_GOAL, np.int64)
    for number, goal in enumerate(goals):
        end = goal.end
        if end is None or goal.how in ABORTED:
            end = goals[number + 1].begin if number + 1 < len(goals) else None
        last = len(pursuing) if end is None else end // run.step_us
        pursuing[goal.begin // run.step_us : last] = number
    return pursuing


def during(found: Sequence[tuple[int, int | None]], run: RunData) -> NDArray[np.bool_]:
    """(steps,): True during the spells, from begin to end, µs; None: to the end of the run."""
    during = np.zeros(len(run.true), np.bool_)
    for begin, end in found:
        during[begin // run.step_us : None if end is None else -(-end // run.step_us)] = True
    return during


@dataclass(frozen=True)
class EpisodeParameters:
    """What counts as a failure, and where time goes; own choices, as the chapter gives no numbers."""

    lost: float = 1.0
    """A robot is lost from when it holds itself to be farther than this from where it is, m ..."""
    found: float = 0.5
    """... until it is nearer than this, m."""
    still: float = 0.1
    """A robot stands while it stays this close to its position at the start of a window, m."""
    near: float = 1.6
    """Robots that stand stand in each other's way within this distance, centre to centre, m. Measured, robots
    that stood for 30 s by how far the nearest other one was that did (24 runs of the chapter's scenario):
    80 % of their time below 1 m, 10 % at 1.3 to 1.5 m, head-on at doors, and 0.1 % at 1.5 to 1.7 m."""
    pause_s: float = 3.0
    """A robot with another one in its way that stays within `still` for so many s does not get on; to stand
    for less is part of driving: strategies ask every 2 s for the next goal."""
    turn_s: float = 10.0
    """The same of a robot with nobody within `near`: move_base's oscillation_timeout. Measured: a turn on the
    spot takes a robot alone up to 7.9 s."""
    wait_s: float = 30.0
    """Who moves, and gets no nearer to any of its goals for so many s, is in a livelock."""
    nearer: float = 0.25
    """To be nearer than ever by so much, m, is to get on; less is what a robot that turns comes to."""
    to_and_fro: float = 3.0
    """Who has driven so many times the size of the floor that it was on moves to and fro; who makes a detour
    does not."""
    turning: float = 0.1
    """Who turns faster than this, rad/s, does not stand idly."""
    seen: float = 2.5
    """Before a robot so near, m, stands who does so for `turn_s`: what is farther away is not in the local
    map (obstacle_range). Before a door that is closed robots stop 1.6 to 2.5 m from what closes it."""
    in_way: float = 0.45
    """A robot nearer to another one's way than this, m, is in it: nearer than their two inscribed circles and
    two cells of the local map, so that the local planner finds no way past. Two that do not get on and are so
    near to each other are in each other's way wherever they go."""
    sensed: float = 5.0
    """So far on its way, m, another robot keeps it from finding a plan: as far as its sensor sees."""
    deadlock_s: float = 10.0
    """A pair counts as a deadlock from so many s on; for less it is a touch and go."""
    reported: float = 0.5
    """A goal can be reached where a robot can come so near, m: as robots report places."""
    contact: float = 5.0
    """Robots so near, m, with no wall between are within each other's reach by radio: half of the range of
    the radio `chapter`."""
    silent_s: float = 5.0
    """Who hears nobody for so many s although others within reach have frames to send has no contact: they
    publish once a second."""
    beside: float = 0.5
    """A robot is at a door if it is so near to where one robot closes the way, m."""
    neck: float = 1.6
    """A passage between rooms that is narrower, m, is a door, too: between the corridor's cabinets there are
    1.5 m, in which two robots could pass; with the chapter's local planner they do not."""
    fit: float = 0.7
    """A goal was visited by whoever was so near, m: as the world judges places (WorldSetup.reach)."""
    jump: float = 0.3
    """Who is farther away one step later, m, was carried: six times what a robot can drive in 0.1 s."""


STANDARD: Final = EpisodeParameters()


class Episode(NamedTuple):
    """Something that one robot is in for a while."""

    begin: int
    end: int


def runs(mask: NDArray[np.bool_], least: int = 1) -> list[Episode]:
    """The longest stretches of True in `mask`, (samples,), that have at least `least` samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [Episode(begin, end) for begin, end in pairs if end - begin >= least]


def lost(errors: NDArray[np.float64], parameters: EpisodeParameters = STANDARD) -> list[Episode]:
    """When one robot was lost: from an error above `lost` until one below `found`.

    `errors`: (samples,), how far it was from where it held itself to be, m; NaN where nobody knows, which
    changes nothing.
    """
    is_lost = np.zeros(errors.size, np.bool_)
    now = False
    for sample, error in enumerate(errors.tolist()):
        if error > parameters.lost:
            now = True
        elif error < parameters.found:
            now = False
        is_lost[sample] = now
    return runs(is_lost)


def standing(
    true: NDArray[np.float64], pursuing: NDArray[np.bool_], window: int, still: float
) -> NDArray[np.bool_]:
    """(samples,): when one robot stood although it wanted to be elsewhere.

    That is in all samples of every window of `window` samples throughout which it was `pursuing` a goal,
    (samples,), and at most `still` m from where it was in the window's first; `true`: (samples, 2), m.
    """
    stood = np.zeros(len(true), np.bool_)
    if len(true) < window:
        return stood
    windows = np.lib.stride_tricks.sliding_window_view(true, window, axis=0)
    offsets = windows - true[: len(windows), :, None]
    stays = (offsets[:, 0] ** 2 + offsets[:, 1] ** 2).max(axis=1) <= still**2
    stays &= np.lib.stride_tricks.sliding_window_view(pursuing, window).all(axis=1)
    for begin in np.flatnonzero(stays).tolist():
        stood[begin : begin + window] = True
    return stood


class ObservedActivity:
    """One robot's activity as observed from outside, part by part: driving, standing or idle.

    A robot stands if it stays within `still` for `pause_s` although it intends to visit places; an idle one
    intends to visit none.
    """

    def __init__(self, robot: str, *, has_places: bool = True) -> None:
        """`has_places`: it intends to visit places before its first route."""
        self._robot, self._has_places = robot, has_places
        self._activity = ""
        self._is_active = True
        """False: it is frozen or off."""
        self._window: deque[tuple[float, float, float]] = deque()
        """Instants, s, and positions, m, of the last `pause_s` in which it was active."""

    def extend(self, track: Trajectory, routes: Iterable[Route]) -> Iterator[tuple[float, str]]:
        """Yield each change of activity, and since when, s."""
        for route in routes:
            if route.robot == self._robot:
                self._has_places = bool(route.places)
        states = deque(track.states)
        for second, (x, y, _) in zip(track.seconds.tolist(), track.poses.tolist(), strict=True):
            while states and states[0][0] <= second:
                self._is_active, self._activity = not states.popleft()[1], ""
                self._window.clear()
            if not self._is_active or np.isnan(x):
                continue
            begin, stays = self._stays(second, x, y)
            activity = "driving" if not stays else "standing" if self._has_places else "idle"
            if activity != self._activity:
                self._activity = activity
                yield begin if stays else second, activity

    def _stays(self, second: float, x: float, y: float) -> tuple[float, bool]:
        """Return since when it is observed, s, and whether it has stayed there for `pause_s`."""
        window = self._window
        window.append((second, x, y))
        while len(window) > 1 and second - window[1][0] >= STANDARD.pause_s:
            window.popleft()
        begin, *there = window[0]
        near = all(np.hypot(one - there[0], other - there[1]) <= STANDARD.still for _, one, other in window)
        return begin, near and second - begin >= STANDARD.pause_s
