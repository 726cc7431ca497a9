"""Cause of each step of each robot, from ground truth; the first `Cause` that applies counts.

A robot without progress waits for the first robot on its path, which may wait for another one. All robots of
such a chain have the cause of its last robot, the root; a ring has no root and is a deadlock.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import msgspec
import numpy as np

from acrc_testbed.explanation import robot_states
from acrc_testbed.explanation.episodes import STANDARD, true_intervals
from acrc_testbed.explanation.robot_states import NO_ROBOT, RobotStates, estimates_in_walls
from acrc_testbed.explanation.time_spent import BlockingEvent, Cause, DeadlockCount, Finding
from acrc_testbed.explanation.true_floor import Passages, TrueFloor
from acrc_testbed.run_model.data import RunData
from actors.array_types import Flags, Int32s, Int64s, Octets
from actors.instant import seconds


class Roots(NamedTuple):
    """Roots of the chains of all robots; (steps, robots) each."""

    root: Int32s
    """Root of the robot's chain, itself if it does not wait; NO_ROBOT: the chain ends in a ring."""
    ring: Flags
    """The robot is part of a ring."""
    at_door: Flags
    """The chain leads through a door or up to one."""


def roots(before: Int32s, at_door: Flags) -> Roots:
    """Find the roots of all chains.

    `before`: robot that each waits for, or NO_ROBOT; `at_door`: where it waits at a door; (steps, robots).
    """
    root = np.where(before == NO_ROBOT, np.arange(before.shape[1], dtype=np.int32), np.int32(NO_ROBOT))
    doors = at_door & (before != NO_ROBOT)
    while True:
        rows, robots = np.nonzero(root == NO_ROBOT)
        fronts = before[rows, robots]
        joined = root[rows, fronts] != NO_ROBOT
        if not joined.any():
            break
        rows, robots, fronts = rows[joined], robots[joined], fronts[joined]
        root[rows, robots] = root[rows, fronts]
        doors[rows, robots] |= doors[rows, fronts]
    return Roots(root, _ring_members(root == NO_ROBOT, before), doors)


def with_waiting_robots(marked: Flags, before: Int32s) -> Flags:
    """Return the marked robots and all robots that wait for them, (steps, robots)."""
    reached = marked.copy()
    while True:
        rows, robots = np.nonzero(~reached & (before != NO_ROBOT))
        joins = reached[rows, before[rows, robots]]
        if not joins.any():
            return reached
        reached[rows[joins], robots[joins]] = True


def _ring_members(rootless: Flags, before: Int32s) -> Flags:
    """Reduce the robots without a root to those that are part of a ring."""
    ring = rootless.copy()
    while True:
        rows, robots = np.nonzero(ring)
        awaited = np.zeros_like(ring)
        awaited[rows, before[rows, robots]] = True
        if (ring == (ring & awaited)).all():
            return ring
        ring &= awaited


CAUSES: Final = tuple(Cause)
_NUMBERS: Final = {cause: number for number, cause in enumerate(CAUSES)}
_UNDECIDED: Final = 255
_MOST_OWN: Final = 100
"""Most causes of a task, as a recording may declare any number."""
Causes = Octets


class CauseTable(msgspec.Struct, frozen=True, eq=False):
    """Causes of all steps of all robots; (steps, robots) each."""

    causes: Causes
    """Index in `names`."""
    before: Int32s
    """The robot that it waits for, or NO_ROBOT."""
    root: Int32s
    """Root of its chain, itself if it does not wait; NO_ROBOT: the chain ends in a ring."""
    ring: Flags
    """It is part of a ring of robots that wait for each other."""
    stood: Flags
    """It stood with a goal, not on purpose, whatever the cause."""
    at_door: Flags
    """It waited for a robot, and its chain leads through a door or up to one."""
    names: tuple[str, ...] = CAUSES
    """CAUSES, then those of the task."""


def classify(
    run: RunData,
    floor: TrueFloor,
) -> CauseTable:
    """Determine the cause of each step of each robot."""
    states = RobotStates(run, floor.stages())
    own_names = [name for name in run.description.task.causes if name not in CAUSES]
    names = (*CAUSES, *own_names[:_MOST_OWN])
    task = _task_causes(run, names)
    own = _independent_causes(states, estimates_in_walls(run, floor.grid), task)
    stuck = (states.waits | states.moves_to_and_fro | states.planless) & (own == _UNDECIDED)
    before = robot_states.first_robots_ahead(states, stuck, floor.passages)
    barred = _floor_causes(states, stuck, before)
    alone = stuck & states.waits & (before == NO_ROBOT) & (barred == _UNDECIDED)
    near = robot_states.nearest_robots_beside(states, alone, floor.passages)
    before = np.where(alone, near, before)
    causes, found = _propagate_causes(states, own, before, barred, _at_door(run, before, floor.passages))
    stood = ((states.waits & (before != NO_ROBOT)) | states.stands_long) & ~states.paused
    stood &= task == _UNDECIDED
    return CauseTable(causes, before, found.root, found.ring, stood, found.at_door, names)


