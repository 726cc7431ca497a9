"""Who blocked whom, from when to when, where and why; and the pairs that were in a deadlock."""

from collections import Counter
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.instant import seconds
from observation.accounting.classify import CAUSES, Classified
from observation.accounting.episodes import Blocking, EpisodeParameters, runs
from observation.accounting.said import seconds_of
from observation.accounting.time_spent import BlockingEvent, Cause, DeadlockCount
from observation.accounting.tracks import Tracks
from observation.accounting.waiting import NOBODY

AT_DOOR: Final = "door"
ON_FLOOR: Final = "open floor"


def blocked_by_robots(classified: Classified) -> NDArray[np.bool_]:
    """(steps, robots): it stands, and another robot is why."""
    blocked: NDArray[np.bool_] = classified.stood & (classified.before != NOBODY)
    return blocked


def events(tracks: Tracks, classified: Classified, p: EpisodeParameters) -> tuple[BlockingEvent, ...]:
    """Every blocking, by begin and robots: two of which one at least stands before the other.

    A while of at most `pause_s` in between does not part them, and what lasts no longer is none. A queue of
    three is two blockings.
    """
    patience = seconds(p.pause_s) // tracks.step_us
    found = sorted(
        (
            Blocking(pair, begin, end)
            for pair, mask in _pairs(classified, blocked_by_robots(classified)).items()
            for begin, end in runs(_bridged(mask, patience), patience)
        ),
        key=lambda one: (one.begin, one.robots),
    )
    return tuple(_event(tracks, classified, one) for one in found)


def deadlocks(tracks: Tracks, classified: Classified, p: EpisodeParameters) -> DeadlockCount:
    """Pairs that were in a deadlock for `deadlock_s` or longer, and how many came free before the end."""
    patience, least = (seconds(each) // tracks.step_us for each in (p.pause_s, p.deadlock_s))
    steps, pairs, free = len(tracks.true), 0, 0
    for mask in _pairs(classified, classified.ring & classified.is_(Cause.DEADLOCK)).values():
        for episode in runs(_bridged(mask, patience), least):
            pairs += 1
            free += episode.end < steps
    return DeadlockCount(pairs, free)


def _pairs(classified: Classified, where: NDArray[np.bool_]) -> dict[tuple[int, int], NDArray[np.bool_]]:
    """For each two robots, the steps in which one of them stands before the other; none: not there."""
    found: dict[tuple[int, int], NDArray[np.bool_]] = {}
    for robot in range(where.shape[1]):
        for other in np.unique(classified.before[where[:, robot], robot]).tolist():
            mask = where[:, robot] & (classified.before[:, robot] == other)
            pair = (min(robot, other), max(robot, other))
            found[pair] = found[pair] | mask if pair in found else mask
    return found


def _bridged(mask: NDArray[np.bool_], patience: int) -> NDArray[np.bool_]:
    """The mask with gaps of at most `patience` samples between two stretches closed."""
    whole = mask.copy()
    stretches = runs(mask)
    for one, after in pairwise(stretches):
        if after.begin - one.end <= patience:
            whole[one.end : after.begin] = True
    return whole


def _event(tracks: Tracks, classified: Classified, one: Blocking) -> BlockingEvent:
    during = np.s_[one.begin : one.end, list(one.robots)]
    others = np.array(one.robots[::-1])
    blocked = blocked_by_robots(classified)[during] & (classified.before[during] == others)
    causes = Counter(classified.causes[during][blocked].tolist())
    doors = classified.at_door[during][blocked]
    middle = tracks.true[one.end - 1, list(one.robots), :2].mean(axis=0)
    return BlockingEvent(
        begin_s=seconds_of(tracks, one.begin),
        end_s=seconds_of(tracks, one.end),
        robots=tuple(tracks.robots[robot] for robot in one.robots),
        x=round(float(middle[0]), 3),
        y=round(float(middle[1]), 3),
        place=AT_DOOR if 2 * int(doors.sum()) > doors.size else ON_FLOOR,
        cause=CAUSES[max(causes, key=lambda cause: (causes[cause], -cause))].value,
        at_end=one.end == len(tracks.true),
    )
