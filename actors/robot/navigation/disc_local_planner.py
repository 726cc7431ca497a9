"""Local planner of preset `robust`: own dynamic window approach for a disc."""

import math
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats, Int32s
from actors.geometry import Pose, Twist, wrap
from actors.instant import Instant
from actors.portable import atan2, cos_sin, hypot
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.disc_dwa import WEIGHTS, CriticFields, best_velocity, squared_at
from actors.robot.navigation.map_grid import Waves, bearing, clip_path, detour, free_goal, wavefront
from actors.robot.navigation.ray_tracing import half_gaps
from actors.robot.navigation.steering import (
    NO_COMMAND,
    BaseLocalPlanner,
    DwaParameters,
    Steering,
    reachable_range,
)
from actors.robot_model import DriveParameters

_BEHIND: Final = 0.75 * math.pi
"""Bearing from which the robot may turn to either side, rad."""
_BOUNDLESS: Final = np.empty((0, 3))
_NOTHING: Final = np.zeros(4, np.bool_)
"""No barred direction."""


class _CriticInputs(NamedTuple):
    """Inputs of the critics in one cycle."""

    fields: CriticFields
    goal: float
    """Distance of the local goal, cells."""
    bearing: float
    """Bearing of the plan relative to the heading, rad."""
    aside: float
    """Angle between the plan and the local goal, rad; 0 if the plan is blocked."""
    ended: bool
    """True if the local goal is the plan's end."""


