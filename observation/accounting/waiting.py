"""Who waits for whom: the robot that is in the way of another one, which does not get on."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from observation.accounting.episodes import EpisodeParameters
from observation.accounting.passage import Passages
from observation.accounting.robot_states import Flags, RobotStates
from observation.accounting.true_floor import Stage

NOBODY: Final = -1
_APART: Final = 0.1
"""Points of a way that are so far apart, m, are looked at; who is ahead by less than it is aside is not."""
Points = NDArray[np.float64]
Indices = NDArray[np.int32]


def ahead(states: RobotStates, stuck: Flags, passages: Passages, p: EpisodeParameters) -> Indices:
    """(steps, robots): the first robot on its way, where it is stuck; NOBODY: there is none."""
    found = np.full(stuck.shape, NOBODY, np.int32)
    for robot in range(stuck.shape[1]):
        for rows, goal, stage in states.pursuits(robot, stuck[:, robot]):
            squares = stage.ways.squares(states.tracks.true[rows, robot, :2])
            _, which = np.unique(squares, axis=0, return_inverse=True)
            for number in range(int(which.max()) + 1):
                same = rows[which.reshape(-1) == number]
                way = _way(states, robot, int(same[0]), goal, stage, p.sensed)
                found[same, robot] = _first(states, robot, same, way, passages, p)
    return found


def beside(states: RobotStates, stuck: Flags, passages: Passages, p: EpisodeParameters) -> Indices:
    """(steps, robots): the nearest robot that stands, too, so near that neither gets past the other."""
    found = np.full(stuck.shape, NOBODY, np.int32)
    for robot in range(stuck.shape[1]):
        rows = np.flatnonzero(stuck[:, robot])
        there, here = states.tracks.true[rows, :, :2], states.tracks.true[rows, robot, :2]
        gaps = np.hypot(*(there - here[:, None]).transpose(2, 0, 1))
        gaps[:, robot] = np.inf
        gaps[~states.waits[rows] | (gaps >= p.in_way)] = np.inf
        nearest = gaps.argmin(axis=1)
        near = np.flatnonzero(np.isfinite(gaps.min(axis=1)))
        near = near[passages.sees(here[near], there[near, nearest[near]])]
        found[rows[near], robot] = nearest[near]
    return found


def _way(
    states: RobotStates, robot: int, step: int, goal: tuple[float, float] | None, stage: Stage, length: float
) -> Points:
    """(n, 2): where it would go first; straight ahead where nobody knows what it wants."""
    x, y, heading = states.tracks.true[step, robot].tolist()
    if goal is not None:
        for ways in (stage.ways, stage.opened):
            way = ways.way((x, y), goal, length)
            if way is not None:
                apart = np.hypot(*(way - way[0]).T)
                return way[np.unique(np.floor(apart / _APART), return_index=True)[1]]
        dx, dy = goal[0] - x, goal[1] - y
        heading, length = np.arctan2(dy, dx), min(length, float(np.hypot(dx, dy)))
    along = np.arange(0.0, length + _APART, _APART)
    return np.column_stack([x + along * np.cos(heading), y + along * np.sin(heading)])


def _first(
    states: RobotStates,
    robot: int,
    rows: NDArray[np.int64],
    way: Points,
    passages: Passages,
    p: EpisodeParameters,
) -> Indices:
    """(rows,): which of the others is first on the way, and in it."""
    there = states.tracks.true[rows, :, :2]
    gaps = np.hypot(*(there[:, :, None] - way).transpose(3, 0, 1, 2))
    along = gaps.argmin(axis=2)
    limit = np.where(states.long_waits[rows, robot], p.seen, p.near)
    limit[states.planless[rows, robot]] = p.sensed
    aside = gaps.min(axis=2)
    inside = (aside < p.in_way) & (along * _APART >= np.maximum(aside, _APART))
    inside &= np.hypot(*(there - way[0]).transpose(2, 0, 1)) <= limit[:, None]
    inside[:, robot] = False
    one, other = np.nonzero(inside)
    inside[one, other] = passages.sees(way[along[one, other]], there[one, other])
    order = np.where(inside, along, len(way))
    first: Indices = order.argmin(axis=1).astype(np.int32)
    first[~inside.any(axis=1)] = NOBODY
    return first
