"""Each step of each robot by what its time went into, from ground truth; the order of `Cause` decides.

A robot that stands, or moves to and fro, waits for the first robot on its way, and that for the next one. The
last one of the chain says what all of its time went into; where there is no last one, it is a deadlock.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.explanation import robot_states
from acrc_testbed.explanation.episodes import (
    STANDARD,
    EpisodeParameters,
    runs,
)
from acrc_testbed.explanation.robot_states import NOBODY, Flags, RobotStates, in_wall
from acrc_testbed.explanation.time_spent import BlockingEvent, Cause, DeadlockCount, Finding
from acrc_testbed.explanation.true_floor import Passages, TrueFloor
from acrc_testbed.run_model.data import RunData
from actors.instant import seconds


class Roots(NamedTuple):
    """Where the chains of all robots end."""

    root: NDArray[np.int32]
    """(steps, robots): where its chain ends, itself if it waits for nobody; NOBODY: in a ring."""
    ring: NDArray[np.bool_]
    """(steps, robots): it is in a ring itself."""
    at_door: NDArray[np.bool_]
    """(steps, robots): its chain leads through a door, or up to one."""


def roots(before: NDArray[np.int32], at_door: NDArray[np.bool_]) -> Roots:
    """Both (steps, robots): `before`: for whom each waits, NOBODY: for none; `at_door`: it does so at one."""
    root = np.where(before == NOBODY, np.arange(before.shape[1], dtype=np.int32), np.int32(NOBODY))
    doors = at_door & (before != NOBODY)
    while True:
        rows, robots = np.nonzero(root == NOBODY)
        fronts = before[rows, robots]
        joined = root[rows, fronts] != NOBODY
        if not joined.any():
            break
        rows, robots, fronts = rows[joined], robots[joined], fronts[joined]
        root[rows, robots] = root[rows, fronts]
        doors[rows, robots] |= doors[rows, fronts]
    return Roots(root, _rings(root == NOBODY, before), doors)


def behind(marked: NDArray[np.bool_], before: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(steps, robots): those that are marked, and all whose chain leads to one of them."""
    whole = marked.copy()
    while True:
        rows, robots = np.nonzero(~whole & (before != NOBODY))
        joins = whole[rows, before[rows, robots]]
        if not joins.any():
            return whole
        whole[rows[joins], robots[joins]] = True


def _rings(left: NDArray[np.bool_], before: NDArray[np.int32]) -> NDArray[np.bool_]:
    """What is left once nobody waits for nobody: of chains into a ring the ring alone."""
    ring = left.copy()
    while True:
        rows, robots = np.nonzero(ring)
        awaited = np.zeros_like(ring)
        awaited[rows, before[rows, robots]] = True
        if (ring == (ring & awaited)).all():
            return ring
        ring &= awaited


CAUSES: Final = tuple(Cause)
_NONE: Final = 255
Causes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Classified:
    """What every step of every robot went into."""

    causes: Causes
    """(steps, robots): index in CAUSES."""
    before: NDArray[np.int32]
    """(steps, robots): the robot for which it waits, NOBODY if none is why."""
    root: NDArray[np.int32]
    """(steps, robots): at which the chain of those ends; itself if it waits for nobody, NOBODY in a ring."""
    ring: Flags
    """(steps, robots): it is in a ring of robots that wait for one another."""
    stood: Flags
    """(steps, robots): it stood, not on purpose, although it wanted to be elsewhere, whatever the cause."""
    at_door: Flags
    """(steps, robots): it waited for a robot, and one of the two was in or at a door."""

    def is_(self, *wanted: Cause) -> Flags:
        """(steps, robots): where one of these is the cause."""
        return np.isin(self.causes, [CAUSES.index(cause) for cause in wanted])


