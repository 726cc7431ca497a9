"""Goals, as in move_base: one at a time, active until it is reached, given up, replaced or cancelled."""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Final

import msgspec
import numpy as np

from actors.array_types import Floats
from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Duration, Instant, seconds
from actors.portable import cos_sin
from actors.robot.behaviour.ports import (
    FARTHEST_BACK,
    AbortReason,
    Goal,
    GoalOrder,
    GoalPhase,
    GoalStatus,
    Plan,
)
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.navigation_counts import NavigationCounts, NavigationReport
from actors.robot.navigation.planning import GlobalPlanner
from actors.robot.navigation.steering import BaseLocalPlanner
from actors.robot.sweep import Sweep
from actors.settings import Count, Interval, NotNegative, Positive, PositiveInterval, Settings
from deeco.knowledge import new_tuple


class PursuitState(Enum):
    """What the cycles of a pursuit do."""

    PLANNING = "planning"
    """Look for a path; the robot stands."""
    CONTROLLING = "controlling"
    """Ask the local planner for a command."""
    CLEARING = "clearing"
    """Recover, or give the goal up; the robot stands."""


_DRIVES: Final = PursuitState.CONTROLLING


@dataclass
class Pursuit:
    """State of an active goal; a new goal resets it (MoveBase::executeCb)."""

    period: Duration
    """Time from one cycle to the next; a command holds as long."""
    had_plan: Instant
    """When a path was last found, a recovery was made or a cycle had no valid trajectory: patience counts
    from there."""
    had_trajectory: Instant
    """When a cycle last had a valid trajectory; at first when the pursuit began."""
    progressed: Instant
    """When the robot was last far enough from where it had been, or recovered."""
    planned: Instant
    """When a path was last looked for."""
    state: PursuitState = PursuitState.PLANNING
    recoveries: int = 0
    """Recoveries in a row before it gives up; the files list one recovery, the next."""
    trigger: AbortReason = AbortReason.NO_PLAN
    """Why it recovered last, or is about to."""
    twist: Twist = STILL
    """Command of the last cycle."""
    _due: Instant | None = None
    """When the next cycle is; None: at once."""

    @classmethod
    def begin(cls, instant: Instant, period: Duration) -> "Pursuit":
        """Return one whose clocks all start at `instant`."""
        return cls(period, instant, instant, instant, instant)

    def cycle_begins(self, instant: Instant) -> bool:
        """Return True once a period; in which step does not depend on the length of steps."""
        if self._due is not None and instant < self._due:
            return False
        late = 0 if self._due is None else (instant - self._due) % self.period
        self._due = Instant(instant - late + self.period)
        return True

    def give_up(self, reason: AbortReason) -> None:
        """Let the next cycle recover for this reason, or end the pursuit."""
        self.state, self.trigger = PursuitState.CLEARING, reason

    def settle(self, reason: AbortReason) -> None:
        """Allow all recoveries again if they were made for this reason, which no longer holds.

        A new plan settles NO_PLAN, a valid trajectory BLOCKED, and having moved NO_PROGRESS
        (MoveBase::executeCycle, wherever it sets recovery_index_ to 0).
        """
        if self.trigger is reason:
            self.recoveries = 0


_SPACING: Final = 0.05
"""Distance of the trail's points, m."""
_LOOK_BACK: Final = 0.25
"""The robot steers for the point of the trail so far behind, m: about one and a half radii of the body."""
_SPEED: Final = 0.2
"""m/s; own choice, below half of the speed forward: the sensor may see nothing behind."""
_TURN: Final = 1.0
"""The highest turn rate, rad/s."""


class Trail:
    """The last few metres that a robot has driven, in the frame of its odometry."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque(maxlen=round(FARTHEST_BACK / _SPACING) + 1)

    def take(self, here: Point) -> None:
        """Add the robot's present place."""
        if not self._points or not self._points[-1].is_nearer(here, _SPACING):
            self._points.append(here)

    def behind(self, here: Point) -> Point | None:
        """Return what to steer for on the way back, None at the trail's end; passed points are forgotten."""
        while self._points and self._points[-1].is_nearer(here, _LOOK_BACK):
            self._points.pop()
        return self._points[-1] if self._points else None


@dataclass
class Withdrawal:
    """Backing out along the trail, ordered by the behaviour."""

    left: float
    """Distance to go, m."""
    last: Point
    """Where the robot was in the step before, odometry frame."""
    ends: Instant
    """Deadline."""


def backward(here: Pose, target: Point) -> Twist:
    """Return the velocity that leads backward on an arc to `target` (pure pursuit), or turns round first."""
    aim = here.relative(Pose(target.x, target.y, 0.0))
    if aim.x > -abs(aim.y):
        return Twist(0.0, 0.0, -_TURN if aim.y > 0 else _TURN)
    curvature = 2 * aim.y / (aim.x * aim.x + aim.y * aim.y)
    return Twist(-_SPEED, 0.0, max(-_TURN, min(_TURN, -_SPEED * curvature)))


