"""Each step of each robot by what its time went into, from ground truth; the order of `Cause` decides."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.instant import seconds
from observation.accounting.episodes import STANDARD, EpisodeParameters, lost, standing
from observation.accounting.passage import Passages
from observation.accounting.said import Said, pursuit, spells
from observation.accounting.time_spent import Cause
from observation.accounting.tracks import Tracks

CAUSES: Final = tuple(Cause)
NOBODY: Final = -1


@dataclass(frozen=True, eq=False)
class Classified:
    """What every step of every robot went into."""

    causes: NDArray[np.uint8]
    """(steps, robots): index in CAUSES."""
    before: NDArray[np.int32]
    """(steps, robots): the robot that it stands before, NOBODY if none is why."""
    stood: NDArray[np.bool_]
    """(steps, robots): it stood although it wanted to be elsewhere, whatever the cause."""
    at_door: NDArray[np.bool_]
    """(steps, robots): it stood before a robot, and one of the two in or at a door."""

    def is_(self, *wanted: Cause) -> NDArray[np.bool_]:
        """(steps, robots): where one of these is the cause."""
        return np.isin(self.causes, [CAUSES.index(cause) for cause in wanted])


class _Robots:
    """The states of all robots that follow from one robot each."""

    def __init__(
        self, tracks: Tracks, said: Mapping[str, Said], grid: OccupancyGrid, p: EpisodeParameters
    ) -> None:
        steps = len(tracks.true)
        always = np.ones(steps, np.bool_)
        robots = [said.get(robot, Said()) for robot in tracks.robots]
        self.still, self.long_still = (
            _columns(
                standing(tracks.true[:, index, :2], always, min(window, steps), p.still)
                for index in range(len(robots))
            )
            for window in (seconds(each) // tracks.step_us for each in (p.pause_s, p.turn_s))
        )
        """For `pause_s` and for `turn_s`."""
        wants = _columns(pursuit(one.goals, tracks) for one in robots)
        self.on = tracks.stepping
        self.wants = wants & tracks.busy & self.on
        """It has a goal not reached yet, and something left to do."""
        self.waits = self.still & self.wants
        """It stands, and so waits for whoever is near."""
        self.planless = _columns(spells(one.planless, tracks) for one in robots) | _in_wall(tracks, grid)
        self.lost = _columns(_lost(error, p) for error in errors(tracks).T)


def classify(
    tracks: Tracks,
    said: Mapping[str, Said],
    passages: Passages,
    parameters: EpisodeParameters = STANDARD,
) -> Classified:
    """What every robot's time went into."""
    robots = _Robots(tracks, said, passages.grid, parameters)
    causes = np.full(robots.on.shape, CAUSES.index(Cause.DRIVING), np.uint8)
    before = np.full(robots.on.shape, NOBODY, np.int32)
    at_door = np.zeros(robots.on.shape, np.bool_)
    long_waits = robots.long_still & robots.wants
    causes[long_waits] = CAUSES.index(Cause.NO_PROGRESS)
    for robot in range(len(tracks.robots)):
        steps = np.flatnonzero(robots.waits[:, robot] & ~robots.lost[:, robot] & ~robots.planless[:, robot])
        if steps.size and len(tracks.robots) > 1:
            _others(tracks, robots, robot, steps, passages, parameters, (causes, before, at_door))
    _queue(causes, before, at_door)
    for cause, where in (
        (Cause.NO_PLAN, robots.planless & robots.wants),
        (Cause.LOST, robots.lost),
        (Cause.IDLE, robots.still & ~robots.wants),
        (Cause.OFF, ~robots.on),
    ):  # the last one wins
        causes[where] = CAUSES.index(cause)
    stood = (robots.waits & (before != NOBODY)) | long_waits
    return Classified(causes, before, stood, at_door)


def errors(tracks: Tracks) -> NDArray[np.float64]:
    """(steps, robots): how far each robot is from where it holds itself to be, m; NaN where nobody knows."""
    offset = tracks.held[..., :2] - tracks.true[..., :2]
    far: NDArray[np.float64] = np.hypot(offset[..., 0], offset[..., 1])
    return far


