"""How the pursuit of a goal stands: state, clocks and recoveries, as in move_base.

Rules of ros-planning/navigation, move_base/src/move_base.cpp (ROS Indigo); each names its function there.
"""

from dataclasses import dataclass
from enum import Enum

from actors.geometry import STILL, Twist
from actors.instant import Duration, Instant
from actors.robot.behaviour.goal import AbortReason


class PursuitState(Enum):
    """What the cycles of a pursuit do."""

    PLANNING = "planning"
    """Look for a path; the robot stands."""
    CONTROLLING = "controlling"
    """Ask the local planner for a command."""
    CLEARING = "clearing"
    """Recover, or give the goal up; the robot stands."""


@dataclass
class Pursuit:
    """What is remembered about an active goal; a new one begins anew (MoveBase::executeCb)."""

    period: Duration
    """So often there is a cycle; its command holds until the next."""
    had_plan: Instant
    """When a path was found last; at first, after a recovery and after a cycle without a valid trajectory
    that instant, for patience counts from there."""
    had_trajectory: Instant
    """When a cycle had a valid trajectory last; at first when the pursuit began."""
    progressed: Instant
    """When the robot last was far enough from where it had been then; at first when the pursuit began, and
    after a recovery that instant."""
    planned: Instant
    """When a path was looked for last."""
    state: PursuitState = PursuitState.PLANNING
    recoveries: int = 0
    """In a row, without that what `trigger` says had changed."""
    trigger: AbortReason = AbortReason.NO_PLAN
    """Why it recovered last, or is about to."""
    twist: Twist = STILL
    """What the last cycle commanded."""
    _due: Instant | None = None
    """When the next cycle is; None: at once."""

    @classmethod
    def begin(cls, instant: Instant, period: Duration) -> "Pursuit":
        """One whose clocks all start at `instant`."""
        return cls(period, instant, instant, instant, instant)

    @property
    def drives(self) -> bool:
        """True while the local planner is asked for commands."""
        return self.state is PursuitState.CONTROLLING

    def cycle_begins(self, instant: Instant) -> bool:
        """True once a period; in which step, does not depend on how long steps are."""
        if self._due is not None and instant < self._due:
            return False
        late = 0 if self._due is None else (instant - self._due) % self.period
        self._due = Instant(instant - late + self.period)
        return True

    def gives_up(self, reason: AbortReason) -> None:
        """The next cycle recovers for this reason, or ends the pursuit."""
        self.state, self.trigger = PursuitState.CLEARING, reason

    def settles(self, reason: AbortReason) -> None:
        """What recoveries were made for is no longer so: all of them are there again.

        A new plan settles NO_PLAN, a valid trajectory BLOCKED, and having moved NO_PROGRESS
        (MoveBase::executeCycle, wherever it sets recovery_index_ to 0).
        """
        if self.trigger is reason:
            self.recoveries = 0
