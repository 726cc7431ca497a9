"""Goals as in move_base: one at a time, active until succeeded, aborted, replaced or cancelled."""

from collections import deque
from enum import Enum
from typing import Annotated, Final

import msgspec
import numpy as np

from actors.array_types import Floats
from actors.geometry import STILL, Point, Pose, Twist
from actors.instant import Duration, Instant, seconds
from actors.portable import cos_sin
from actors.robot.behaviour.ports import (
    MAX_BACK_OUT,
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
    """State of a pursuit."""

    PLANNING = "planning"
    """Searching for a path; the robot stands."""
    CONTROLLING = "controlling"
    """Following commands of the local planner."""
    CLEARING = "clearing"
    """Recovering or aborting; the robot stands."""


_CONTROLLING: Final = PursuitState.CONTROLLING


class Pursuit(msgspec.Struct):
    """State of an active goal; a new goal resets it (MoveBase::executeCb)."""

    period: Duration
    """Time between cycles."""
    planner_timer: Instant
    """Time of the last path, recovery or cycle without valid trajectory: start of the planner's timeout."""
    controller_timer: Instant
    """Time of the last valid trajectory; initially the start of the pursuit."""
    last_progress: Instant
    """Time of the last sufficient progress or recovery."""
    last_search: Instant
    """Time of the last search for a path."""
    state: PursuitState = PursuitState.PLANNING
    recoveries: int = 0
    """Consecutive recoveries."""
    trigger: AbortReason = AbortReason.NO_PLAN
    """Reason of the last or next recovery."""
    twist: Twist = STILL
    """Command of the last cycle."""
    _due: Instant | None = None
    """Time of the next cycle; None: at once."""

    @classmethod
    def begin(cls, instant: Instant, period: Duration) -> "Pursuit":
        """Return a pursuit that starts at `instant`."""
        return cls(period, instant, instant, instant, instant)

    def begin_due_cycle(self, instant: Instant) -> bool:
        """Return True once a period, independent of the length of steps."""
        if self._due is not None and instant < self._due:
            return False
        late = 0 if self._due is None else (instant - self._due) % self.period
        self._due = Instant(instant - late + self.period)
        return True

    def give_up(self, reason: AbortReason) -> None:
        """Let the next cycle recover or abort for this reason."""
        self.state, self.trigger = PursuitState.CLEARING, reason

    def reset_recoveries(self, reason: AbortReason) -> None:
        """Reset the count of recoveries if this was their reason.

        A new plan settles NO_PLAN, a valid trajectory BLOCKED, and progress NO_PROGRESS
        (MoveBase::executeCycle, wherever it sets recovery_index_ to 0).
        """
        if self.trigger is reason:
            self.recoveries = 0


_SPACING: Final = 0.05
"""Spacing of the trail's points, m."""
_LOOK_AHEAD: Final = 0.25
"""Look-ahead distance on the trail, m: about one and a half radii of the body."""
_SPEED: Final = 0.2
"""Speed of backing out, m/s; own choice, below half of the forward speed, since the rear may be unseen."""
_TURN_RATE: Final = 1.0
"""Highest turn rate of backing out, rad/s."""


class Trail:
    """The last metres that a robot has driven, in the odometry frame."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque(maxlen=round(MAX_BACK_OUT / _SPACING) + 1)

    def take(self, here: Point) -> None:
        """Add the robot's position."""
        if not self._points or not self._points[-1].is_nearer(here, _SPACING):
            self._points.append(here)

    def behind(self, here: Point) -> Point | None:
        """Return the target for backing out and drop passed points; None at the trail's end."""
        while self._points and self._points[-1].is_nearer(here, _LOOK_AHEAD):
            self._points.pop()
        return self._points[-1] if self._points else None


class Withdrawal(msgspec.Struct):
    """Backing out along the trail, requested by the behaviour."""

    distance_left: float
    """Distance to go, m."""
    last: Point
    """Position in the previous step, odometry frame."""
    deadline: Instant
    """Deadline."""


def reverse_velocity(here: Pose, target: Point) -> Twist:
    """Return the velocity backward on an arc to `target` (pure pursuit); turns first if it is not behind."""
    aim = here.relative(Pose(target.x, target.y, 0.0))
    if aim.x > -abs(aim.y):
        return Twist(0.0, 0.0, -_TURN_RATE if aim.y > 0 else _TURN_RATE)
    curvature = 2 * aim.y / (aim.x * aim.x + aim.y * aim.y)
    return Twist(-_SPEED, 0.0, max(-_TURN_RATE, min(_TURN_RATE, -_SPEED * curvature)))


class NavigationParameters(Settings, frozen=True):
    """Timeouts and recoveries of goals; from d3scomp/ROSRemote, simulation/params/*.yaml."""

    replanning: PositiveInterval = seconds(1)
    """Time between plans (move_base planner_frequency 1 Hz)."""
    planner_patience: Interval = seconds(0.5)
    """Timeout without a path, after which navigation recovers or aborts (move_base planner_patience; the file
    has 5 s first and then this)."""
    controller_patience: Interval = seconds(1)
    """Timeout without a valid trajectory (move_base controller_patience; the file has 3 s first)."""
    oscillation_timeout: Interval = seconds(10)
    """Timeout without progress by `oscillation_distance` (move_base oscillation_timeout)."""
    oscillation_distance: Positive = 0.2
    """Distance that counts as progress, m (move_base oscillation_distance)."""
    recoveries: Count = 1
    """Number of consecutive recoveries before an abort; the files list one."""
    reset_distance: NotNegative = 1000.0
    """A recovery clears marks outside of a square of this side around the robot, m. The default exceeds any
    window: the files have 3 (clear_costmap_recovery reset_distance) for layers named `obstacles`, but name
    their layers differently, so that nothing is cleared (clear_costmap_recovery.cpp)."""
    mark_robots: bool = False
    """Plan around marks of the local map that are not on the floor plan; off in the files. If on, a cycle
    without a valid trajectory does not replan: paths around passing robots are misleading. Own choice."""
    back_off: bool = False
    """A robot without valid trajectory or progress backs off straight by `retreat` if the space behind it is
    free. Off, as in move_base, which never drives backward (min_vel_x 0)."""
    retreat: Annotated[float, msgspec.Meta(gt=0, le=1)] = 0.15
    """Distance of backing away from a bumper contact, m: space to turn beside the obstacle. Own choice;
    move_base does not use bumpers, and a Kobuki with a bumper contact blocks forward motion."""
    retreat_speed: Positive = 0.1
    """Speed of a retreat, m/s; slow, since the sensor may not cover the rear."""
    retreat_patience: Interval = seconds(3)
    """Timeout of a retreat; twice its duration with free wheels."""


_PATIENT: Final = NavigationParameters(
    planner_patience=seconds(15), controller_patience=seconds(3), reset_distance=3.0
)
NAVIGATION_PRESETS: Final = {
    "chapter": NavigationParameters(),
    "robust": msgspec.structs.replace(_PATIENT, recoveries=2, mark_robots=True, back_off=True),
}
"""`chapter`: reproduces the original, whose robots may get stuck. `robust`: our own rules, the default; a
recovery clears distant marks; plans lead around other robots; the robot waits for them and backs off."""


class _RobotState(msgspec.Struct, frozen=True, gc=False):
    """Arguments of `Navigator.advance`."""

    instant: Instant
    here: Pose
    estimate: Pose
    velocity: Twist


class _Retreat(msgspec.Struct, frozen=True):
    """Backing away after a bumper contact."""

    begun: Instant
    touched: Point
    """Position of the robot at the contact, odometry frame."""


class Navigator:
    """Navigation of one robot: goals, planning, control and recoveries."""

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
        """The last goal and its state; None before the first and after a cancellation."""
        self.plan: Plan | None = None
        """The current plan; None if there is none."""
        self._pursuit: Pursuit | None = None
        self._anchor: Point | None = None
        """Position of the last progress, map frame; kept by new goals."""
        self._retreat: _Retreat | None = None
        self._stuck = False
        """True if the robot is blocked and has not backed off yet."""
        self._paused = False
        self._trail = Trail()
        self._withdrawal: Withdrawal | None = None
        self._here, self._now = Point(0.0, 0.0), Instant(0)
        self._counts = NavigationCounts()

    @property
    def backing_out(self) -> bool:
        """True while the robot backs out along its trail."""
        return self._withdrawal is not None

    def report(self) -> NavigationReport:
        """Return the report so far, for the run's result."""
        return self._counts.report()

    def take(
        self, order: Point | GoalOrder, paused: bool | None = None, back_out: float | None = None
    ) -> None:
        """Apply requests of a decision: goal, pause, and distance of backing out, m."""
        if paused is not None and paused is not self._paused:
            self._paused = paused
            self._counts.record_pause(paused)
            self._restart_pursuit()
        if order is GoalOrder.CANCEL:
            self._withdrawal = None
        if back_out is not None:  # deadline: twice the usual duration, and time for a turn
            deadline = Instant(self._now + seconds(3 + 2 * back_out / _SPEED))
            self._withdrawal = Withdrawal(back_out, self._here, deadline)
            self._counts.record_retreat()
        if order is GoalOrder.KEEP:
            return
        self._restart_pursuit()
        self._counts.record_goal(order if isinstance(order, Point) else None)
        self.goal = None if order is GoalOrder.CANCEL else Goal(order, GoalStatus.ACTIVE)

    def sense(self, instant: Instant, here: Pose, sweep: Sweep | None) -> None:
        """Update the local map with the odometry's pose and a scan, if there is one."""
        self._local.take(instant, here, sweep)
        self._here, self._now = new_tuple(Point, here[:2]), instant
        self._counts.now = instant
        if self._withdrawal is None:
            self._trail.take(self._here)

    def advance(
        self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist, bumped: bool = False
    ) -> Twist:
        """Return the velocity command.

        `here`, `estimate`: the robot's pose in the odometry frame and in the map frame; `velocity`: of the
        base; `bumped`: True during a bumper contact.
        """
        if self._withdrawal is not None and not self._paused:
            twist = self._back_out(self._withdrawal, instant, here)
            if twist is not None:
                return twist
            self._withdrawal = None
            self._restart_pursuit()
        if self.goal is None or self.goal.status is not GoalStatus.ACTIVE:
            self._retreat = None
            return STILL
        if self._paused:
            return self._set_phase(GoalPhase.PAUSED, instant)
        if self._is_retreating(instant, here, bumped):
            self._set_phase(GoalPhase.RETREATING, instant)
            return Twist(-self._p.retreat_speed, 0.0, 0.0)
        return self._pursue(self.goal.point, _RobotState(instant, here, estimate, velocity))

    def _back_out(self, withdrawal: Withdrawal, instant: Instant, here: Pose) -> Twist | None:
        """Return the velocity along the trail; None at the end of backing out."""
        withdrawal.distance_left -= withdrawal.last.distance_to(here.point)
        withdrawal.last = here.point
        target = self._trail.behind(here.point)
        if withdrawal.distance_left <= 0 or instant >= withdrawal.deadline or target is None:
            return None
        twist = reverse_velocity(here, target)
        if twist.vx < 0 and not self._local.free_behind(here, min(withdrawal.distance_left, self._p.retreat)):
            return None
        if self.goal is not None and self.goal.status is GoalStatus.ACTIVE:
            self._set_phase(GoalPhase.RETREATING, instant)
        return twist

    def _pursue(self, goal: Point, state: _RobotState) -> Twist:
        """Return the command of the current cycle (MoveBase::executeCb and executeCycle, move_base.cpp).

        In move_base the path of a new goal arrives after a first cycle, in which the base keeps its command.
        """
        pursuit = self._pursuit
        if pursuit is None:
            pursuit = self._pursuit = Pursuit.begin(state.instant, self.local_planner.period)
            self.local_planner.begin()
            self._plan(pursuit, goal, state)
        is_due = pursuit.begin_due_cycle(state.instant)
        if is_due:
            self._check_progress(pursuit, state)
            if pursuit.state is _CONTROLLING and state.instant - pursuit.last_search >= self._p.replanning:
                self._plan(pursuit, goal, state)
        if pursuit.state is _CONTROLLING and self.local_planner.reached(state.estimate, state.velocity):
            return self._end_goal(GoalStatus.SUCCEEDED)
        if is_due:
            pursuit.twist = self._cycle(pursuit, goal, state)
        return pursuit.twist

    def _cycle(self, pursuit: Pursuit, goal: Point, state: _RobotState) -> Twist:
        """Return the command of the state (MoveBase::executeCycle: its switch)."""
        if pursuit.state is PursuitState.CLEARING:
            return self._recover(pursuit, state.instant)
        if pursuit.state is _CONTROLLING:
            return self._control(pursuit, goal, state)
        if pursuit.last_search < state.instant:
            self._plan(pursuit, goal, state)
        return self._set_phase(GoalPhase.PLANNING, state.instant)

    def _control(self, pursuit: Pursuit, goal: Point, state: _RobotState) -> Twist:
        """Return the local planner's command; without a valid trajectory stand and replan at once.

        MoveBase::executeCycle, case CONTROLLING: a robot without progress still receives a command in this
        cycle, and a cycle without valid trajectory resets the state, so that it does not recover yet.
        """
        instant = state.instant
        if instant - pursuit.last_progress > self._p.oscillation_timeout:
            pursuit.give_up(AbortReason.NO_PROGRESS)
        steering = self.local_planner.steer(instant, state.here, state.estimate, state.velocity)
        if steering.valid:
            pursuit.controller_timer = instant
            self._stuck &= steering.twist.vx == 0.0
            pursuit.reset_recoveries(AbortReason.BLOCKED)
            self._set_phase(GoalPhase.CONTROLLING, instant)
            return steering.twist
        if instant - pursuit.controller_timer > self._p.controller_patience:
            pursuit.give_up(AbortReason.BLOCKED)
        elif self._p.mark_robots:
            pursuit.state = PursuitState.CONTROLLING
        else:
            pursuit.state, pursuit.planner_timer = PursuitState.PLANNING, instant
            self._plan(pursuit, goal, state)
        return self._set_phase(GoalPhase.OBSTRUCTED, instant)

    def _plan(self, pursuit: Pursuit, goal: Point, state: _RobotState) -> None:
        """Search for a path (MoveBase::planThread).

        Without a new path, the robot follows the old one or waits for the timeout.
        """
        pursuit.last_search = state.instant
        path = self._planner.path(
            state.estimate.point, goal, self._unmapped_marks(state.here, state.estimate)
        )
        if path is not None:
            self._counts.record_search(found=True)
            self.local_planner.follow(path)
            self.plan = Plan(path)
            pursuit.planner_timer, pursuit.state = state.instant, PursuitState.CONTROLLING
            pursuit.reset_recoveries(AbortReason.NO_PLAN)
        elif pursuit.state is PursuitState.PLANNING:
            self._counts.record_search(found=False)
            self.plan = None
            if state.instant - pursuit.planner_timer > self._p.planner_patience:
                pursuit.give_up(AbortReason.NO_PLAN)

    def _unmapped_marks(self, here: Pose, estimate: Pose) -> Floats | None:
        """Return the local map's marks in the map frame if planning uses them, otherwise None."""
        if not self._p.mark_robots:
            return None
        marks = self._local.marks()
        c, s = cos_sin(estimate.heading - here.heading)
        x, y = marks[:, 0] - here.x, marks[:, 1] - here.y
        return np.stack([x * c - y * s + estimate.x, x * s + y * c + estimate.y], axis=1)

    def _recover(self, pursuit: Pursuit, instant: Instant) -> Twist:
        """Clear distant marks and replan, or abort the goal.

        MoveBase::executeCycle, case CLEARING: plans in the next cycle and drives in the one after it.
        """
        self._stuck = self._p.back_off and pursuit.trigger is not AbortReason.NO_PLAN
        if pursuit.recoveries >= self._p.recoveries:
            return self._end_goal(GoalStatus.ABORTED, pursuit.trigger)
        self._local.clear(self._p.reset_distance)
        self._counts.record_recovery()
        pursuit.recoveries += 1
        pursuit.last_progress = pursuit.planner_timer = instant
        pursuit.state, self.plan = PursuitState.PLANNING, None
        return self._set_phase(GoalPhase.PLANNING, instant)

    def _check_progress(self, pursuit: Pursuit, state: _RobotState) -> None:
        """Detect progress (MoveBase::executeCycle, at its begin, in every state)."""
        place, distance = state.estimate.point, self._p.oscillation_distance
        if self._anchor is None or not self._anchor.is_nearer(place, distance):
            self._anchor, pursuit.last_progress = place, state.instant
            pursuit.reset_recoveries(AbortReason.NO_PROGRESS)

    def _is_retreating(self, instant: Instant, here: Pose, bumped: bool) -> bool:
        """Return True while the robot must back away."""
        stuck = self._stuck
        if self._retreat is None:
            if not (bumped or stuck) or not self._local.free_behind(here, self._p.retreat, touching=stuck):
                return False
            self._retreat = _Retreat(instant, here.point)
            self._counts.record_retreat()
        distance_left = self._p.retreat - self._retreat.touched.distance_to(here.point)
        in_time = instant - self._retreat.begun < self._p.retreat_patience
        if distance_left > 0.0 and in_time and self._local.free_behind(here, distance_left, touching=stuck):
            return True
        self._retreat, self._stuck = None, False
        return False

    def _set_phase(self, phase: GoalPhase, instant: Instant) -> Twist:
        """Set the phase of the active goal; return STILL."""
        assert self.goal is not None
        if self.goal.phase is not phase:
            self.goal = self.goal._replace(phase=phase, since=instant)
            self._counts.record_phase(phase)
        return STILL

    def _restart_pursuit(self) -> None:
        """Reset the pursuit of the current goal."""
        self._counts.record_interruption()
        self._pursuit = self.plan = None
        self._retreat = None

    def _end_goal(self, status: GoalStatus, reason: AbortReason | None = None) -> Twist:
        """End the goal; return STILL."""
        assert self.goal is not None
        self.goal = Goal(self.goal.point, status, reason)
        self._counts.record_end(status, reason)
        self._pursuit = self.plan = None
        return STILL
