"""Drives along a plan as dwa_local_planner of ROS Indigo: by `dwa` up to the goal, then it turns to its
heading.

As DWAPlannerROS::computeVelocityCommands (dwa_planner_ros.cpp), DWAPlanner (dwa_planner.cpp) and
LatchedStopRotateController (base_local_planner/src/latched_stop_rotate_controller.cpp) of
ros-planning/navigation, branch indigo-devel.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Instant, in_seconds
from actors.robot.cost_maps.cost_map import CostMap
from actors.robot.local_planning.dwa import CRITICS, CheapestVelocity
from actors.robot.local_planning.dwa_parameters import DwaParameters
from actors.robot.local_planning.local_plan import chosen
from actors.robot.local_planning.steering import NOWHERE, BaseLocalPlanner, Steering, reachable
from actors.robot_model import DriveParameters
from deeco.knowledge import made

_PER_STEP: Final = 0.5
"""Path and goal weigh bias · cell · ½ per cell of distance (DWAPlanner::reconfigure)."""
_GOAL_HEADING: Final = 0.0
"""The chapter's robots ask for it at every goal, rad, map frame: driveRobot of CleanerRobot in
d3scomp/deeco-adaptation-testbed sends the quaternion (0, 0, 0, 1)."""
_ALL: Final = np.zeros(4, np.bool_)
"""No direction is barred."""


class DwaLocalPlanner(BaseLocalPlanner):
    """The local planner of preset `chapter`."""

    def __init__(self, local: CostMap, limits: DriveParameters, parameters: DwaParameters) -> None:
        """`local` is kept up to date by whoever owns it; `limits`: of the base."""
        super().__init__(local, parameters)
        p = parameters
        self._max_speed, self._max_turn = min(p.max_speed, limits.speed), min(p.max_turn, limits.turn_rate)
        self._acceleration = min(p.acceleration, limits.acceleration)
        self._turn_acceleration = min(p.turn_acceleration, limits.turn_acceleration)
        self._critics = _critics(p, self._cell, self._max_speed)
        self._alignment = float(self._critics["alignment"][0])
        self._outline = local.outline / self._cell
        inscribed = local.inflation.inscribed / self._cell
        self._limit = inscribed * inscribed
        self._end = 0.0, 0.0
        """Of the plan, m, map frame."""
        self._arrived = False
        """It has been near enough to the plan's end since the plan was new."""

    def begin(self) -> None:
        """The robot is to go somewhere else now: forget the plan, the command, and how it came about."""
        super().begin()
        self._arrived = False

    def follow(self, way: NDArray[np.float64]) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame; nothing is barred at first."""
        super().follow(way)
        self._end = float(way[-1, 0]), float(way[-1, 1])
        self._oscillation.forget()
        self._arrived = False

    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """True if it has been near the plan's end, has the goal's heading, and stands."""
        return (
            self._near_end(estimate)
            and abs(_astray(estimate)) <= self._p.heading_tolerance
            and self._stands(velocity)
        )

    def _near_end(self, estimate: Pose) -> bool:
        if self._way.size and not self._arrived:
            x, y = self._end[0] - estimate.x, self._end[1] - estimate.y
            self._arrived = x * x + y * y <= self._p.goal_tolerance * self._p.goal_tolerance
        return self._arrived

    def _stands(self, velocity: Twist) -> bool:
        return abs(velocity.omega) <= self._p.stopped_turn and abs(velocity.vx) <= self._p.stopped_speed

    def dynamic_window(
        self, here: Pose, estimate: Pose, velocity: Twist, barred: NDArray[np.bool_]
    ) -> CheapestVelocity:
        """The choice among the velocities within reach, wherever the goal is; as for `steer`.

        `barred`: (4,), True if forward, backward, left turn, right turn must not be.
        """
        return self._cheapest(here, estimate, self._window(velocity), barred)

    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        if self._near_end(estimate):
            return self._finish(here, estimate, velocity)
        choice = self.dynamic_window(here, estimate, velocity, self._oscillation.barred)
        if choice.cost < 0.0:
            return NOWHERE
        self._oscillation.note(here, choice.speed, choice.turn)
        return made(Steering, (made(Twist, (choice.speed, 0.0, choice.turn)), True))

    def _cheapest(
        self, here: Pose, estimate: Pose, window: tuple[float, float, float, float], barred: NDArray[np.bool_]
    ) -> CheapestVelocity:
        """Among velocities in `window`: least and greatest speed, m/s, and turn rate, rad/s."""
        local, p, cell = self._local, self._p, self._cell
        corner = local.corner
        found: tuple[float, float, float] = chosen(
            self._way,
            np.array([*estimate, *here, corner.column * cell, corner.row * cell, *window]),
            p.forward_point,
            (p.speed_samples, p.turn_samples),
            barred,
            local.squared,
            self._limit,
            local.table,
            self._outline,
            self._critics,
            self._alignment,
        )
        return made(CheapestVelocity, found)

    def _window(self, velocity: Twist) -> tuple[float, float, float, float]:
        """The least and greatest speed, m/s, and turn rate, rad/s, within reach.

        As SimpleTrajectoryGenerator::initialise.
        """
        p, period = self._p, in_seconds(self._p.period)
        gain, turn_gain = self._acceleration * period, self._turn_acceleration * period
        vx, omega = float(np.float32(velocity.vx)), float(np.float32(velocity.omega))
        return (
            *reachable(vx, gain, p.min_speed, self._max_speed),
            *reachable(omega, turn_gain, -self._max_turn, self._max_turn),
        )

    def _finish(self, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """Near the goal: stand, then turn to its heading (computeVelocityCommandsStopRotate)."""
        astray = _astray(estimate)
        if abs(astray) <= self._p.heading_tolerance:
            self._turning = False
            return Steering(STILL, True)
        if not self._turning and not self._stands(velocity):
            return self._checked(here, estimate, self._slower(velocity))
        self._turning = True
        return self._checked(here, estimate, Twist(0.0, 0.0, self._turn(astray, velocity.omega)))

    def _slower(self, velocity: Twist) -> Twist:
        """As slow as the base can be a period later."""
        period = in_seconds(self._p.period)
        vx = max(0.0, abs(velocity.vx) - self._acceleration * period)
        omega = max(0.0, abs(velocity.omega) - self._turn_acceleration * period)
        return Twist(math.copysign(vx, velocity.vx), 0.0, math.copysign(omega, velocity.omega))

    def _turn(self, astray: float, omega: float) -> float:
        """How fast to turn by that angle, rad/s: so that it can be stopped at its end (rotateToGoal)."""
        least, gain = self._p.least_turn, self._turn_acceleration * in_seconds(self._p.period)
        wanted = min(self._max_turn, max(least, abs(astray)))
        wanted = min(max(wanted, abs(omega) - gain), abs(omega) + gain)
        wanted = min(math.sqrt(2.0 * self._turn_acceleration * abs(astray)), wanted)
        return math.copysign(min(self._max_turn, max(least, wanted)), astray)

    def _checked(self, here: Pose, estimate: Pose, twist: Twist) -> Steering:
        """This velocity, if no critic refuses it; below both least speeds none looks (checkTrajectory)."""
        self._oscillation.forget()
        slow = abs(twist.vx) < self._p.least_speed and abs(twist.omega) < self._p.least_turn
        if slow or twist == STILL:
            return Steering(twist, True)
        window = twist.vx, twist.vx, twist.omega, twist.omega
        if self._cheapest(here, estimate, window, _ALL).cost < 0.0:
            return NOWHERE
        return Steering(twist, True)


def _astray(estimate: Pose) -> float:
    """From the heading to that of the goal, rad."""
    return wrap(_GOAL_HEADING - estimate.heading)


def _critics(p: DwaParameters, cell: float, most_speed: float) -> NDArray[np.void]:
    """The parameters in the units of the kernel."""
    path, goal = cell * p.path_bias * _PER_STEP, cell * p.goal_bias * _PER_STEP
    critics = np.zeros(1, CRITICS)
    critics[["path", "alignment", "goal", "front"]] = (path, path, goal, goal)
    critics["obstacle"] = cell * p.occdist_scale
    critics["nose"], critics["cell"] = p.forward_point / cell, cell
    critics["horizon"], critics["stride"] = p.sim_time, p.granularity
    critics["turn_stride"] = p.angular_granularity
    critics["least_speed"], critics["least_turn"] = p.least_speed, p.least_turn
    critics["most_speed"] = most_speed
    return critics