def _task_causes(run: RunData, names: Sequence[str]) -> Causes:
    """Return the task's causes by the events of its judge, (steps, robots); _UNDECIDED: none."""
    found = np.full(run.stepping.shape, _UNDECIDED, np.uint8)
    known = {"": _UNDECIDED} | {name: number for number, name in enumerate(names) if number >= len(CAUSES)}
    for event in run.task_events:
        if event.kind in known:
            found[max(event.instant // run.step_us, 0) :, run.robots.index(event.robot)] = known[event.kind]
    return found


def _independent_causes(states: RobotStates, walled: Flags, task: Causes) -> Causes:
    """Return the causes that do not depend on other robots; _UNDECIDED: none. `task`: the task's causes."""
    own = np.full(states.on.shape, _UNDECIDED, np.uint8)
    for cause, where in (
        (Cause.NO_PLAN, walled & states.wants),
        (Cause.ON_PURPOSE, states.paused),
        (Cause.STRATEGY_IDLE, states.strategy_idle),
        (Cause.LOST, states.lost),
        (Cause.IDLE, states.done),
    ):  # later rows override earlier ones
        own[where] = _NUMBERS[cause]
    own = np.where(task == _UNDECIDED, own, task)
    for cause, where in ((Cause.OFF, ~states.on), (Cause.FROZEN, states.frozen)):
        own[where] = _NUMBERS[cause]
    return own


def _floor_causes(states: RobotStates, stuck: Flags, before: Int32s) -> Causes:
    """Return CLOSED_DOOR or UNREACHABLE where the floor blocks the path to the goal; else _UNDECIDED."""
    causes = np.full(stuck.shape, _UNDECIDED, np.uint8)
    closed, unreachable = _NUMBERS[Cause.CLOSED_DOOR], _NUMBERS[Cause.UNREACHABLE]
    for robot in range(stuck.shape[1]):
        for rows, goal, stage in states.pursuits(robot, stuck[:, robot]):
            if goal is None:
                continue
            here = states.run.true[rows, robot, :2]
            no_path = ~np.isfinite(stage.paths.lengths(here, goal))
            causes[rows[no_path], robot] = closed
            causes[rows[no_path & ~np.isfinite(stage.opened.lengths(here, goal))], robot] = unreachable
            if len(stage.leaves):
                first = rows[~no_path & (before[rows, robot] == NO_ROBOT)]
                for step in first[_leads_through_closed_door(states, robot, first, goal)].tolist():
                    causes[step, robot] = closed
    return causes


def _leads_through_closed_door(
    states: RobotStates, robot: int, rows: Int64s, goal: tuple[float, float]
) -> Flags:
    """Return where a closed door is near on the path that would exist with open doors, (rows,)."""
    leads = np.zeros(len(rows), np.bool_)
    here = states.run.true[rows, robot, :2]
    for number in np.unique(states.stage[rows]).tolist():
        stage, same = states.stages[number], states.stage[rows] == number
        squares, groups = np.unique(stage.opened.squares(here), axis=0, return_inverse=True)
        for square in range(len(squares)):
            inside = same & (groups.reshape(-1) == square)
            if inside.any():
                x, y = here[inside.argmax()].tolist()
                path = stage.opened.path((x, y), goal, STANDARD.view_distance)
                if path is not None:
                    gaps = np.hypot(*(path[:, None] - stage.leaves).transpose(2, 0, 1))
                    leads[inside] = gaps.min() <= STANDARD.stand_radius
    return leads


def _at_door(run: RunData, before: Int32s, passages: Passages) -> Flags:
    """Return where a robot waits and one of the pair, or their midpoint, is at a door, (steps, robots)."""
    doors = np.zeros(before.shape, np.bool_)
    rows, robots = np.nonzero(before != NO_ROBOT)
    if rows.size:
        one, other = run.true[rows, robots, :2], run.true[rows, before[rows, robots], :2]
        at = passages.are_at_passage(np.concatenate([one, other, (one + other) / 2]), STANDARD.door_distance)
        doors[rows, robots] = np.any(at.reshape(3, -1), axis=0)
    return doors


def _propagate_causes(
    states: RobotStates, own: Causes, before: Int32s, barred: Causes, doors: Flags
) -> tuple[Causes, Roots]:
    """Derive the causes of all robots from the roots of their chains."""
    is_barred = barred != _UNDECIDED
    found = roots(before, doors)
    before = np.where(
        found.ring & is_barred, NO_ROBOT, before
    )  # without a path, a robot is not part of a ring
    found = roots(before, doors)
    alone = _single_causes(states, own, barred)
    causes = alone.copy()
    rows, robots = np.nonzero((before != NO_ROBOT) & (found.root != NO_ROBOT))
    root = found.root[rows, robots]
    at_root = np.where(_stays_put(states, own)[rows, root], alone[rows, root], _NUMBERS[Cause.DRIVING])
    causes[rows, robots] = np.where(
        at_root < len(CAUSES), _WAITING_CAUSE[np.minimum(at_root, len(CAUSES) - 1)], _OPEN_FLOOR
    )
    gets_on = causes == _OPEN_FLOOR
    causes[gets_on & found.at_door] = _NUMBERS[Cause.DOOR]
    causes[gets_on & states.moves_to_and_fro] = _NUMBERS[Cause.LIVELOCK]
    waits = before != NO_ROBOT
    vague = waits & is_barred & np.isin(causes, [_NUMBERS[cause] for cause in _OVERRIDABLE])
    causes[vague] = barred[vague]
    in_ring = waits & (found.root == NO_ROBOT)
    moving = with_waiting_robots(found.ring & states.drives_to_and_fro, np.where(in_ring, before, NO_ROBOT))
    causes[in_ring] = _NUMBERS[Cause.DEADLOCK]
    causes[in_ring & moving] = _NUMBERS[Cause.LIVELOCK]
    return causes, found


_OPEN_FLOOR: Final = _NUMBERS[Cause.OPEN_FLOOR]
_WAITING_CAUSE: Final = np.array(
    [
        _NUMBERS[
            {
                Cause.OFF: Cause.BY_DEAD,
                Cause.FROZEN: Cause.BY_DEAD,
                Cause.IDLE: Cause.DONE_IN_WAY,
                Cause.DRIVING: Cause.OPEN_FLOOR,
            }.get(cause, cause)
        ]
        for cause in CAUSES
    ],
    np.uint8,
)
"""Cause of the waiting robots of a chain, by the cause of its root; OPEN_FLOOR for causes of the task."""
_OVERRIDABLE: Final = (Cause.DOOR, Cause.OPEN_FLOOR, Cause.NO_PROGRESS, Cause.NO_PLAN, Cause.LIVELOCK)
"""Causes of waiting robots that a blocked path overrides."""


def _single_causes(states: RobotStates, own: Causes, barred: Causes) -> Causes:
    """Return the causes of single robots, without regard to others."""
    causes = np.full(own.shape, _NUMBERS[Cause.DRIVING], np.uint8)
    causes[states.stands_long] = _NUMBERS[Cause.NO_PROGRESS]
    causes[states.moves_to_and_fro] = _NUMBERS[Cause.LIVELOCK]
    causes[states.planless] = _NUMBERS[Cause.NO_PLAN]
    causes = np.where(barred != _UNDECIDED, barred, causes)
    return np.where(own != _UNDECIDED, own, causes)


def _stays_put(states: RobotStates, own: Causes) -> Flags:
    """Return where a robot stays in the way of others, (steps, robots)."""
    ended = np.isin(own, [_NUMBERS[cause] for cause in (Cause.OFF, Cause.FROZEN)])
    return states.stands | states.moves_to_and_fro | ended


AT_DOOR: Final = "door"
ON_FLOOR: Final = "open floor"


def blocked_by_robots(classified: CauseTable) -> Flags:
    """Return where a robot stands because of another one, (steps, robots)."""
    blocked: Flags = classified.stood & (classified.before != NO_ROBOT)
    return blocked


def blocking_events(run: RunData, classified: CauseTable) -> tuple[BlockingEvent, ...]:
    """Return all blockings by start and robots: pairs of which one or both wait for the other.

    Interruptions of up to `pause_s` are ignored, and so are shorter blockings. A queue of three is two
    blockings.
    """
    max_gap = seconds(STANDARD.pause_s) // run.step_us
    found = [
        (begin, pair, end)
        for pair, mask in _pairs(classified, blocked_by_robots(classified)).items()
        for begin, end in true_intervals(_close_gaps(mask, max_gap), max_gap)
    ]
    return tuple(_blocking_event(run, classified, pair, begin, end) for begin, pair, end in sorted(found))


def deadlocks(run: RunData, classified: CauseTable) -> DeadlockCount:
    """Count pairs in a deadlock of at least `deadlock_s`, and those resolved before the end."""
    max_gap, least = (seconds(each) // run.step_us for each in (STANDARD.pause_s, STANDARD.deadlock_s))
    steps, pairs, free = len(run.true), 0, 0
    in_deadlock = classified.ring & (classified.causes == _NUMBERS[Cause.DEADLOCK])
    for mask in _pairs(classified, in_deadlock).values():
        for episode in true_intervals(_close_gaps(mask, max_gap), least):
            pairs += 1
            free += episode.end < steps
    return DeadlockCount(pairs, free)


def _pairs(classified: CauseTable, where: Flags) -> dict[tuple[int, int], Flags]:
    """Return, for each pair with a blocking, the steps in which one waits for the other."""
    found: dict[tuple[int, int], Flags] = {}
    for robot in range(where.shape[1]):
        for other in np.unique(classified.before[where[:, robot], robot]).tolist():
            mask = where[:, robot] & (classified.before[:, robot] == other)
            pair = (min(robot, other), max(robot, other))
            found[pair] = found[pair] | mask if pair in found else mask
    return found


def _close_gaps(mask: Flags, max_gap: int) -> Flags:
    """Return the mask with gaps of at most `max_gap` samples closed."""
    closed = mask.copy()
    intervals = true_intervals(mask)
    for one, after in pairwise(intervals):
        if after.begin - one.end <= max_gap:
            closed[one.end : after.begin] = True
    return closed


def _blocking_event(
    run: RunData, classified: CauseTable, pair: tuple[int, int], begin: int, end: int
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
        cause=str(classified.names[max(causes, key=lambda cause: (causes[cause], -cause))]),
        at_end=end == len(run.true),
    )


NO_CONTACT: Final = "no contact"
CARRIED: Final = "carried"
_FRAMES: Final = 3
"""Minimum number of frames handed to the radio by a robot that should be received."""


def findings(run: RunData, passages: Passages) -> tuple[Finding, ...]:
    """Return all findings of a run."""
    return (*_contact_findings(run, passages), *_carry_findings(run))


def _contact_findings(run: RunData, passages: Passages) -> Iterator[Finding]:
    """Yield the intervals in which a robot received nothing although others in range had frames to send.

    Their frames need not have been sent: the channel may have been busy.
    """
    least = seconds(STANDARD.silent_s) // run.step_us
    for index, robot in enumerate(run.robots):
        without_reception = run.stepping[:, index] & (run.frames_heard[:, index] == 0)
        for begin, end in true_intervals(without_reception, least):
            near = _robots_in_range(run, index, begin, end, passages)
            if near:
                since, until = run.duration(begin), run.duration(end)
                jam = _jam_text(run, index, begin, end)
                says = (
                    f"{robot} received no frames from {since:g} s to {until:g} s, with {', '.join(near)} "
                    f"within {STANDARD.contact:g} m{jam}"
                )
                yield Finding(NO_CONTACT, (robot,), says)


def _robots_in_range(
    run: RunData,
    index: int,
    begin: int,
    end: int,
    passages: Passages,
) -> list[str]:
    """Return the robots that were in range during the whole interval and had frames to send."""
    here = run.true[begin:end, index, :2]
    found = []
    for other, name in enumerate(run.robots):
        there = run.true[begin:end, other, :2]
        if other == index or run.frames_sent[begin:end, other].sum() < _FRAMES:
            continue
        if bool(
            (np.hypot(*(there - here).T) <= STANDARD.contact).all()
            and passages.are_visible(here, there).all()
        ):
            found.append(name)
    return found


def _jam_text(run: RunData, index: int, begin: int, end: int) -> str:
    """Describe for how long the robot was in range of a jammer; "" if it was not."""
    begins = np.arange(begin, end) * run.step_us
    within = np.zeros(end - begin, np.bool_)
    for since, jam in run.jams:
        gaps = np.hypot(*(run.true[begin:end, index, :2] - (jam.x, jam.y)).T)
        within |= (gaps <= jam.radius) & (begins >= round(since * 1e6)) & (begins < jam.until)
    return f"; for {run.duration(int(within.sum())):g} s in range of a jammer" if within.any() else ""


def _carry_findings(run: RunData) -> Iterator[Finding]:
    """Yield robots that changed position between two steps."""
    hops = np.hypot(*np.moveaxis(np.diff(run.true[..., :2], axis=0), -1, 0))
    for index, robot in enumerate(run.robots):
        for step in np.flatnonzero(hops[:, index] > STANDARD.carry_distance).tolist():
            at = run.duration(step + 1)
            yield Finding(CARRIED, (robot,), f"{robot} was carried {hops[step, index]:.1f} m at {at:g} s")
