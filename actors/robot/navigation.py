"""Goals, as in move_base: one at a time, active until it is reached, given up, replaced or cancelled."""

import math
from dataclasses import dataclass, field

from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Duration, Instant, seconds
from actors.robot.driving import Driver
from actors.robot.planning import Planner
from actors.robot.ports import AbortReason, Goal, GoalOrder, GoalStatus


@dataclass(frozen=True)
class NavigationParameters:
    """When a goal is reached and when given up; from d3scomp/ROSRemote, simulation/params/*.yaml."""

    tolerance: float = 0.15
    """So near to the path's end the goal is reached, m (DWA xy_goal_tolerance)."""
    replanning: Duration = field(default=seconds(1))
    """The path is planned anew so often (move_base planner_frequency 1 Hz)."""
    planner_patience: Duration = field(default=seconds(0.5))
    """Without any path for so long the goal is given up (move_base planner_patience)."""
    controller_patience: Duration = field(default=seconds(1))
    """So long one attempt may be blocked (move_base controller_patience)."""
    recoveries: int = 1
    """Further attempts before the goal is given up: move_base clears its costmap once and tries again."""
    oscillation_timeout: Duration = field(default=seconds(10))
    """The goal is given up where the robot stays for so long ... (move_base oscillation_timeout)"""
    oscillation_distance: float = 0.2
    """... within so many metres (move_base oscillation_distance)."""
    retreat: float = 0.15
    """So far the robot backs away from what its bumper has touched, m: room to turn beside it. Own choice;
    move_base knows no bumper, and a Kobuki that touches something lets no wheel turn forward."""
    retreat_speed: float = 0.1
    """m/s; slow, for it does not see what it backs into."""
    retreat_patience: Duration = field(default=seconds(3))
    """So long one retreat may take; twice what it takes with free wheels."""


@dataclass
class _Pursuit:
    """What is remembered about an active goal."""

    begun: Instant
    anchor: Point
    """Where the robot last was far enough from the anchor before."""
    anchored: Instant
    planned: Instant | None = None
    """When there last was a path."""
    end: Point | None = None
    """Where the path ends."""
    blocked: Instant | None = None
    """Since when nothing but blocked steps."""


@dataclass(frozen=True)
class _Retreat:
    """Backing away from what has been touched."""

    begun: Instant
    touched: Point
    """Where the robot was then."""


class Navigation:
    """Drives the robot to one goal after the other."""

    def __init__(
        self, planner: Planner, driver: Driver, parameters: NavigationParameters = NavigationParameters()
    ) -> None:
        self._planner = planner
        self._driver = driver
        self._p = parameters
        self._goal: Goal | None = None
        self._pursuit: _Pursuit | None = None
        self._retreat: _Retreat | None = None

    @property
    def goal(self) -> Goal | None:
        """The last goal and how it stands; None before the first and after it was cancelled."""
        return self._goal

    def take(self, order: Point | GoalOrder) -> None:
        """Go to a new point, or stop, or go on as before."""
        if order is GoalOrder.KEEP:
            return
        self._pursuit = None
        self._goal = None if order is GoalOrder.CANCEL else Goal(order, GoalStatus.ACTIVE)

    def advance(self, instant: Instant, pose: Pose, velocity: Twist, bumped: bool = False) -> Twist:
        """The velocity to command from now on.

        `velocity` is the base's own; `bumped`: its bumper touches something.
        """
        if self._goal is None or self._goal.status is not GoalStatus.ACTIVE:
            self._retreat = None
            return STILL
        if self._retreats(instant, pose, bumped):
            return Twist(-self._p.retreat_speed, 0.0, 0.0)
        return self._pursue(self._goal.point, instant, pose, velocity)

    def _pursue(self, goal: Point, instant: Instant, pose: Pose, velocity: Twist) -> Twist:
        if self._pursuit is None:
            self._pursuit = _Pursuit(instant, pose.point, instant)
            self._driver.begin()
        end = self._plan(self._pursuit, goal, instant, pose)
        if end is None:
            return STILL
        if end.distance_to(pose.point) <= self._p.tolerance:
            return self._close(GoalStatus.SUCCEEDED)
        if self._stays(self._pursuit, instant, pose):
            return self._close(GoalStatus.ABORTED, AbortReason.NO_PROGRESS)
        steering = self._driver.steer(instant, pose, velocity)
        if not steering.blocked:
            self._pursuit.blocked = None
        elif self._pursuit.blocked is None:
            self._pursuit.blocked = instant
        elif instant - self._pursuit.blocked >= self._p.controller_patience * (1 + self._p.recoveries):
            return self._close(GoalStatus.ABORTED, AbortReason.BLOCKED)
        return steering.twist

    def _retreats(self, instant: Instant, pose: Pose, bumped: bool) -> bool:
        """True while the robot has to back away."""
        if self._retreat is None:
            if not bumped:
                return False
            self._retreat = _Retreat(instant, pose.point)
        gone = self._retreat.touched.distance_to(pose.point)
        if gone < self._p.retreat and instant - self._retreat.begun < self._p.retreat_patience:
            return True
        self._retreat = None
        return False

    def _plan(self, pursuit: _Pursuit, goal: Point, instant: Instant, pose: Pose) -> Point | None:
        """The end of a path that is fresh enough; None while there is none, and once the goal is given up."""
        if pursuit.planned is not None and instant - pursuit.planned < self._p.replanning:
            return pursuit.end
        way = self._planner.path(pose.point, goal)
        if way is not None:
            self._driver.follow(way)
            pursuit.planned = instant
            pursuit.end = Point(float(way[-1, 0]), float(way[-1, 1]))
            return pursuit.end
        last = pursuit.begun if pursuit.planned is None else pursuit.planned
        if instant - last >= self._p.planner_patience:
            self._close(GoalStatus.ABORTED, AbortReason.NO_PLAN)
        return None

    def _stays(self, pursuit: _Pursuit, instant: Instant, pose: Pose) -> bool:
        """True if the robot has not left its surroundings for too long."""
        if math.hypot(pose.x - pursuit.anchor.x, pose.y - pursuit.anchor.y) > self._p.oscillation_distance:
            pursuit.anchor, pursuit.anchored = pose.point, instant
        return instant - pursuit.anchored >= self._p.oscillation_timeout

    def _close(self, status: GoalStatus, reason: AbortReason | None = None) -> Twist:
        """The goal ends; the robot stands."""
        assert self._goal is not None
        self._goal = self._goal._replace(status=status, reason=reason)
        self._pursuit = None
        return STILL
