"""Drives along a plan by the dynamic window approach, as ros-planning/navigation's dwa_local_planner."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import Cell
from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Duration, Instant, in_seconds
from actors.portable import cos_sin, hypot
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.dwa import WEIGHTS, Fields, best, squared_at
from actors.robot.navigation.dwa_parameters import DwaParameters
from actors.robot.navigation.map_grid import bearing, cut, detour, free_goal, wavefront
from actors.robot.navigation.oscillation import OscillationCritic
from actors.robot_model import DriveParameters

_PER_STEP: Final = 0.5
"""Path and goal weigh bias · cell · ½ per cell of distance: dwa_planner.cpp of ROS Indigo."""


class Steering(NamedTuple):
    """What to command now."""

    twist: Twist
    valid: bool
    """False without any valid trajectory, or without a plan or a scan to find one with; `twist` is STILL."""


_NOWHERE: Final = Steering(STILL, False)


class Cycle(NamedTuple):
    """One choice of the local planner: what it was made from, and what was chosen."""

    instant: Instant
    here: Pose
    """The body's pose, m and rad, odometry frame."""
    estimate: Pose
    """The same, map frame."""
    velocity: Twist
    """The base's own."""
    way: NDArray[np.float64]
    """(n, 2): the plan, m, map frame."""
    corner: Cell
    """Row and column of the window's south-west cell, counted from the odometry frame's origin."""
    costs: NDArray[np.uint8]
    """(rows, columns) of the window, row 0 the southernmost: costs as costmap_2d has them."""
    turning: bool
    """True while the robot turns on the spot to where the plan leads."""
    steering: Steering


class _Outlook(NamedTuple):
    """What there is to choose by in one cycle."""

    fields: Fields
    goal: float
    """How far the local goal is, cells."""
    bearing: float
    """Where the plan leads, rad, from the robot's heading."""