def classify(
    run: RunData,
    floor: TrueFloor,
    parameters: EpisodeParameters = STANDARD,
) -> Classified:
    """What every robot's time went into."""
    states = RobotStates(run, floor.stages(), parameters)
    own = _own(states, in_wall(run, floor.grid))
    stuck = (states.waits | states.loops | states.planless) & (own == _NONE)
    before = robot_states.ahead(states, stuck, floor.passages, parameters)
    barred = _barred(states, stuck, before, parameters)
    alone = stuck & states.waits & (before == NOBODY) & (barred == _NONE)
    near = robot_states.beside(states, alone, floor.passages, parameters)
    before = np.where(alone, near, before)
    causes, found = _followed(states, own, before, barred, _doors(run, before, floor.passages, parameters))
    stood = ((states.waits & (before != NOBODY)) | states.long_waits) & ~states.paused
    return Classified(causes, before, found.root, found.ring, stood, found.at_door)


def _own(states: RobotStates, walled: Flags) -> Causes:
    """What holds of a robot whoever is in its way; _NONE: nothing does."""
    own = np.full(states.on.shape, _NONE, np.uint8)
    for cause, where in (
        (Cause.NO_PLAN, walled & states.wants),
        (Cause.ON_PURPOSE, states.paused),
        (Cause.STRATEGY_IDLE, states.asleep),
        (Cause.LOST, states.lost),
        (Cause.IDLE, states.done),
        (Cause.OFF, ~states.on),
        (Cause.FROZEN, states.frozen),
    ):  # the last one wins
        own[where] = CAUSES.index(cause)
    return own


def _barred(states: RobotStates, stuck: Flags, before: NDArray[np.int32], p: EpisodeParameters) -> Causes:
    """CLOSED_DOOR or UNREACHABLE where no way leads to the goal, or a closed door is on it; else _NONE."""
    found = np.full(stuck.shape, _NONE, np.uint8)
    closed, unreachable = CAUSES.index(Cause.CLOSED_DOOR), CAUSES.index(Cause.UNREACHABLE)
    for robot in range(stuck.shape[1]):
        for rows, goal, stage in states.pursuits(robot, stuck[:, robot]):
            if goal is None:
                continue
            here = states.run.true[rows, robot, :2]
            no_way = ~np.isfinite(stage.ways.far(here, goal))
            found[rows[no_way], robot] = closed
            found[rows[no_way & ~np.isfinite(stage.opened.far(here, goal))], robot] = unreachable
            if len(stage.leaves):
                first = rows[~no_way & (before[rows, robot] == NOBODY)]
                for step in first[_leads_through(states, robot, first, goal, p)].tolist():
                    found[step, robot] = closed
    return found


def _leads_through(
    states: RobotStates, robot: int, rows: NDArray[np.int64], goal: tuple[float, float], p: EpisodeParameters
) -> Flags:
    """(rows,): a closed door fills the way that it would go if all were open, before it has gone far."""
    found = np.zeros(len(rows), np.bool_)
    here = states.run.true[rows, robot, :2]
    for number in np.unique(states.stage[rows]).tolist():
        stage, same = states.stages[number], states.stage[rows] == number
        squares, which = np.unique(stage.opened.squares(here), axis=0, return_inverse=True)
        for square in range(len(squares)):
            inside = same & (which.reshape(-1) == square)
            if inside.any():
                x, y = here[inside.argmax()].tolist()
                way = stage.opened.way((x, y), goal, p.seen)
                if way is not None:
                    gaps = np.hypot(*(way[:, None] - stage.leaves).transpose(2, 0, 1))
                    found[inside] = gaps.min() <= p.still
    return found


def _doors(run: RunData, before: NDArray[np.int32], passages: Passages, p: EpisodeParameters) -> Flags:
    """(steps, robots): it waits, and one of the two, or their middle, is in or just before a door."""
    doors = np.zeros(before.shape, np.bool_)
    rows, robots = np.nonzero(before != NOBODY)
    if rows.size:
        one, other = run.true[rows, robots, :2], run.true[rows, before[rows, robots], :2]
        at = passages.at(np.concatenate([one, other, (one + other) / 2]), p.beside)
        doors[rows, robots] = np.any(at.reshape(3, -1), axis=0)
    return doors


