"""What navigation has been through, counted for the result."""

from collections import Counter
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Final

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour.plan import AbortReason, GoalPhase, GoalStatus

_KEPT: Final = 1000
"""Goals and spells listed one by one; what comes later is counted only."""
_REPLACED: Final = "replaced"
_CANCELLED: Final = "cancelled"


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


@dataclass
class _Given:
    """A goal in the list; instants in µs."""

    begin: Instant
    x: float
    y: float
    end: Instant | None = None
    how: str = ""
    """"succeeded", "replaced", "cancelled" or the reason of its abort; empty while it is pursued."""


class NavigationCounts:
    """Counts and lists goals by what became of them, and lists the spells without trajectory or plan."""

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._aborted: Counter[AbortReason] = Counter()
        self._spells: list[tuple[Instant, Instant, GoalEnding]] = []
        self._begun: Instant | None = None
        self._unlisted = 0
        self._given: list[_Given] = []
        self._given_unlisted = 0
        self._planless: list[tuple[Instant, Instant]] = []
        self._planless_since: Instant | None = None
        self._pauses: list[list[Instant | None]] = []
        self.now = Instant(0)
        """The start of the step; whoever keeps the journal sets it."""

    def begins(self, goal: Point | None) -> None:
        """The behaviour has given a goal, or taken it back."""
        self._counts["cancelled" if goal is None else "goals"] += 1
        self._close(_CANCELLED if goal is None else _REPLACED)
        if goal is None:
            self.plans(found=True)  # nobody looks for a way any more
        elif self._given_unlisted or len(self._given) == _KEPT:
            self._given_unlisted += 1
        else:
            self._given.append(_Given(self.now, *goal))

    def plans(self, found: bool) -> None:
        """A way to the goal was looked for."""
        if not found:
            self._planless_since = self.now if self._planless_since is None else self._planless_since
        elif self._planless_since is not None:
            if len(self._planless) < _KEPT:
                self._planless.append((self._planless_since, self.now))
            self._planless_since = None

    def pauses(self, paused: bool) -> None:
        """Record that the behaviour pauses navigation or resumes it."""
        if not paused and self._pauses[-1][1] is None:
            self._pauses[-1][1] = self.now
        elif paused and len(self._pauses) < _KEPT:
            self._pauses.append([self.now, None])

    def enters(self, phase: GoalPhase) -> None:
        """The active goal has come into another phase."""
        if phase is GoalPhase.OBSTRUCTED:
            self._begun = self.now if self._begun is None else self._begun
        elif phase is not GoalPhase.PLANNING:  # to plan anew finds no trajectory yet
            self._end(GoalEnding.ITSELF)

    def closes(self, status: GoalStatus, reason: AbortReason | None) -> None:
        """The goal was reached or given up."""
        self._end(GoalEnding.ABORT if status is GoalStatus.ABORTED else GoalEnding.ITSELF)
        self._close(GoalStatus.SUCCEEDED.value if reason is None else reason.value)
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
            "given": [asdict(goal) for goal in self._given],
            "given_unlisted": self._given_unlisted,
            "without_plan": self._without_plan(),
            "paused": self._pauses,
        }

    def _without_plan(self) -> list[tuple[Instant, Instant]]:
        """Spells in which no way to the goal was found; goals given anew do not end them."""
        if self._planless_since is None:
            return self._planless
        return [*self._planless, (self._planless_since, self.now)]

    def _close(self, how: str) -> None:
        if self._given and self._given[-1].end is None and not self._given_unlisted:
            self._given[-1].end, self._given[-1].how = self.now, how

    def _end(self, ending: GoalEnding) -> None:
        if self._begun is None:
            return
        if len(self._spells) < _KEPT:
            self._spells.append((self._begun, self.now, ending))
        else:
            self._unlisted += 1
        self._begun = None


_COUNTS: Final = ("goals", "succeeded", "cancelled", "recoveries", "retreats")