class DiscLocalPlanner(BaseLocalPlanner):
    """The local planner of preset `robust`."""

    def __init__(
        self, local: CostMap, radius: float, limits: DriveParameters, parameters: DwaParameters
    ) -> None:
        """Create a planner; the caller updates `local`. `radius`: of the body, m; `limits`: of the base."""
        super().__init__(local, limits, parameters)
        p, cell, padding = parameters, self._cell, local.parameters.padding
        self._min_speed = max(p.min_speed, -limits.speed)
        self._weights = self._record(
            WEIGHTS,
            horizon=p.sim_time,
            stop_buffer=p.stop_buffer,
            stride=p.granularity / cell,
            turn_stride=p.angular_granularity,
            deceleration=self._acceleration / cell,
            radius=radius / cell,
            padding=padding / cell,
            scaling_speed=p.scaling_speed / cell,
            scaling_range=max(self._max_speed - p.scaling_speed, cell) / cell,
            scaling_factor=p.max_scaling_factor,
            least_speed=p.least_speed / cell,
            least_turn=p.least_turn,
            escape=p.escape / cell,
        )
        self._alignment, self._front = (float(self._weights[name][0]) for name in ("alignment", "front"))
        self._table: Floats = np.multiply(local.table, p.occdist_scale * cell, dtype=np.float64)
        self._table.setflags(write=False)  # like that of the fingerprint, for which the kernel is compiled
        self._untrusted = np.zeros(local.squared.shape, np.uint8)
        self._farthest = self._max_speed * (p.stop_buffer + 0.5 * self._max_speed / self._acceleration) / cell
        """Stopping distance at full speed, cells."""
        self._nearest = 0

    def follow(self, path: Floats) -> None:
        """Follow `path` from now on: (n, 2), n ≥ 1, m, map frame."""
        super().follow(path)
        self._nearest = 0

    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """Return True near the plan's end, at any speed."""
        end = self._path[-1] if self._path.size else (math.inf, math.inf)
        return hypot(end[0] - estimate.x, end[1] - estimate.y) <= self._p.goal_tolerance

    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        body = self._body(here)
        side = self._untrusted.shape[0]
        self._nearest, ended, cells = clip_path(
            self._path, self._nearest, self._motion(here, estimate), body, side, side / 2
        )
        inputs = self._inputs(instant, body, cells, ended) if cells.size else None
        if inputs is None:
            return NO_COMMAND
        self._turning, fields = self._is_spot_turn(inputs.bearing), inputs.fields
        self._weigh(inputs)
        too_near = squared_at(fields.squared, body[0], body[1]) <= self._limit
        window, barred = self._window(velocity, too_near), self._oscillation.barred
        if self._turning and self._p.spot_rate:
            window[2:] = self._spot_turn(inputs.bearing, velocity.omega)
            barred = _NOTHING
        speed, turn, score = best_velocity(
            body,
            window,
            (self._p.speed_samples, self._p.turn_samples),
            barred,
            self._bounds(instant, body),
            fields,
            self._table,
            self._weights,
        )
        if score < 0.0:
            return NO_COMMAND
        speed *= self._cell
        self._oscillation.note(here, speed, turn)
        return Steering(Twist(speed, 0.0, turn), True)

    def _inputs(self, instant: Instant, body: Floats, cells: Int32s, ended: bool) -> _CriticInputs | None:
        """Return the critics' inputs for the plan's `cells` in the window; None if their end is unreachable.

        `ended`: True if they include the plan's end.
        """
        squared, side = self._local.squared, self._untrusted.shape[0]
        goal = free_goal(squared, self._limit, cells, self._p.goal_slack / self._cell if ended else -1.0)
        to_goal = wavefront(squared, self._limit, np.array([goal], np.int32))
        more = detour(to_goal, cells, body)
        if more > self._p.detour / self._cell:
            return None
        if 0.0 < self._p.shortcut < -more * self._cell and cells.shape[0] > 1:
            return self._inputs(instant, body, cells[: cells.shape[0] // 2], False)
        nose = self._p.forward_point / self._cell
        dx, dy = goal[1] + 0.5 - body[0], goal[0] + 0.5 - body[1]
        front = _ahead(goal, dx, dy, nose, side)
        to_front = wavefront(squared, self._limit, np.array([front], np.int32))
        waves = Waves(wavefront(squared, self._limit, cells), to_goal, to_front)
        trusted = self._local.trusted(instant) if self._min_speed < 0.0 else self._untrusted
        leads = bearing(squared, self._limit, cells, body, nose)
        aside = abs(wrap(atan2(dy, dx) - body[2] - leads)) if leads else 0.0
        return _CriticInputs(CriticFields(squared, waves, trusted), hypot(dx, dy), leads, aside, ended)

    def _bounds(self, instant: Instant, body: Floats) -> Floats:
        """Return the bounds of the stopping distance due to moving marks; see `half_gaps`."""
        local = self._local
        if not local.arrivals.size:
            return _BOUNDLESS
        since = instant - local.parameters.moving_memory
        room = math.sqrt(self._limit)
        return half_gaps(local.squared, local.arrivals, since, body, room, self._farthest)

    def _window(self, velocity: Twist, too_near: bool) -> Floats:
        """Return the dynamic window: lowest and highest speed, cells/s, and turn rate, rad/s."""
        most = max(0.0, velocity.vx - self._gain) if self._turning else self._max_speed
        least = self._min_speed if too_near else max(self._min_speed, 0.0)
        speeds = reachable_range(velocity.vx, self._gain, min(least, most), most)
        turns = reachable_range(velocity.omega, self._turn_gain, -self._max_turn, self._max_turn)
        return np.array([speeds[0] / self._cell, speeds[1] / self._cell, *turns])

    def _spot_turn(self, angle: float, turn: float) -> float:
        """Return the rate for turning on the spot by `angle`, rad, at the current rate `turn`, rad/s.

        The robot keeps its direction of turning towards targets behind it.
        """
        side = turn if abs(angle) > _BEHIND and abs(turn) > self._p.least_turn / 2 else angle
        most = min(self._p.spot_rate, self._max_turn, math.sqrt(2.0 * self._turn_acceleration * abs(angle)))
        wanted = math.copysign(max(most, self._p.least_turn), side)
        rate = min(max(wanted, turn - self._turn_gain), turn + self._turn_gain)
        return min(max(rate, -self._max_turn), self._max_turn)

    def _weigh(self, inputs: _CriticInputs) -> None:
        """Set the weights that depend on the local goal."""
        # near the goal the nose is beyond it: aligning it with the plan would turn the robot around
        near = inputs.goal <= self._p.forward_point / self._cell
        self._weights["alignment"] = 0.0 if near else self._alignment
        # a goal behind a wall's end would attract the nose into the wall
        self._weights["front"] = 0.0 if inputs.aside > self._p.front_angle else self._front
        self._weights["goal_distance"] = inputs.goal if inputs.ended else math.inf

    def _is_spot_turn(self, angle: float) -> bool:
        """Return True if the robot turns on the spot: from `spot_angle` until half of it."""
        least = self._p.spot_angle * (0.5 if self._turning else 1.0)
        return abs(angle) > least

    def _body(self, here: Pose) -> Floats:
        """Return x and y in the window, cells, and heading, rad."""
        corner = self._local.corner
        return np.array([here.x / self._cell - corner.column, here.y / self._cell - corner.row, here.heading])

    def _motion(self, here: Pose, estimate: Pose) -> Floats:
        """Return the transformation from the map frame to the window; see `clip_path`."""
        turn = wrap(here.heading - estimate.heading)
        c, s = cos_sin(turn)
        x = here.x - (c * estimate.x - s * estimate.y)
        y = here.y - (s * estimate.x + c * estimate.y)
        corner, cell = self._local.corner, self._cell
        return np.array([c, s, x - corner.column * cell, y - corner.row * cell, 1.0 / cell])


def _ahead(goal: tuple[int, int], dx: float, dy: float, nose: float, side: int) -> tuple[int, int]:
    """Return the cell `nose` cells beyond the goal along (dx, dy), or the last one in the window."""
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
