"""Findings over several robots: blockings, deadlocks, robots without contact, robots that were carried."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import seconds
from observation.accounting.classify import CAUSES, Classified
from observation.accounting.robot_states import NOBODY
from observation.accounting.time_spent import BlockingEvent, Cause, DeadlockCount, Finding
from observation.accounting.tracks import Blocking, EpisodeParameters, Tracks, runs, seconds_of
from observation.accounting.true_floor import Passages

AT_DOOR: Final = "door"
ON_FLOOR: Final = "open floor"


def blocked_by_robots(classified: Classified) -> NDArray[np.bool_]:
    """(steps, robots): it stands, and another robot is why."""
    blocked: NDArray[np.bool_] = classified.stood & (classified.before != NOBODY)
    return blocked


def blocking_events(
    tracks: Tracks, classified: Classified, p: EpisodeParameters
) -> tuple[BlockingEvent, ...]:
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


NO_CONTACT: Final = "no contact"
CARRIED: Final = "carried"
_FRAMES: Final = 3
"""Who has given so many frames to its radio in a while wants to be heard."""


class FrameCounts(NamedTuple):
    """Of the frames of all robots, (steps, robots) each."""

    sent: NDArray[np.int64]
    """Given to the radio, whether that sent them or not."""
    heard: NDArray[np.int64]


def findings(
    tracks: Tracks, frames: FrameCounts, passages: Passages, p: EpisodeParameters
) -> tuple[Finding, ...]:
    """All there are."""
    return (*_silent(tracks, frames, passages, p), *_carried(tracks, p))


def _silent(
    tracks: Tracks, frames: FrameCounts, passages: Passages, p: EpisodeParameters
) -> Iterator[Finding]:
    """Robots that heard nobody for a while in which others within reach had something to send.

    Whether these sent it does not matter: whoever finds the channel taken all the time does not.
    """
    least = seconds(p.silent_s) // tracks.step_us
    for index, robot in enumerate(tracks.robots):
        deaf = tracks.stepping[:, index] & (frames.heard[:, index] == 0)
        for begin, end in runs(deaf, least):
            near = _within_reach(tracks, index, begin, end, frames, passages, p)
            if near:
                since, until = seconds_of(tracks, begin), seconds_of(tracks, end)
                jam = _jam(tracks, index, begin, end)
                says = (
                    f"{robot} heard nobody from {since:g} s to {until:g} s, with {', '.join(near)} within "
                    f"{p.contact:g} m{jam}"
                )
                yield Finding(NO_CONTACT, (robot,), says)


def _within_reach(
    tracks: Tracks,
    index: int,
    begin: int,
    end: int,
    frames: FrameCounts,
    passages: Passages,
    p: EpisodeParameters,
) -> list[str]:
    """The robots that were near all of this while, and had frames to send."""
    here = tracks.true[begin:end, index, :2]
    found = []
    for other, name in enumerate(tracks.robots):
        there = tracks.true[begin:end, other, :2]
        if other == index or frames.sent[begin:end, other].sum() < _FRAMES:
            continue
        if bool((np.hypot(*(there - here).T) <= p.contact).all() and passages.sees(here, there).all()):
            found.append(name)
    return found


def _jam(tracks: Tracks, index: int, begin: int, end: int) -> str:
    """For how long of the while the robot was within a jammer's reach, in words."""
    begins = np.arange(begin, end) * tracks.step_us
    within = np.zeros(end - begin, np.bool_)
    for since, jam in tracks.jams:
        gaps = np.hypot(*(tracks.true[begin:end, index, :2] - (jam.x, jam.y)).T)
        within |= (gaps <= jam.radius) & (begins >= since) & (begins < jam.until)
    return (
        f"; for {seconds_of(tracks, int(within.sum())):g} s within a jammer's reach" if within.any() else ""
    )


def _carried(tracks: Tracks, p: EpisodeParameters) -> Iterator[Finding]:
    """Robots that were somewhere else from one step to the next."""
    hops = np.hypot(*np.moveaxis(np.diff(tracks.true[..., :2], axis=0), -1, 0))
    for index, robot in enumerate(tracks.robots):
        for step in np.flatnonzero(hops[:, index] > p.jump).tolist():
            at = seconds_of(tracks, step + 1)
            yield Finding(CARRIED, (robot,), f"{robot} was carried {hops[step, index]:.1f} m at {at:g} s")