class DwaLocalPlanner:
    """Follows one plan at a time."""

    def __init__(
        self, local: CostMap, radius: float, limits: DriveParameters, parameters: DwaParameters
    ) -> None:
        """`local` is kept up to date by whoever owns it; `radius`: of the body, m; `limits`: of the base."""
        self._local = local
        self._p = p = parameters
        self._max_speed = min(p.max_speed, limits.speed)
        self._min_speed = max(p.min_speed, -limits.speed)
        self._max_turn = min(p.max_turn, limits.turn_rate)
        self._gain = min(p.acceleration, limits.acceleration) * in_seconds(p.period)
        self._turn_gain = min(p.turn_acceleration, limits.turn_acceleration) * in_seconds(p.period)
        self._cell = local.parameters.cell
        self._weights = _weights(p, self._cell, radius, local.parameters.padding, limits)
        self._alignment = float(self._weights["alignment"][0])
        self._table: NDArray[np.float64] = np.multiply(
            local.table, p.occdist_scale * self._cell, dtype=np.float64
        )
        self._table.setflags(write=False)  # as the fingerprint's: the kernel is compiled for that
        inscribed = local.inflation.inscribed / self._cell
        self._limit = inscribed * inscribed
        self._oscillation = OscillationCritic(p.oscillation_distance, p.oscillation_angle, p.least_speed)
        self._untrusted = np.zeros(local.squared.shape, np.uint8)
        self._way: NDArray[np.float64] = np.zeros((0, 2))
        self._nearest = 0
        self._turning = False
        self._due: Instant | None = None
        self._held = _NOWHERE
        self.witness: Callable[[Cycle], None] | None = None
        """Is told of every cycle; for those who execute a robot again to look into it."""

    def begin(self) -> None:
        """The robot is to go somewhere else now: forget the plan, the command, and how it came about."""
        self._way = np.zeros((0, 2))
        self._oscillation.forget()
        self._turning = False
        self._due, self._held = None, _NOWHERE

    def follow(self, way: NDArray[np.float64]) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame."""
        self._way = way
        self._nearest = 0

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """What to command at `instant`; a new choice once a period, otherwise the last one again.

        `here` and `estimate`: the body's pose at that instant, in the odometry frame, to which the local map
        has been rolled, and in the map frame. `velocity`: the base's own.
        """
        p = self._p
        if not self._local.age(instant) <= in_seconds(p.scan_patience):
            self._due, self._held = None, _NOWHERE
            return self._held
        if self._due is None or instant >= self._due:
            since = Duration(0) if self._due is None else Duration((instant - self._due) % p.period)
            self._due = Instant(instant - since + p.period)
            self._held = self._choose(instant, here, estimate, velocity)
            if self.witness is not None:
                local = self._local
                given = instant, here, estimate, velocity, self._way, local.corner, local.costs()
                self.witness(Cycle(*given, self._turning, self._held))
        return self._held

    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """One cycle of the local planner."""
        if not self._way.size:
            return _NOWHERE
        cell, corner = self._cell, self._local.corner
        body = np.array([here.x / cell - corner.column, here.y / cell - corner.row, here.heading])
        side = self._untrusted.shape[0]
        self._nearest, ended, cells = cut(
            self._way, self._nearest, self._motion(here, estimate), body, side, side / 2
        )
        outlook = self._outlook(instant, body, cells, ended) if cells.size else None
        if outlook is None:
            return _NOWHERE
        self._turning, fields = self._turns(outlook.bearing), outlook.fields
        self._weigh(outlook.goal, ended)
        too_near = squared_at(fields.squared, body[0], body[1]) <= self._limit
        choice = best(
            body,
            self._window(velocity, too_near),
            (self._p.speed_samples, self._p.turn_samples),
            self._oscillation.barred,
            fields,
            self._table,
            self._weights,
        )
        if choice.score < 0.0:
            return _NOWHERE
        speed = choice.speed * cell
        self._oscillation.note(here, speed, choice.turn)
        return Steering(Twist(speed, 0.0, choice.turn), True)

    def _outlook(
        self, instant: Instant, body: NDArray[np.float64], cells: NDArray[np.int32], ended: bool
    ) -> _Outlook | None:
        """What the plan's `cells` in the window lead to; None if that is out of reach.

        `ended`: they end where the plan does.
        """
        squared, side = self._local.squared, self._untrusted.shape[0]
        goal = (int(cells[-1, 0]), int(cells[-1, 1]))
        if ended or self._p.goal_setback:
            goal = free_goal(squared, self._limit, cells, self._p.goal_slack / self._cell if ended else -1.0)
        to_goal = wavefront(squared, self._limit, np.array([goal], np.int32))
        if detour(to_goal, cells, body) > self._p.detour / self._cell:
            return None
        nose = self._p.forward_point / self._cell
        dx, dy = goal[1] + 0.5 - body[0], goal[0] + 0.5 - body[1]
        front = _ahead(goal, dx, dy, nose, side)
        fields = Fields(
            squared,
            wavefront(squared, self._limit, cells),
            to_goal,
            wavefront(squared, self._limit, np.array([front], np.int32)),
            self._local.trusted(instant) if self._min_speed < 0.0 else self._untrusted,
        )
        return _Outlook(fields, hypot(dx, dy), bearing(squared, self._limit, cells, body, nose))

    def _window(self, velocity: Twist, too_near: bool) -> NDArray[np.float64]:
        """The velocities within reach: lowest and highest speed, cells/s, and turn rate, rad/s."""
        most = max(0.0, velocity.vx - self._gain) if self._turning else self._max_speed
        least = self._min_speed if too_near else max(self._min_speed, 0.0)
        speeds = _reachable(velocity.vx, self._gain, min(least, most), most)
        turns = _reachable(velocity.omega, self._turn_gain, -self._max_turn, self._max_turn)
        return np.array([speeds[0] / self._cell, speeds[1] / self._cell, *turns])

    def _weigh(self, apart: float, ended: bool) -> None:
        """Set the weights that change with how far the local goal is, cells."""
        # near the goal the nose is beyond it: to keep it on the plan would turn the robot round
        self._weights["alignment"] = self._alignment if apart > self._p.forward_point / self._cell else 0.0
        self._weights["goal_distance"] = apart if ended and not self._p.overshoot else math.inf

    def _turns(self, angle: float) -> bool:
        """True if it turns on the spot now: from too large an angle on until it is half of that."""
        least = self._p.spot_angle * (0.5 if self._turning else 1.0)
        return abs(angle) > least

    def _motion(self, here: Pose, estimate: Pose) -> NDArray[np.float64]:
        """From the map frame to the window: see `cut`."""
        turn = wrap(here.heading - estimate.heading)
        c, s = cos_sin(turn)
        x = here.x - (c * estimate.x - s * estimate.y)
        y = here.y - (s * estimate.x + c * estimate.y)
        corner, cell = self._local.corner, self._cell
        return np.array([c, s, x - corner.column * cell, y - corner.row * cell, 1.0 / cell])


def _reachable(value: float, gain: float, low: float, high: float) -> tuple[float, float]:
    """The dynamic window: what is within `gain` of `value` and within the limits; else the nearest limit."""
    return min(max(value - gain, low), high), max(min(value + gain, high), low)


def _ahead(goal: tuple[int, int], dx: float, dy: float, nose: float, side: int) -> tuple[int, int]:
    """The cell `nose` cells beyond the goal in the direction (dx, dy), or the window's last on the way."""
    apart = hypot(dx, dy)
    row, column = goal
    if apart == 0.0:
        return goal
    for step in range(1, math.ceil(nose) + 1):
        ahead = min(float(step), nose) / apart
        next_row, next_column = math.floor(goal[0] + 0.5 + ahead * dy), math.floor(goal[1] + 0.5 + ahead * dx)
        if not (0 <= next_row < side and 0 <= next_column < side):
            break
        row, column = next_row, next_column
    return row, column


def _weights(
    p: DwaParameters, cell: float, radius: float, padding: float, limits: DriveParameters
) -> NDArray[np.void]:
    """The parameters in the units of the kernel."""
    path, goal = p.path_bias * cell * _PER_STEP, p.goal_bias * cell * _PER_STEP
    weights = np.zeros(1, WEIGHTS)
    weights[["path", "alignment", "goal", "front"]] = (path, path, goal, goal)
    weights["nose"] = p.forward_point / cell
    weights["horizon"], weights["stop_buffer"] = p.sim_time, p.stop_buffer
    weights["stride"], weights["turn_stride"] = p.granularity / cell, p.angular_granularity
    weights["deceleration"] = min(p.acceleration, limits.acceleration) / cell
    weights["radius"], weights["padding"] = radius / cell, padding / cell
    weights["scaling_speed"] = p.scaling_speed / cell
    weights["scaling_range"] = max(min(p.max_speed, limits.speed) - p.scaling_speed, cell) / cell
    weights["scaling_factor"] = p.max_scaling_factor
    weights["least_speed"], weights["least_turn"] = p.least_speed / cell, p.least_turn
    weights["escape"], weights["nose_barred"] = p.escape / cell, p.nose_barred
    return weights