def _followed(
    states: RobotStates, own: Causes, before: NDArray[np.int32], barred: Causes, doors: Flags
) -> tuple[Causes, Roots]:
    """The cause of everybody, from the roots of all chains."""
    is_barred = barred != _NONE
    found = roots(before, doors)
    before = np.where(found.ring & is_barred, NOBODY, before)  # who gets nowhere anyway is no part of a ring
    found = roots(before, doors)
    alone = _alone(states, own, barred)
    causes = alone.copy()
    rows, robots = np.nonzero((before != NOBODY) & (found.root != NOBODY))
    root = found.root[rows, robots]
    at_root = np.where(_stays(states, own)[rows, root], alone[rows, root], CAUSES.index(Cause.DRIVING))
    causes[rows, robots] = _BEHIND[at_root]
    gets_on = causes == CAUSES.index(Cause.OPEN_FLOOR)
    causes[gets_on & found.at_door] = CAUSES.index(Cause.DOOR)
    causes[gets_on & states.loops] = CAUSES.index(Cause.LIVELOCK)
    waits = before != NOBODY
    vague = waits & is_barred & np.isin(causes, [CAUSES.index(cause) for cause in _VAGUE])
    causes[vague] = barred[vague]
    in_ring = waits & (found.root == NOBODY)
    moving = behind(found.ring & states.roams, np.where(in_ring, before, NOBODY))
    causes[in_ring] = CAUSES.index(Cause.DEADLOCK)
    causes[in_ring & moving] = CAUSES.index(Cause.LIVELOCK)
    return causes, found


_BEHIND: Final = np.array(
    [
        CAUSES.index(
            {
                Cause.OFF: Cause.BY_DEAD,
                Cause.FROZEN: Cause.BY_DEAD,
                Cause.IDLE: Cause.DONE_IN_WAY,
                Cause.DRIVING: Cause.OPEN_FLOOR,
            }.get(cause, cause)
        )
        for cause in CAUSES
    ],
    np.uint8,
)
"""By the cause of the last one of a chain, that of those who wait."""
_VAGUE: Final = (Cause.DOOR, Cause.OPEN_FLOOR, Cause.NO_PROGRESS, Cause.NO_PLAN, Cause.LIVELOCK)
"""Whoever waits for such a robot, and has no way anyway, waits for the way."""


def _alone(states: RobotStates, own: Causes, barred: Causes) -> Causes:
    """What everybody's time would go into if nobody else was there."""
    causes = np.full(own.shape, CAUSES.index(Cause.DRIVING), np.uint8)
    causes[states.long_waits] = CAUSES.index(Cause.NO_PROGRESS)
    causes[states.loops] = CAUSES.index(Cause.LIVELOCK)
    causes[states.planless] = CAUSES.index(Cause.NO_PLAN)
    causes = np.where(barred != _NONE, barred, causes)
    return np.where(own != _NONE, own, causes)


def _stays(states: RobotStates, own: Causes) -> Flags:
    """(steps, robots): who is waited for will not get out of the way soon."""
    ended = np.isin(own, [CAUSES.index(cause) for cause in (Cause.OFF, Cause.FROZEN)])
    stays: Flags = states.still | states.loops | ended
    return stays


AT_DOOR: Final = "door"
ON_FLOOR: Final = "open floor"


def blocked_by_robots(classified: Classified) -> NDArray[np.bool_]:
    """(steps, robots): it stands, and another robot is why."""
    blocked: NDArray[np.bool_] = classified.stood & (classified.before != NOBODY)
    return blocked


def blocking_events(run: RunData, classified: Classified, p: EpisodeParameters) -> tuple[BlockingEvent, ...]:
    """Every blocking, by begin and robots: two of which one at least stands before the other.

    A while of at most `pause_s` in between does not part them, and what lasts no longer is none. A queue of
    three is two blockings.
    """
    patience = seconds(p.pause_s) // run.step_us
    found = [
        (begin, pair, end)
        for pair, mask in _pairs(classified, blocked_by_robots(classified)).items()
        for begin, end in runs(_bridged(mask, patience), patience)
    ]
    return tuple(_event(run, classified, pair, begin, end) for begin, pair, end in sorted(found))


