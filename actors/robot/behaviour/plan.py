"""The way that a robot means to go: what its behaviour may know of the plan."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point
from actors.instant import Duration, Instant, seconds


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


PACE: Final = 0.33
"""So fast robots get on, m/s: 0.5 m/s by the slowness of 1.5 that `acrc verify navigation` measures."""


@dataclass(frozen=True, eq=False)
class Plan:
    """One plan of navigation's, which makes a new one every second."""

    way: NDArray[np.float64]
    """(n, 2), n ≥ 1: points from where the robot was to the goal, m, map frame; nobody's to change."""

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """The same as points."""
        return tuple(Point(x, y) for x, y in self.way.tolist())

    def ahead(self, here: Point) -> tuple[Point, ...]:
        """The points from the one nearest to `here` on."""
        nearest = min(range(len(self.points)), key=lambda index: self.points[index].distance_to(here))
        return self.points[nearest:]

    def distance_to_go(self, here: Point) -> float:
        """How far it is from `here` to the plan's nearest point and on to its end, m."""
        total, last = 0.0, here
        for point in self.ahead(here):
            total += last.distance_to(point)
            last = point
        return total

    def time_to_go(self, here: Point) -> Duration:
        """How long that takes at PACE: an estimate that knows of nobody in the way."""
        return seconds(self.distance_to_go(here) / PACE)
