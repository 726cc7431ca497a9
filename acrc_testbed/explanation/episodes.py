"""Parameters of time accounting, and intervals of steps."""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.run_model.data import Route, RunData, Trajectory
from actors.array_types import Flags, Floats, Int64s
from actors.robot.navigation.navigation_counts import GoalRecord

NO_GOAL: Final = -1
REACHED: Final = "succeeded"
"""Result of a reached goal."""
ABORTED: Final = frozenset({"no plan", "blocked", "no progress"})
"""Results of aborted goals."""


def pursued_goals(goals: Sequence[GoalRecord], run: RunData) -> Int64s:
    """Return the number of the robot's current goal, (steps,); NO_GOAL: none.

    An aborted goal counts until the next one or the end of the run, as the strategy has not cancelled it.
    """
    pursuing = np.full(len(run.true), NO_GOAL, np.int64)
    for number, goal in enumerate(goals):
        end = goal.end
        if end is None or goal.how in ABORTED:
            end = goals[number + 1].begin if number + 1 < len(goals) else None
        last = len(pursuing) if end is None else end // run.step_us
        pursuing[goal.begin // run.step_us : last] = number
    return pursuing


def interval_mask(found: Sequence[tuple[int, int | None]], run: RunData) -> Flags:
    """Return the mask of intervals, (steps,); each from begin to end, µs; None: to the end of the run."""
    mask = np.zeros(len(run.true), np.bool_)
    for begin, end in found:
        mask[begin // run.step_us : None if end is None else -(-end // run.step_us)] = True
    return mask


class CauseCriteria(msgspec.Struct, frozen=True):
    """Criteria of causes and blockings; chosen here, as the chapter gives no numbers."""

    lost: float = 1.0
    """A robot is lost once its localisation error exceeds this, m."""
    relocalised: float = 0.5
    """A lost robot has relocalised once its error is below this, m."""
    stand_radius: float = 0.1
    """A robot stands while it stays this close to its position at the start of a window, m."""
    block_distance: float = 1.6
    """Standing robots block each other within this distance, centre to centre, m. Measured in 24 runs of the
    chapter's scenario, distance of robots that stood for 30 s to the nearest one that did: 80 % of the time
    below 1 m, 10 % at 1.3 to 1.5 m, head-on at doors, and 0.1 % at 1.5 to 1.7 m."""
    pause_s: float = 3.0
    """A robot behind another one makes no progress once it stays within `stand_radius` for this time, s;
    shorter stops are part of driving, as strategies request goals every 2 s."""
    turn_s: float = 10.0
    """The same for a robot with no other within `block_distance`, s: oscillation_timeout of move_base.
    Measured: a turn on the spot takes a single robot up to 7.9 s."""
    wait_s: float = 30.0
    """A robot that moves without progress towards any goal for this time, s, is in a livelock."""
    min_progress: float = 0.25
    """Progress is a new minimum of the distance to the goal by this much, m; turning changes it by less."""
    to_and_fro: float = 3.0
    """A robot moves to and fro if it drives this multiple of the extent of its path; a detour is shorter."""
    turning: float = 0.1
    """A robot that turns faster than this, rad/s, is moving."""
    view_distance: float = 2.5
    """Distance of the obstacle for which a robot stands for `turn_s`, at most, m: the local map ends there
    (obstacle_range). Robots stop 1.6 to 2.5 m before what closes a door."""
    in_way: float = 0.45
    """A robot nearer to another one's path than this, m, blocks it: two inscribed radii and two cells of the
    local map, so the local planner finds no path. Two robots without progress at this distance block each
    other in any direction."""
    sensed: float = 5.0
    """Distance along the path at which another robot can prevent a plan, m: range of the sensor."""
    deadlock_s: float = 10.0
    """Minimum duration of a deadlock, s."""
    reported: float = 0.5
    """A goal is reachable if a robot can get this near, m: from there robots report it."""
    contact: float = 5.0
    """Radio range without walls in between, m: half of the range of the radio `chapter`."""
    silent_s: float = 5.0
    """A robot that receives nothing for this time, s, although others in range have frames to send, has no
    contact; robots publish once per second."""
    door_distance: float = 0.5
    """A robot is at a door if it is this near to a position where one robot closes the passage, m."""
    neck: float = 1.6
    """Narrower passages between rooms, m, are doors, too: two robots could pass in the 1.5 m between the
    corridor's cabinets, but do not with the chapter's local planner."""
    visit_radius: float = 0.7
    """A goal was visited by a robot this near, m: `reported`, and 0.2 m of localisation error."""
    carry_distance: float = 0.3
    """A robot that moves farther in one step, m, was carried: six times what it can drive in 0.1 s."""


STANDARD: Final = CauseCriteria()


class Episode(NamedTuple):
    """Interval of steps, from `begin` to before `end`."""

    begin: int
    end: int


def true_intervals(mask: Flags, least: int = 1) -> list[Episode]:
    """Return the intervals of True in `mask`, (samples,), with at least `least` samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [Episode(begin, end) for begin, end in pairs if end - begin >= least]


def lost_intervals(errors: Floats) -> list[Episode]:
    """Return when a robot was lost: from an error above `lost` until one below `relocalised`.

    `errors`: (samples,), localisation error, m; NaN (unknown) keeps the state.
    """
    is_lost = np.zeros(errors.size, np.bool_)
    now = False
    for sample, error in enumerate(errors.tolist()):
        if error > STANDARD.lost:
            now = True
        elif error < STANDARD.relocalised:
            now = False
        is_lost[sample] = now
    return true_intervals(is_lost)


def standing_mask(true: Floats, pursuing: Flags, window: int, still: float) -> Flags:
    """Return when a robot with a goal stood, (samples,).

    It stands in a window of `window` samples if it is `pursuing` a goal, (samples,), in all of them, and
    stays within `stand_radius` m of the first position; `true`: (samples, 2), m.
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
    """Activity of one robot by ground truth, updated part by part: driving, standing or idle.

    A robot that stays within `stand_radius` for `pause_s` stands if it has items left; otherwise it is idle.
    """

    def __init__(self, robot: str, *, has_items: bool = True) -> None:
        """`has_items`: it has items before its first route."""
        self._robot, self._has_items = robot, has_items
        self._activity = ""
        self._is_active = True
        """False: frozen or off."""
        self._window: deque[tuple[float, float, float]] = deque()
        """Times, s, and positions, m, of the last `pause_s` of activity."""

    def extend(self, track: Trajectory, routes: Iterable[Route]) -> Iterator[tuple[float, str]]:
        """Yield each change of activity: its time, s, and the new activity."""
        for route in routes:
            if route.robot == self._robot:
                self._has_items = bool(route.items)
        states = deque(track.states)
        for second, (x, y, _) in zip(track.seconds.tolist(), track.poses.tolist(), strict=True):
            while states and states[0][0] <= second:
                self._is_active, self._activity = not states.popleft()[1], ""
                self._window.clear()
            if not self._is_active or np.isnan(x):
                continue
            begin, stays = self._stays(second, x, y)
            activity = "driving" if not stays else "standing" if self._has_items else "idle"
            if activity != self._activity:
                self._activity = activity
                yield begin if stays else second, activity

    def _stays(self, second: float, x: float, y: float) -> tuple[float, bool]:
        """Return the start of the window, s, and whether the robot stayed where it was for `pause_s`."""
        window = self._window
        window.append((second, x, y))
        while len(window) > 1 and second - window[1][0] >= STANDARD.pause_s:
            window.popleft()
        begin, *there = window[0]
        near = all(
            np.hypot(one - there[0], other - there[1]) <= STANDARD.stand_radius for _, one, other in window
        )
        return begin, near and second - begin >= STANDARD.pause_s
