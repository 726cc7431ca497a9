"""What robots say of themselves in their last records, as far as it tells where time went."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.instant import in_seconds
from observation.accounting.tracks import Tracks
from observation.evidence.recorded import outcomes
from observation.evidence.said_decisions import SaidDecision, adaptation
from observation.results.navigation_result import GivenGoal, navigation_outcome

NO_GOAL: Final = -1
REACHED: Final = "succeeded"
"""How a goal ended to which the robot came."""
ABORTED: Final = frozenset({"no plan", "blocked", "no progress"})
"""How goals ended that navigation gave up."""


@dataclass(frozen=True)
class Said:
    """What one robot said, over all processes that it had; instants in µs."""

    goals: tuple[GivenGoal, ...] | None = ()
    """None if none of its processes left a last record, as of a run that was cut."""
    planless: tuple[tuple[int, int], ...] = ()
    """Spells in which navigation found no way."""
    paused: tuple[tuple[int, int | None], ...] = ()
    """Spells in which its strategy had paused navigation; None: to the end of the run."""
    blocked: tuple[tuple[int, int | None], ...] | None = None
    """Spells in which it held itself to be blocked; None if it never asks."""
    decisions: tuple[SaidDecision, ...] = ()
    left_out: int = 0
    """Further decisions."""


def said_by(records: Sequence[Path]) -> Said:
    """What the processes of one robot said, the first one first; one that left no last record said nothing.

    Raises RecordingError and OutcomeError for what cannot be read.
    """
    goals: list[GivenGoal] | None = None
    planless: list[tuple[int, int]] = []
    paused: list[tuple[int, int | None]] = []
    blocked: list[tuple[int, int | None]] | None = None
    decisions: list[SaidDecision] = []
    left_out = 0
    for record in records:
        outcome = outcomes(record)
        if (navigation := navigation_outcome(record, outcome)) is not None:
            goals = [*(goals or []), *navigation.given]
            planless += navigation.without_plan
            paused += navigation.paused
        told = adaptation(record, outcome)
        if told is not None:
            decisions += told.decisions
            left_out += told.decisions_unlisted
            if told.blocked is not None:
                blocked = [*(blocked or []), *told.blocked]
    said = None if blocked is None else tuple(blocked)
    wanted = None if goals is None else tuple(goals)
    return Said(wanted, tuple(planless), tuple(paused), said, tuple(decisions), left_out)


def pursued(goals: Sequence[GivenGoal], tracks: Tracks) -> NDArray[np.int64]:
    """(steps,): which of the goals a robot has and has not reached; NO_GOAL: none.

    A goal that navigation gave up counts until the next one, or until the end of the run: nobody has told the
    robot that it need not go there any more.
    """
    pursuing = np.full(len(tracks.true), NO_GOAL, np.int64)
    for number, goal in enumerate(goals):
        end = goal.end
        if end is None or goal.how in ABORTED:
            end = goals[number + 1].begin if number + 1 < len(goals) else None
        last = len(pursuing) if end is None else end // tracks.step_us
        pursuing[goal.begin // tracks.step_us : last] = number
    return pursuing


def spells(found: Sequence[tuple[int, int | None]], tracks: Tracks) -> NDArray[np.bool_]:
    """(steps,): True during the spells, from begin to end, µs; None: to the end of the run."""
    during = np.zeros(len(tracks.true), np.bool_)
    for begin, end in found:
        during[begin // tracks.step_us : None if end is None else -(-end // tracks.step_us)] = True
    return during


def seconds_of(tracks: Tracks, steps: int) -> float:
    """So many steps, s."""
    return in_seconds(steps * tracks.step_us)