def deadlocks(run: RunData, classified: Classified, p: EpisodeParameters) -> DeadlockCount:
    """Pairs that were in a deadlock for `deadlock_s` or longer, and how many came free before the end."""
    patience, least = (seconds(each) // run.step_us for each in (p.pause_s, p.deadlock_s))
    steps, pairs, free = len(run.true), 0, 0
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


def _event(
    run: RunData, classified: Classified, pair: tuple[int, int], begin: int, end: int
) -> BlockingEvent:
    during = np.s_[begin:end, list(pair)]
    others = np.array(pair[::-1])
    blocked = blocked_by_robots(classified)[during] & (classified.before[during] == others)
    causes = Counter(classified.causes[during][blocked].tolist())
    doors = classified.at_door[during][blocked]
    middle = run.true[end - 1, list(pair), :2].mean(axis=0)
    return BlockingEvent(
        begin_s=run.duration(begin),
        end_s=run.duration(end),
        robots=tuple(run.robots[robot] for robot in pair),
        x=round(float(middle[0]), 3),
        y=round(float(middle[1]), 3),
        place=AT_DOOR if 2 * int(doors.sum()) > doors.size else ON_FLOOR,
        cause=CAUSES[max(causes, key=lambda cause: (causes[cause], -cause))].value,
        at_end=end == len(run.true),
    )


NO_CONTACT: Final = "no contact"
CARRIED: Final = "carried"
_FRAMES: Final = 3
"""Who has given so many frames to its radio in a while wants to be heard."""


def findings(run: RunData, passages: Passages, p: EpisodeParameters) -> tuple[Finding, ...]:
    """All there are."""
    return (*_silent(run, passages, p), *_carried(run, p))


def _silent(run: RunData, passages: Passages, p: EpisodeParameters) -> Iterator[Finding]:
    """Robots that heard nobody for a while in which others within reach had something to send.

    Whether these sent it does not matter: whoever finds the channel taken all the time does not.
    """
    least = seconds(p.silent_s) // run.step_us
    for index, robot in enumerate(run.robots):
        deaf = run.stepping[:, index] & (run.frames_heard[:, index] == 0)
        for begin, end in runs(deaf, least):
            near = _within_reach(run, index, begin, end, passages, p)
            if near:
                since, until = run.duration(begin), run.duration(end)
                jam = _jam(run, index, begin, end)
                says = (
                    f"{robot} heard nobody from {since:g} s to {until:g} s, with {', '.join(near)} within "
                    f"{p.contact:g} m{jam}"
                )
                yield Finding(NO_CONTACT, (robot,), says)


def _within_reach(
    run: RunData,
    index: int,
    begin: int,
    end: int,
    passages: Passages,
    p: EpisodeParameters,
) -> list[str]:
    """The robots that were near all of this while, and had frames to send."""
    here = run.true[begin:end, index, :2]
    found = []
    for other, name in enumerate(run.robots):
        there = run.true[begin:end, other, :2]
        if other == index or run.frames_sent[begin:end, other].sum() < _FRAMES:
            continue
        if bool((np.hypot(*(there - here).T) <= p.contact).all() and passages.sees(here, there).all()):
            found.append(name)
    return found


def _jam(run: RunData, index: int, begin: int, end: int) -> str:
    """For how long of the while the robot was within a jammer's reach, in words."""
    begins = np.arange(begin, end) * run.step_us
    within = np.zeros(end - begin, np.bool_)
    for since, jam in run.jams:
        gaps = np.hypot(*(run.true[begin:end, index, :2] - (jam.x, jam.y)).T)
        within |= (gaps <= jam.radius) & (begins >= round(since * 1e6)) & (begins < jam.until)
    return f"; for {run.duration(int(within.sum())):g} s within a jammer's reach" if within.any() else ""


def _carried(run: RunData, p: EpisodeParameters) -> Iterator[Finding]:
    """Robots that were somewhere else from one step to the next."""
    hops = np.hypot(*np.moveaxis(np.diff(run.true[..., :2], axis=0), -1, 0))
    for index, robot in enumerate(run.robots):
        for step in np.flatnonzero(hops[:, index] > p.jump).tolist():
            at = run.duration(step + 1)
            yield Finding(CARRIED, (robot,), f"{robot} was carried {hops[step, index]:.1f} m at {at:g} s")