class NavigationParameters(Settings, frozen=True):
    """When goals are planned for and given up; from d3scomp/ROSRemote, simulation/params/*.yaml."""

    replanning: PositiveInterval = seconds(1)
    """Time from one plan to the next (move_base planner_frequency 1 Hz)."""
    planner_patience: Interval = seconds(0.5)
    """Time without any path after which navigation recovers, or gives up (move_base planner_patience; the
    file says 5 s first and then this)."""
    controller_patience: Interval = seconds(1)
    """Time without a valid trajectory, the same (move_base controller_patience; the file says 3 s first)."""
    oscillation_timeout: Interval = seconds(10)
    """The same for a robot that stays this long ... (move_base oscillation_timeout)"""
    oscillation_distance: Positive = 0.2
    """... within this distance, m (move_base oscillation_distance)."""
    recoveries: Count = 1
    """So often in a row navigation recovers before it gives up; the files list one recovery, the next."""
    reset_distance: NotNegative = 1000.0
    """A recovery forgets marks outside of a square of this side round the robot, m. More than any window: the
    files say 3 (clear_costmap_recovery reset_distance) for layers named `obstacles`, and theirs have other
    names, so that it forgot nothing (clear_costmap_recovery.cpp)."""
    mark_robots: bool = False
    """Whether planning knows the marks of the local map that are not on the floor plan; off in the files. If
    on, a cycle without a valid trajectory asks for no path: those round robots that pass lead astray. Own
    choice."""
    back_off: bool = False
    """A robot without a valid trajectory or progress backs off straight by `retreat` once it is free behind
    it. Off, as in move_base, which never drives backward (min_vel_x 0)."""
    retreat: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.15
    """Distance backed away from what the bumper has touched, m: room to turn beside it. Own choice; move_base
    knows no bumper, and a Kobuki that touches something lets no wheel turn forward."""
    retreat_speed: Positive = 0.1
    """m/s; slow, as it may not see what it backs into."""
    retreat_patience: Interval = seconds(3)
    """Longest duration of a retreat; twice what it takes with free wheels."""


_PATIENT: Final = NavigationParameters(
    planner_patience=seconds(15), controller_patience=seconds(3), reset_distance=3.0
)
NAVIGATION_PRESETS: Final = {
    "chapter": NavigationParameters(),
    "robust": msgspec.structs.replace(_PATIENT, recoveries=2, mark_robots=True, back_off=True),
}
"""`chapter`: the original's. `robust`: the default; our own local planner; a recovery forgets what is marked
farther away; other robots are planned around, waited for and backed off from."""


class _Sensed(msgspec.Struct, frozen=True, gc=False):
    """Where the robot is: arguments of `Navigator.advance`."""

    instant: Instant
    here: Pose
    estimate: Pose
    velocity: Twist


@dataclass(frozen=True)
class _Retreat:
    """Backing away from what has been touched."""

    begun: Instant
    touched: Point
    """Where the robot was then, odometry frame."""


