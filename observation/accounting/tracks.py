"""True poses of robots step by step, and what each robot reported of its goals and pauses."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.instant import in_seconds
from actors.messages import Jam
from observation.evidence.recorded import SaidDecision, adaptation, outcomes
from observation.evidence.run_evidence import RunEvidence
from observation.results.outcome import GivenGoal, navigation_outcome


class TimedJam(NamedTuple):
    """A jammer, from one instant until another one, µs."""

    begin: int
    jam: Jam


@dataclass(frozen=True, eq=False)
class Tracks:
    """All robots of one run at the start of each step."""

    robots: tuple[str, ...]
    step_us: int
    true: NDArray[np.float64]
    """(steps, robots, 3): x, y in m and heading in rad, map frame, as the world has it."""
    held: NDArray[np.float64]
    """(steps, robots, 3): where the robot holds itself to be; NaN where it has not said so."""
    wished: NDArray[np.float64]
    """(steps, robots, 3): the velocity that it asks for from then on, in its own frame: m/s, m/s, rad/s; NaN
    where it asks for none."""
    stepping: NDArray[np.bool_]
    """(steps, robots): False where its process was ended or frozen."""
    busy: NDArray[np.bool_]
    """(steps, robots): False where it has said that it means to visit no place any more."""
    jams: tuple[TimedJam, ...] = ()
    frozen: NDArray[np.bool_] | None = None
    """(steps, robots): of those that do not step, whose processes live still; None: none."""

    def index(self, instant: int) -> int:
        """The step that begins at the instant, or the last one before the end of the run."""
        return min(instant // self.step_us, len(self.true) - 1)


def tracks_of(run: RunEvidence) -> Tracks:
    """What a run's recordings show of it."""
    return Tracks(
        robots=run.robots,
        step_us=run.setup.step_us,
        true=run.true,
        held=run.held,
        wished=run.wished,
        stepping=run.stepping,
        busy=run.left > 0,
        jams=tuple(TimedJam(round(second * 1e6), jam) for second, jam in run.jams),
        frozen=run.powered & ~run.stepping,
    )


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


def during(found: Sequence[tuple[int, int | None]], tracks: Tracks) -> NDArray[np.bool_]:
    """(steps,): True during the spells, from begin to end, µs; None: to the end of the run."""
    during = np.zeros(len(tracks.true), np.bool_)
    for begin, end in found:
        during[begin // tracks.step_us : None if end is None else -(-end // tracks.step_us)] = True
    return during


def seconds_of(tracks: Tracks, steps: int) -> float:
    """So many steps, s."""
    return in_seconds(steps * tracks.step_us)
