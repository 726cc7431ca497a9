"""What navigation has been through, counted for the result."""

from collections import Counter
from enum import Enum
from typing import Final

from actors.instant import Instant
from actors.robot.behaviour.goal import AbortReason, GoalPhase, GoalStatus

_KEPT: Final = 1000
"""Spells listed one by one; what comes later is counted only."""


class GoalEnding(Enum):
    """How a spell without a valid trajectory ended."""

    ITSELF = "itself"
    """There was a valid trajectory again, or a retreat began."""
    ABORT = "abort"
    """Navigation gave the goal up."""
    ORDER = "order"
    """The behaviour gave another goal, or none, or let the robot stand."""
    RUN = "run"
    """The run ended."""


class NavigationCounts:
    """Counts goals by what became of them, and lists the spells without a valid trajectory."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._aborted: Counter[AbortReason] = Counter()
        self._spells: list[tuple[Instant, Instant, GoalEnding]] = []
        self._begun: Instant | None = None
        self._unlisted = 0
        self.now = Instant(0)
        """The start of the step; whoever keeps the journal sets it."""

    def begins(self, has_goal: bool) -> None:
        """The behaviour has given a goal, or taken it back."""
        self._counts["goals" if has_goal else "cancelled"] += 1

    def enters(self, phase: GoalPhase) -> None:
        """The active goal has come into another phase."""
        if phase is GoalPhase.OBSTRUCTED:
            self._begun = self.now if self._begun is None else self._begun
        elif phase is not GoalPhase.PLANNING:  # to plan anew finds no trajectory yet
            self._end(GoalEnding.ITSELF)

    def closes(self, status: GoalStatus, reason: AbortReason | None) -> None:
        """The goal was reached or given up."""
        self._end(GoalEnding.ABORT if status is GoalStatus.ABORTED else GoalEnding.ITSELF)
        if reason is None:
            self._counts["succeeded"] += 1
        else:
            self._aborted[reason] += 1

    def interrupted(self) -> None:
        """The behaviour ends the pursuit of the goal."""
        self._end(GoalEnding.ORDER)

    def recovers(self) -> None:
        """Marks were forgotten to try once more."""
        self._counts["recoveries"] += 1

    def retreats(self) -> None:
        """The robot begins to back away from what it has touched."""
        self._counts["retreats"] += 1

    def outcome(self) -> dict[str, object]:
        """By subject; instants in µs. A spell that has not ended does so with the run."""
        spells = [(begin, end, ending.value) for begin, end, ending in self._spells]
        if self._begun is not None:
            spells.append((self._begun, self.now, GoalEnding.RUN.value))
        return {
            **{name: self._counts[name] for name in _COUNTS},
            "aborted": {reason.value: self._aborted[reason] for reason in AbortReason},
            "no_valid_trajectory": spells,
            "no_valid_trajectory_unlisted": self._unlisted,
        }

    def _end(self, ending: GoalEnding) -> None:
        if self._begun is None:
            return
        if len(self._spells) < _KEPT:
            self._spells.append((self._begun, self.now, ending))
        else:
            self._unlisted += 1
        self._begun = None


_COUNTS: Final = ("goals", "succeeded", "cancelled", "recoveries", "retreats")