class Navigator:
    """Drives the robot to one goal after the other."""

    def __init__(
        self,
        planner: GlobalPlanner,
        local: CostMap,
        local_planner: BaseLocalPlanner,
        parameters: NavigationParameters = NAVIGATION_PRESETS["chapter"],
    ) -> None:
        self._planner = planner
        self._local = local
        self.local_planner = local_planner
        self._p = parameters
        self.goal: Goal | None = None
        """The last goal with its state; None before the first and after it was cancelled."""
        self.plan: Plan | None = None
        """The way that it follows; None while there is none."""
        self._pursuit: Pursuit | None = None
        self._anchor: Point | None = None
        """Where the robot last was far enough from the anchor before, map frame; new goals keep it."""
        self._retreat: _Retreat | None = None
        self._stuck = False
        """The local planner did not get the robot away, and it has not backed off yet."""
        self._paused = False
        self._trail = Trail()
        self._withdrawal: Withdrawal | None = None
        self._here, self._now = Point(0.0, 0.0), Instant(0)
        self._counts = NavigationCounts()

    @property
    def backing_out(self) -> bool:
        """True while it backs out along the robot's trail."""
        return self._withdrawal is not None

    def report(self) -> NavigationReport:
        """Return the goals so far, for the run's result."""
        return self._counts.report()

    def take(
        self, order: Point | GoalOrder, paused: bool | None = None, back_out: float | None = None
    ) -> None:
        """Go to a new point, have no goal, or go on; stand, or do not; back out by so much, m."""
        if paused is not None and paused is not self._paused:
            self._paused = paused
            self._counts.pauses(paused)
            self._begin_anew()
        if order is GoalOrder.CANCEL:
            self._withdrawal = None
        if back_out is not None:  # for twice as long as it should take, and a turn
            ends = Instant(self._now + seconds(3 + 2 * back_out / _SPEED))
            self._withdrawal = Withdrawal(back_out, self._here, ends)
            self._counts.retreats()
        if order is GoalOrder.KEEP:
            return
        self._begin_anew()
        self._counts.begins(order if isinstance(order, Point) else None)
        self.goal = None if order is GoalOrder.CANCEL else Goal(order, GoalStatus.ACTIVE)

    def sense(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Take in the odometry's pose and a scan, if there is one."""
        self._local.take(instant, here, sweep)
        self._here, self._now = new_tuple(Point, here[:2]), instant
        self._counts.now = instant
        if self._withdrawal is None:
            self._trail.take(self._here)

    def advance(
        self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist, bumped: bool = False
    ) -> Twist:
        """Return the velocity to command from now on.

        `here`: the robot's pose in the odometry frame; `estimate`: on the map; `velocity`: the base's own;
        `bumped`: its bumper touches something.
        """
        if self._withdrawal is not None and not self._paused:
            twist = self._back_out(self._withdrawal, instant, here)
            if twist is not None:
                return twist
            self._withdrawal = None
            self._begin_anew()
        if self.goal is None or self.goal.status is not GoalStatus.ACTIVE:
            self._retreat = None
            return STILL
        if self._paused:
            return self._in_phase(GoalPhase.PAUSED, instant)
        if self._retreats(instant, here, bumped):
            self._in_phase(GoalPhase.RETREATING, instant)
            return Twist(-self._p.retreat_speed, 0.0, 0.0)
        return self._pursue(self.goal.point, _Sensed(instant, here, estimate, velocity))

    def _back_out(self, withdrawal: Withdrawal, instant: Instant, here: Pose) -> Twist | None:
        """Return the velocity that leads back along the trail; None once that is over."""
        withdrawal.left -= withdrawal.last.distance_to(here.point)
        withdrawal.last = here.point
        target = self._trail.behind(here.point)
        if withdrawal.left <= 0 or instant >= withdrawal.ends or target is None:
            return None
        twist = backward(here, target)
        if twist.vx < 0 and not self._local.free_behind(here, min(withdrawal.left, self._p.retreat)):
            return None
        if self.goal is not None and self.goal.status is GoalStatus.ACTIVE:
            self._in_phase(GoalPhase.RETREATING, instant)
        return twist

    def _pursue(self, goal: Point, now: _Sensed) -> Twist:
        """Return the command of the present cycle (MoveBase::executeCb and executeCycle, move_base.cpp).

        There a new goal's path comes after a first cycle, in which the base keeps its last command.
        """
        pursuit = self._pursuit
        if pursuit is None:
            pursuit = self._pursuit = Pursuit.begin(now.instant, self.local_planner.period)
            self.local_planner.begin()
            self._plan(pursuit, goal, now)
        begins = pursuit.cycle_begins(now.instant)
        if begins:
            self._watch(pursuit, now)
            if pursuit.state is _DRIVES and now.instant - pursuit.planned >= self._p.replanning:
                self._plan(pursuit, goal, now)
        if pursuit.state is _DRIVES and self.local_planner.reached(now.estimate, now.velocity):
            return self._close(GoalStatus.SUCCEEDED)
        if begins:
            pursuit.twist = self._cycle(pursuit, goal, now)
        return pursuit.twist

    def _cycle(self, pursuit: Pursuit, goal: Point, now: _Sensed) -> Twist:
        """Do what the state asks for (MoveBase::executeCycle: its switch)."""
        if pursuit.state is PursuitState.CLEARING:
            return self._recover(pursuit, now.instant)
        if pursuit.state is _DRIVES:
            return self._control(pursuit, goal, now)
        if pursuit.planned < now.instant:
            self._plan(pursuit, goal, now)
        return self._in_phase(GoalPhase.PLANNING, now.instant)

    def _control(self, pursuit: Pursuit, goal: Point, now: _Sensed) -> Twist:
        """Let the local planner choose a trajectory; without a valid one stand, and plan anew at once.

        MoveBase::executeCycle, case CONTROLLING. So a robot without progress still gets a command in that
        cycle, and does not recover yet if there is no valid trajectory in it.
        """
        instant = now.instant
        if instant - pursuit.progressed > self._p.oscillation_timeout:
            pursuit.give_up(AbortReason.NO_PROGRESS)
        steering = self.local_planner.steer(instant, now.here, now.estimate, now.velocity)
        if steering.valid:
            pursuit.had_trajectory = instant
            self._stuck &= steering.twist.vx == 0.0
            pursuit.settle(AbortReason.BLOCKED)
            self._in_phase(GoalPhase.CONTROLLING, instant)
            return steering.twist
        if instant - pursuit.had_trajectory > self._p.controller_patience:
            pursuit.give_up(AbortReason.BLOCKED)
        elif self._p.mark_robots:
            pursuit.state = PursuitState.CONTROLLING
        else:
            pursuit.state, pursuit.had_plan = PursuitState.PLANNING, instant
            self._plan(pursuit, goal, now)
        return self._in_phase(GoalPhase.OBSTRUCTED, instant)

    def _plan(self, pursuit: Pursuit, goal: Point, now: _Sensed) -> None:
        """Look for a path (MoveBase::planThread).

        Without one a robot that drives follows the old one; a robot without one is patient for a while.
        """
        pursuit.planned = now.instant
        way = self._planner.path(now.estimate.point, goal, self._strangers(now.here, now.estimate))
        if way is not None:
            self._counts.plans(found=True)
            self.local_planner.follow(way)
            self.plan = Plan(way)
            pursuit.had_plan, pursuit.state = now.instant, PursuitState.CONTROLLING
            pursuit.settle(AbortReason.NO_PLAN)
        elif pursuit.state is PursuitState.PLANNING:
            self._counts.plans(found=False)
            self.plan = None
            if now.instant - pursuit.had_plan > self._p.planner_patience:
                pursuit.give_up(AbortReason.NO_PLAN)

    def _strangers(self, here: Pose, estimate: Pose) -> Floats | None:
        """Return the local map's marks in the map frame, if planning is to know of them."""
        if not self._p.mark_robots:
            return None
        marks = self._local.marks()
        c, s = cos_sin(estimate.heading - here.heading)
        x, y = marks[:, 0] - here.x, marks[:, 1] - here.y
        return np.stack([x * c - y * s + estimate.x, x * s + y * c + estimate.y], axis=1)

    def _recover(self, pursuit: Pursuit, instant: Instant) -> Twist:
        """Forget what is marked farther away and plan anew, or give the goal up.

        MoveBase::executeCycle, case CLEARING. It plans in the next cycle, and drives in the one after it.
        """
        self._stuck = self._p.back_off and pursuit.trigger is not AbortReason.NO_PLAN
        if pursuit.recoveries >= self._p.recoveries:
            return self._close(GoalStatus.ABORTED, pursuit.trigger)
        self._local.clear(self._p.reset_distance)
        self._counts.recovers()
        pursuit.recoveries += 1
        pursuit.progressed = pursuit.had_plan = instant
        pursuit.state, self.plan = PursuitState.PLANNING, None
        return self._in_phase(GoalPhase.PLANNING, instant)

    def _watch(self, pursuit: Pursuit, now: _Sensed) -> None:
        """Note whether the robot moves on (MoveBase::executeCycle, at its begin, in every state)."""
        place, distance = now.estimate.point, self._p.oscillation_distance
        if self._anchor is None or not self._anchor.is_nearer(place, distance):
            self._anchor, pursuit.progressed = place, now.instant
            pursuit.settle(AbortReason.NO_PROGRESS)

    def _retreats(self, instant: Instant, here: Pose, bumped: bool) -> bool:
        """Return True while the robot has to back away."""
        stuck = self._stuck
        if self._retreat is None:
            if not (bumped or stuck) or not self._local.free_behind(here, self._p.retreat, touching=stuck):
                return False
            self._retreat = _Retreat(instant, here.point)
            self._counts.retreats()
        left = self._p.retreat - self._retreat.touched.distance_to(here.point)
        in_time = instant - self._retreat.begun < self._p.retreat_patience
        if left > 0.0 and in_time and self._local.free_behind(here, left, touching=stuck):
            return True
        self._retreat, self._stuck = None, False
        return False

    def _in_phase(self, phase: GoalPhase, instant: Instant) -> Twist:
        """Note the phase of the active goal; the robot stands."""
        assert self.goal is not None
        if self.goal.phase is not phase:
            self.goal = self.goal._replace(phase=phase, since=instant)
            self._counts.enters(phase)
        return STILL

    def _begin_anew(self) -> None:
        """Forget how the present goal was pursued."""
        self._counts.interrupted()
        self._pursuit = self.plan = None
        self._retreat = None

    def _close(self, status: GoalStatus, reason: AbortReason | None = None) -> Twist:
        """End the goal; the robot stands."""
        assert self.goal is not None
        self.goal = Goal(self.goal.point, status, reason)
        self._counts.closes(status, reason)
        self._pursuit = self.plan = None
        return STILL
