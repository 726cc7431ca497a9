"""What came of each decision of an adaptation, from ground truth."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from actors.instant import in_seconds
from observation.accounting.classify import Classified
from observation.accounting.episodes import EpisodeParameters
from observation.accounting.said import Said, seconds_of
from observation.accounting.time_spent import DecisionEvent, KnowledgeUsed
from observation.accounting.tracks import Tracks
from observation.evidence.said_decisions import SaidDecision

VISITED = "visited"
FREE = "free"
AGAIN = "blocked again"
OVERTAKEN = "overtaken"
END = "end"


def events(
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
    way: NDArray[np.float64], stood: NDArray[np.bool_], decision: SaidDecision, p: EpisodeParameters
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
