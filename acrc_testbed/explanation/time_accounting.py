"""Time accounting of a simulated run: causes per robot, decisions with outcomes, self-diagnosis."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from acrc_testbed.explanation.cause_classification import (
    CauseTable,
    blocking_events,
    classify,
    deadlocks,
    findings,
)
from acrc_testbed.explanation.episodes import STANDARD, interval_mask, true_intervals
from acrc_testbed.explanation.robot_states import NO_ROBOT
from acrc_testbed.explanation.time_spent import (
    ChainRoot,
    DecisionEvent,
    DiagnosisScore,
    KnowledgeUse,
    TimeSpent,
)
from acrc_testbed.explanation.true_floor import TrueFloor
from acrc_testbed.recordings.run_recordings import all_recordings
from acrc_testbed.run_model.data import RobotReport, RunData, RunDataError
from acrc_testbed.run_model.floor import NO_CHANGES
from acrc_testbed.run_model.simulated_runs import read_run
from actors.array_types import Flags, Floats
from actors.instant import in_seconds
from actors.robot.behaviour.decisions import AdaptationDecision

VISITED = "visited"
FREE = "free"
AGAIN = "blocked again"
SUPERSEDED = "superseded"
END = "end"


def decision_events(run: RunData, classified: CauseTable) -> tuple[DecisionEvent, ...]:
    """Return all listed decisions by instant and robot."""
    found = [
        event
        for index, robot in enumerate(run.robots)
        for event in _robot_events(run, index, run.reports.get(robot, RobotReport()).decisions, classified)
    ]
    return tuple(sorted(found, key=lambda one: (one.instant_s, one.robot)))


def _robot_events(
    run: RunData,
    index: int,
    decisions: Sequence[AdaptationDecision],
    classified: CauseTable,
) -> Iterator[DecisionEvent]:
    stood = classified.stood[:, index]
    for number, decision in enumerate(decisions):
        first = run.index(decision.instant)
        after = [run.index(one.instant) for one in decisions[number + 1 :] if one.instant > decision.instant]
        last = min(after, default=len(stood))
        outcome, free = _outcome(run.true[first:last, index, :2], stood[first:last], decision)
        if outcome == SUPERSEDED and last == len(stood):
            outcome = END
        before = _standing_steps(stood[: first + 1])
        yield DecisionEvent(
            robot=run.robots[index],
            instant_s=in_seconds(decision.instant),
            trigger=decision.by,
            words=decision.words,
            knowledge=(KnowledgeUse(decision.source, in_seconds(decision.age)),),
            old_goal=decision.old,
            new_goal=decision.new,
            outcome=outcome,
            blocked_s=run.duration(before),
            free_after_s=run.duration(free) if before and free is not None else None,
        )


def _outcome(path: Floats, stood: Flags, decision: AdaptationDecision) -> tuple[str, int | None]:
    """Return the outcome until the next decision, and the number of steps until the robot moved again."""
    moves = np.flatnonzero(~stood)
    free = int(moves[0]) if moves.size else None
    if decision.new is not None:
        offset = path - np.array(decision.new)
        if bool((np.hypot(offset[:, 0], offset[:, 1]) <= STANDARD.visit_radius).any()):
            return VISITED, free
    if free is None:
        return SUPERSEDED, None
    return (AGAIN if stood[free:].any() else FREE), free


def _standing_steps(stood: Flags) -> int:
    """Return the number of steps that the robot has stood at the end."""
    moves = np.flatnonzero(~stood)
    return len(stood) - (int(moves[-1]) + 1 if moves.size else 0)


def diagnosis_score(run: RunData, classified: CauseTable) -> DiagnosisScore | None:
    """Return the score of all robots that detect blocking; None if none does.

    A robot is truly blocked while it stands with a goal, whatever the cause, unless it waits on purpose.
    """
    both = found = true = count = noticed = false_alarms = 0
    delays: list[float] = []
    has_detection = False
    for index, robot in enumerate(run.robots):
        blocked = run.reports.get(robot, RobotReport()).blocked
        if blocked is None:
            continue
        has_detection = True
        detected, blocked_now = interval_mask(blocked, run), classified.stood[:, index]
        both += int((detected & blocked_now).sum())
        found += int(detected.sum())
        true += int(blocked_now.sum())
        false_alarms += sum(not blocked_now[begin:end].any() for begin, end in true_intervals(detected))
        for begin, end in true_intervals(blocked_now):
            count += 1
            if detected[begin:end].any():
                noticed += 1
                delays.append(run.duration(int(detected[begin:end].argmax())))
    if not has_detection:
        return None
    return DiagnosisScore(
        precision=round(both / found, 4) if found else None,
        recall=round(both / true, 4) if true else None,
        delay_s=round(median(delays), 3) if delays else None,
        spells=count,
        noticed=noticed,
        false_alarms=false_alarms,
    )


class RunCauses(NamedTuple):
    """Floor of a run, and the cause of each step of each robot."""

    floor: TrueFloor
    causes: CauseTable


def determine_causes(run: RunData) -> RunCauses:
    """Determine the cause of each step of each robot; without its reports, from ground truth alone.

    Raises RunDataError if changes of the floor were not recorded.
    """
    if not run.records_floor:
        raise RunDataError(f"{run.out}: causes are unknown: {NO_CHANGES}")
    changes = [(round(second * 1e6) // run.step_us, state) for second, state in run.floor]
    floor = TrueFloor(run.grid, run.description.radius, changes)
    return RunCauses(floor, classify(run, floor))


def account_time(out: Path) -> TimeSpent:
    """Return the time accounting of the run in a folder.

    Raises RunDataError if it is not a simulated run, RecordingError or OutcomeError if it is damaged.
    """
    all_recordings(out)
    run = read_run(out)
    floor, classified = determine_causes(run)
    return TimeSpent(
        robots=_seconds_by_cause(run, classified),
        blockings=blocking_events(run, classified),
        diagnosis=diagnosis_score(run, classified),
        decisions=decision_events(run, classified),
        decisions_left_out=sum(one.unlisted for one in run.reports.values()),
        findings=findings(run, floor.passages),
        deadlocks=deadlocks(run, classified),
        blames=_chain_roots(run, classified),
    )


def _seconds_by_cause(run: RunData, classified: CauseTable) -> dict[str, dict[str, float]]:
    """Return seconds by robot and cause, from whole µs; those of a robot sum to the run's duration."""
    spent = {}
    for index, robot in enumerate(run.robots):
        steps = np.bincount(classified.causes[:, index], minlength=len(classified.names)).tolist()
        spent[robot] = {
            str(cause): in_seconds(count * run.step_us)
            for cause, count in zip(classified.names, steps, strict=True)
        }
    return spent