def _others(
    tracks: Tracks,
    robots: _Robots,
    robot: int,
    steps: NDArray[Any],
    passages: Passages,
    p: EpisodeParameters,
    into: tuple[NDArray[np.uint8], NDArray[np.int32], NDArray[np.bool_]],
) -> None:
    """Before whom one robot stands in these steps: the nearest one that nothing hides."""
    causes, before, at_door = into
    here = tracks.true[steps, robot, :2]
    there = tracks.true[steps, :, :2]
    gaps = np.hypot(there[..., 0] - here[:, None, 0], there[..., 1] - here[:, None, 1])
    gaps[:, robot] = np.inf
    limit = np.where(robots.long_still[steps, robot], p.seen, p.near)
    gaps[gaps > limit[:, None]] = np.inf
    near = np.nonzero(np.isfinite(gaps))
    gaps[near] = np.where(passages.sees(here[near[0]], there[near]), gaps[near], np.inf)
    wedged = (gaps < p.wedge) & robots.waits[steps]
    nearest = np.where(wedged.any(axis=1), wedged.argmax(axis=1), gaps.argmin(axis=1))
    rows = np.arange(len(steps))
    close = np.flatnonzero(np.isfinite(gaps[rows, nearest]))
    if not close.size:
        return
    steps, nearest, rows = steps[close], nearest[close], rows[close]  # type: ignore[assignment]
    other = there[rows, nearest]
    doors = _at_doors(passages, here[rows], other, p.beside)
    done = robots.still[steps, nearest] & ~robots.wants[steps, nearest]
    found = np.where(doors, CAUSES.index(Cause.DOOR), CAUSES.index(Cause.OPEN_FLOOR))
    found[done] = CAUSES.index(Cause.DONE_IN_WAY)
    found[wedged[rows, nearest]] = CAUSES.index(Cause.WEDGED)
    causes[steps, robot], before[steps, robot], at_door[steps, robot] = found, nearest, doors


def _queue(causes: NDArray[np.uint8], before: NDArray[np.int32], at_door: NDArray[np.bool_]) -> None:
    """Who stands on open floor before somebody who waits at a door waits there, too."""
    floor, door = CAUSES.index(Cause.OPEN_FLOOR), CAUSES.index(Cause.DOOR)
    rows, robots = np.nonzero(causes == floor)
    while rows.size:
        joins = causes[rows, before[rows, robots]] == door
        if not joins.any():
            return
        causes[rows[joins], robots[joins]], at_door[rows[joins], robots[joins]] = door, True
        rows, robots = rows[~joins], robots[~joins]


def _at_doors(
    passages: Passages, one: NDArray[np.float64], other: NDArray[np.float64], beside: float
) -> NDArray[np.bool_]:
    """(k,): one of the two, or their middle, is in or just before a door."""
    at = passages.at(np.concatenate([one, other, (one + other) / 2]), beside)
    any_of: NDArray[np.bool_] = np.any(at.reshape(3, -1), axis=0)
    return any_of


def _in_wall(tracks: Tracks, grid: OccupancyGrid) -> NDArray[np.bool_]:
    """(steps, robots): it holds itself to be where something is; not where it has not said anything."""
    corner = np.array([grid.origin.x, grid.origin.y])
    known = np.isfinite(tracks.held[..., 0])
    cells = np.floor((np.where(known[..., None], tracks.held[..., :2], corner) - corner) / grid.resolution)
    cells = cells.astype(np.int64)
    inside = ((cells >= 0) & (cells < [grid.columns, grid.rows])).all(axis=-1)
    cells[~inside] = 0
    taken: NDArray[np.bool_] = known & (~inside | grid.blocking[cells[..., 1], cells[..., 0]])
    return taken


def _lost(error: NDArray[np.float64], p: EpisodeParameters) -> NDArray[np.bool_]:
    during = np.zeros(error.size, np.bool_)
    if np.nanmax(error, initial=0.0) > p.lost:
        for begin, end in lost(error, p):
            during[begin:end] = True
    return during


def _columns(parts: Iterable[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    return np.column_stack(list(parts))
