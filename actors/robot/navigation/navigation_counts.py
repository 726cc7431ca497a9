"""Navigation's report for the run's result: outcomes of goals, intervals without trajectory or plan."""

from typing import Final, Literal

import msgspec

from actors.geometry import Point
from actors.instant import Instant
from actors.robot.behaviour.ports import AbortReason, GoalPhase, GoalStatus
from actors.runtime.typed_json import BoundedList, Count, Counts, Metres, Name

_MAX_LISTED: Final = 1000
"""Maximum number of listed goals and intervals; later ones are only counted."""

Ending = Literal["itself", "abort", "order", "run"]
"""End of an interval without a valid trajectory: a trajectory or a retreat; an abort; the behaviour's next
request; the end of the run."""


class GoalRecord(msgspec.Struct, forbid_unknown_fields=True):
    """A goal requested by a behaviour; instants in µs."""

    begin: Count
    """Start of the step of the request."""
    x: Metres
    y: Metres
    """Position, m, map frame."""
    end: Count | None = None
    """Start of the step in which it ended; None: active at the end of the process."""
    how: Name = ""
    """`succeeded`, `replaced`, `cancelled`, or the reason of its abort; empty while active."""


class NavigationReport(msgspec.Struct, forbid_unknown_fields=True):
    """Counts of one robot's navigation in one process; intervals as begin and end, µs."""

    goals: Count = 0
    succeeded: Count = 0
    cancelled: Count = 0
    recoveries: Count = 0
    """Number of recoveries: cleared marks."""
    retreats: Count = 0
    """Number of times the robot backed away."""
    aborted: Counts = {}
    """Aborted goals by reason."""
    no_valid_trajectory: BoundedList[tuple[Count, Count, Ending]] = []
    """Intervals in which the local planner found no trajectory."""
    no_valid_trajectory_unlisted: Count = 0
    given: BoundedList[GoalRecord] = []
    given_unlisted: Count = 0
    without_plan: BoundedList[tuple[Count, Count]] = []
    """Intervals without a path to the goals."""
    paused: BoundedList[tuple[Count, Count | None]] = []
    """Intervals in which the behaviour paused navigation; None: until the end of the run."""


class NavigationCounts:
    """Builder of the report during a run."""

    def __init__(self) -> None:
        self._report = NavigationReport(aborted={reason.value: 0 for reason in AbortReason})
        self._begun: Instant | None = None
        self._planless_since: Instant | None = None
        self.now = Instant(0)
        """Start of the step, set by navigation."""

    def record_goal(self, goal: Point | None) -> None:
        """Record that the behaviour requests or cancels a goal."""
        report = self._report
        if goal is None:
            report.cancelled += 1
            self._close("cancelled")
            self.record_search(found=True)  # a path is no longer searched
            return
        report.goals += 1
        self._close("replaced")
        if report.given_unlisted or len(report.given) == _MAX_LISTED:
            report.given_unlisted += 1
        else:
            report.given.append(GoalRecord(self.now, *goal))

    def record_search(self, found: bool) -> None:
        """Record a search for a path."""
        if not found:
            self._planless_since = self.now if self._planless_since is None else self._planless_since
        elif self._planless_since is not None:
            if len(self._report.without_plan) < _MAX_LISTED:
                self._report.without_plan.append((self._planless_since, self.now))
            self._planless_since = None

    def record_pause(self, paused: bool) -> None:
        """Record that the behaviour pauses navigation or resumes it."""
        intervals = self._report.paused
        if not paused and intervals[-1][1] is None:
            intervals[-1] = (intervals[-1][0], self.now)
        elif paused and len(intervals) < _MAX_LISTED:
            intervals.append((self.now, None))

    def record_phase(self, phase: GoalPhase) -> None:
        """Record a new phase of the active goal."""
        if phase is GoalPhase.OBSTRUCTED:
            self._begun = self.now if self._begun is None else self._begun
        elif phase is not GoalPhase.PLANNING:  # a new plan is not a trajectory
            self._end("itself")

    def record_end(self, status: GoalStatus, reason: AbortReason | None) -> None:
        """Record that the goal has succeeded or was aborted."""
        self._end("abort" if status is GoalStatus.ABORTED else "itself")
        self._close(GoalStatus.SUCCEEDED.value if reason is None else reason.value)
        if reason is None:
            self._report.succeeded += 1
        else:
            self._report.aborted[reason.value] += 1

    def record_interruption(self) -> None:
        """Record that the behaviour ends the pursuit of the goal."""
        self._end("order")

    def record_recovery(self) -> None:
        """Record a recovery."""
        self._report.recoveries += 1

    def record_retreat(self) -> None:
        """Record that the robot begins to back away."""
        self._report.retreats += 1

    def report(self) -> NavigationReport:
        """Return the report so far; open intervals without trajectory or plan end now."""
        report, now = self._report, self.now
        trajectory, plan = list(report.no_valid_trajectory), list(report.without_plan)
        if self._begun is not None:
            trajectory.append((self._begun, now, "run"))
        if self._planless_since is not None:
            plan.append((self._planless_since, now))
        return msgspec.structs.replace(report, no_valid_trajectory=trajectory, without_plan=plan)

    def _close(self, how: str) -> None:
        given = self._report.given
        if given and given[-1].end is None and not self._report.given_unlisted:
            given[-1].end, given[-1].how = self.now, how

    def _end(self, ending: Ending) -> None:
        if self._begun is None:
            return
        if len(self._report.no_valid_trajectory) < _MAX_LISTED:
            self._report.no_valid_trajectory.append((self._begun, self.now, ending))
        else:
            self._report.no_valid_trajectory_unlisted += 1
        self._begun = None
