"""Time accounting of a simulated run: its causes per robot, decisions and their outcome, self-diagnosis."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from acrc_testbed.accounting.classify import (
    CAUSES,
    Classified,
    FrameCounts,
    blocking_events,
    classify,
    deadlocks,
    findings,
)
from acrc_testbed.accounting.robot_states import NOBODY
from acrc_testbed.accounting.time_spent import (
    Blame,
    Cause,
    DecisionEvent,
    DiagnosisScore,
    KnowledgeUsed,
    TimeSpent,
)
from acrc_testbed.accounting.tracks import (
    STANDARD,
    EpisodeParameters,
    Said,
    Tracks,
    during,
    runs,
    said_by,
    seconds_of,
    tracks_of,
)
from acrc_testbed.accounting.true_floor import TrueFloor
from acrc_testbed.evidence.run_evidence import RunEvidence, largest_radius
from acrc_testbed.evidence.run_reader import read_run
from acrc_testbed.replay.run_recordings import all_recordings, recordings
from actors.instant import in_seconds
from actors.robot.behaviour.decisions import AdaptationDecision

VISITED = "visited"
FREE = "free"
AGAIN = "blocked again"
OVERTAKEN = "overtaken"
END = "end"


def decision_events(
    tracks: Tracks, said: Mapping[str, Said], classified: Classified, p: EpisodeParameters
) -> tuple[DecisionEvent, ...]:
    """Every decision that was listed, by its instant and robot."""
    found = [
        event
        for index, robot in enumerate(tracks.robots)
        for event in _of_robot(tracks, index, said.get(robot, Said()), classified, p)
    ]
    return tuple(sorted(found, key=lambda one: (one.instant_s, one.robot)))


def _of_robot(
    tracks: Tracks, index: int, said: Said, classified: Classified, p: EpisodeParameters
) -> Iterator[DecisionEvent]:
    stood = classified.stood[:, index]
    made = said.decisions
    for number, decision in enumerate(made):
        first = tracks.index(decision.instant)
        after = [tracks.index(one.instant) for one in made[number + 1 :] if one.instant > decision.instant]
        last = min(after, default=len(stood))
        outcome, free = _outcome(tracks.true[first:last, index, :2], stood[first:last], decision, p)
        if outcome == OVERTAKEN and last == len(stood):
            outcome = END
        before = _stretch(stood[: first + 1])
        yield DecisionEvent(
            robot=tracks.robots[index],
            instant_s=in_seconds(decision.instant),
            trigger=decision.by,
            words=decision.words,
            knowledge=(KnowledgeUsed(decision.source, in_seconds(decision.age)),),
            old_goal=decision.old,
            new_goal=decision.new,
            outcome=outcome,
            blocked_s=seconds_of(tracks, before),
            free_after_s=seconds_of(tracks, free) if before and free is not None else None,
        )


def _outcome(
    way: NDArray[np.float64], stood: NDArray[np.bool_], decision: AdaptationDecision, p: EpisodeParameters
) -> tuple[str, int | None]:
    """What came of it until the next decision, and after how many steps the robot got on."""
    moves = np.flatnonzero(~stood)
    free = int(moves[0]) if moves.size else None
    if decision.new is not None:
        offset = way - np.array(decision.new)
        if bool((np.hypot(offset[:, 0], offset[:, 1]) <= p.fit).any()):
            return VISITED, free
    if free is None:
        return OVERTAKEN, None
    return (AGAIN if stood[free:].any() else FREE), free


def _stretch(stood: NDArray[np.bool_]) -> int:
    """For how many steps up to the last one it has stood."""
    moves = np.flatnonzero(~stood)
    return len(stood) - (int(moves[-1]) + 1 if moves.size else 0)


def diagnosis_score(
    tracks: Tracks, said: Mapping[str, Said], classified: Classified
) -> DiagnosisScore | None:
    """Over all robots that ask themselves whether they are blocked; None if none does.

    A robot is truly blocked while it stands although it wants to be elsewhere, whatever the cause; a robot
    that waits on purpose is not.
    """
    both = told = true = count = noticed = false_alarms = 0
    delays: list[float] = []
    asked = False
    for index, robot in enumerate(tracks.robots):
        blocked = said.get(robot, Said()).blocked
        if blocked is None:
            continue
        asked = True
        says, is_so = during(blocked, tracks), classified.stood[:, index]
        both, told, true = both + int((says & is_so).sum()), told + int(says.sum()), true + int(is_so.sum())
        false_alarms += sum(not is_so[begin:end].any() for begin, end in runs(says))
        for begin, end in runs(is_so):
            count += 1
            if says[begin:end].any():
                noticed += 1
                delays.append(seconds_of(tracks, int(says[begin:end].argmax())))
    if not asked:
        return None
    return DiagnosisScore(
        precision=round(both / told, 4) if told else None,
        recall=round(both / true, 4) if true else None,
        delay_s=round(median(delays), 3) if delays else None,
        spells=count,
        noticed=noticed,
        false_alarms=false_alarms,
    )


class Judged(NamedTuple):
    """A run, and what each step of each robot went into."""

    tracks: Tracks
    floor: TrueFloor
    said: Mapping[str, Said]
    causes: Classified


def judge(run: RunEvidence, parameters: EpisodeParameters = STANDARD) -> Judged:
    """What every robot's time went into. Raises RecordingError or OutcomeError if the run is damaged.

    Of a robot whose recordings are on a host still, by what can be seen from outside.
    """
    files = recordings(run.out)
    said = {
        robot: said_by([path for path in files.values() if path.parent.name == robot]) for robot in run.robots
    }
    tracks = tracks_of(run)
    floor = TrueFloor(run.grid, largest_radius(run.setup), run.orders, parameters)
    return Judged(tracks, floor, said, classify(tracks, said, floor, parameters))


def account(out: Path, parameters: EpisodeParameters = STANDARD) -> TimeSpent:
    """Where the time went of the run in the folder `out`.

    Raises EvidenceError if that holds no simulated run, and RecordingError or OutcomeError if it is damaged.
    """
    all_recordings(out)
    run = read_run(out)
    tracks, floor, said, classified = judge(run, parameters)
    return TimeSpent(
        robots=_robots(tracks, classified),
        blockings=blocking_events(tracks, classified, parameters),
        diagnosis=diagnosis_score(tracks, said, classified),
        decisions=decision_events(tracks, said, classified, parameters),
        decisions_left_out=sum(one.left_out for one in said.values()),
        findings=findings(tracks, FrameCounts(run.sent, run.heard), floor.passages, parameters),
        deadlocks=deadlocks(tracks, classified, parameters),
        blames=_blames(tracks, classified),
    )


def _robots(tracks: Tracks, classified: Classified) -> dict[str, dict[str, float]]:
    """In s, from whole µs: each robot's add up to the run's time."""
    spent = {}
    for index, robot in enumerate(tracks.robots):
        steps = np.bincount(classified.causes[:, index], minlength=len(CAUSES)).tolist()
        spent[robot] = {
            cause.value: in_seconds(count * tracks.step_us)
            for cause, count in zip(CAUSES, steps, strict=True)
        }
    return spent


def _blames(tracks: Tracks, classified: Classified) -> tuple[Blame, ...]:
    """In s, from whole µs."""
    waits = (classified.before != NOBODY) & (classified.root != NOBODY)
    pairs = np.column_stack([classified.root[waits], classified.causes[waits]])
    kinds, counts = np.unique(pairs, axis=0, return_counts=True)
    return tuple(
        Blame(tracks.robots[root], CAUSES[cause].value, in_seconds(count * tracks.step_us))
        for (root, cause), count in zip(kinds.tolist(), counts.tolist(), strict=True)
    )


class Spell(NamedTuple):
    """A while that went into one thing for one robot."""

    robot: str
    cause: Cause
    begin: float
    """Simulated s."""
    end: float
    x: float
    """Where it was in the middle of it, m."""
    y: float


def spells(run: RunEvidence) -> list[Spell]:
    """Everything that every robot's time went into, robot by robot in the order of time, without gaps.

    Raises RecordingError or OutcomeError if the run is damaged.
    """
    causes = judge(run).causes.causes
    found: list[Spell] = []
    for index, robot in enumerate(run.robots):
        own = causes[:, index]
        edges = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(own)]
        for begin, end in pairwise(edges):
            x, y = run.true[(begin + end) // 2, index, :2].tolist()
            until = run.end if end == len(own) else float(run.seconds[end])
            found.append(Spell(robot, CAUSES[own[begin]], float(run.seconds[begin]), until, x, y))
    return found
