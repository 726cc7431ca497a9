"""Goals of navigation: what is asked for, and how it stands."""

from enum import Enum
from typing import NamedTuple

from actors.geometry import Point
from actors.instant import Instant


class GoalStatus(Enum):
    """How a goal stands; the names of move_base (actionlib_msgs/GoalStatus)."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class AbortReason(Enum):
    """Why navigation gave a goal up."""

    NO_PLAN = "no plan"
    """No way leads there on the map."""
    BLOCKED = "blocked"
    """The local planner found no valid trajectory for too long."""
    NO_PROGRESS = "no progress"
    """The robot did not get away from where it was."""


class GoalPhase(Enum):
    """What navigation is about while a goal is active; the first ones as in move_base."""

    PLANNING = "planning"
    """It has no way to the goal, and looks for one."""
    CONTROLLING = "controlling"
    """It has a way, and the local planner a valid trajectory."""
    OBSTRUCTED = "obstructed"
    """It has a way, but the local planner no valid trajectory, so the robot stands."""
    RETREATING = "retreating"
    """It backs away from what its bumper has touched, or because its behaviour said so."""
    PAUSED = "paused"
    """The behaviour lets it stand."""


class Goal(NamedTuple):
    """The last point that navigation was asked to go to, and how that stands."""

    point: Point
    status: GoalStatus
    reason: AbortReason | None = None
    """Set with ABORTED only."""
    phase: GoalPhase | None = None
    """Set with ACTIVE only."""
    since: Instant | None = None
    """When `phase` began; set with it."""


class GoalOrder(Enum):
    """What to do with the present goal."""

    KEEP = "keep"
    CANCEL = "cancel"
    """Stop, and have no goal any more."""