def _chain_roots(run: RunData, classified: CauseTable) -> tuple[ChainRoot, ...]:
    """Return the waiting time per root and cause, s, from whole µs."""
    waits = (classified.before != NO_ROBOT) & (classified.root != NO_ROBOT)
    pairs = np.column_stack([classified.root[waits], classified.causes[waits]])
    kinds, counts = np.unique(pairs, axis=0, return_counts=True)
    return tuple(
        ChainRoot(run.robots[root], str(classified.names[cause]), in_seconds(count * run.step_us))
        for (root, cause), count in zip(kinds.tolist(), counts.tolist(), strict=True)
    )


class CauseInterval(NamedTuple):
    """Interval of one robot with one cause."""

    robot: str
    cause: str
    """A `Cause`, or one that the task declares."""
    begin: float
    """Simulated s."""
    end: float
    x: float
    """True position in the middle of the interval, m."""
    y: float


def cause_intervals(run: RunData) -> list[CauseInterval]:
    """Return the intervals of all causes without gaps, by robot and time. Raises as `determine_causes`."""
    classified = determine_causes(run).causes
    found: list[CauseInterval] = []
    for index, robot in enumerate(run.robots):
        own = classified.causes[:, index]
        edges = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(own)]
        for begin, end in pairwise(edges):
            x, y = run.true[(begin + end) // 2, index, :2].tolist()
            until = run.end if end == len(own) else float(run.seconds[end])
            found.append(
                CauseInterval(robot, classified.names[own[begin]], float(run.seconds[begin]), until, x, y)
            )
    return found
