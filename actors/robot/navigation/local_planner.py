"""Local planner of preset `chapter`: dwa_local_planner of ROS Indigo.

Drives to the goal with `dwa`, then turns to its heading. As DWAPlannerROS::computeVelocityCommands
(dwa_planner_ros.cpp), DWAPlanner (dwa_planner.cpp) and LatchedStopRotateController
(base_local_planner/src/latched_stop_rotate_controller.cpp) of ros-planning/navigation, branch indigo-devel.
"""

import math
from typing import Final

import numpy as np

from actors.array_types import Flags, Floats, Int16s, Int32s, Octets, Records
from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Instant
from actors.kernels import kernel
from actors.portable.compiled import cos_sin, hypot
from actors.robot.navigation.cost_map import CostMap
from actors.robot.navigation.dwa import (
    CRITICS,
    INVALID,
    CheapestVelocity,
    cheapest_velocity,
    example,
    samples,
)
from actors.robot.navigation.map_grid import Waves, wavefront
from actors.robot.navigation.steering import (
    NO_COMMAND,
    BaseLocalPlanner,
    DwaParameters,
    Steering,
)
from actors.robot_model import DriveParameters
from deeco.knowledge import new_tuple


@kernel
def _part_in_window(path: Floats, robot: Floats, reach: float) -> tuple[int, int]:
    """Return the index of the path's first point in the window and of the first point after it."""
    first = 0
    while first < path.shape[0]:
        dx, dy = robot[0] - path[first, 0], robot[1] - path[first, 1]
        if dx * dx + dy * dy <= reach * reach:
            break
        first += 1
    last = first
    while last < path.shape[0]:
        dx, dy = robot[0] - path[last, 0], robot[1] - path[last, 1]
        last += 1
        if dx * dx + dy * dy > reach * reach:
            break
    return first, last


@kernel
def _write_cells(points: Floats, cell: float, corner: Floats, side: int, cells: Int32s) -> int:
    """Write the cells of points, m, interpolated if they are more than a cell apart; return their number.

    From the first point in the window to the last one before the path leaves it.
    """
    count = 0
    for k in range(points.shape[0]):
        steps = 1
        if k > 0:
            dx, dy = points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]
            if dx * dx + dy * dy > cell * cell:
                steps = math.ceil(math.sqrt(dx * dx + dy * dy) / cell)
        for step in range(1, steps + 1):
            x, y = points[k, 0], points[k, 1]
            if step < steps:
                x = points[k - 1, 0] + step * (dx / steps)
                y = points[k - 1, 1] + step * (dy / steps)
            x, y = (x - corner[0]) / cell, (y - corner[1]) / cell
            inside = 0.0 <= x < side and 0.0 <= y < side
            if not inside and count > 0:
                return count
            if inside and count < cells.shape[0]:
                cells[count, 0], cells[count, 1] = int(y), int(x)
                count += 1
    return count


@kernel
def _to_odometry_frame(path: Floats, estimate: Floats, here: Floats) -> Floats:
    """Return the points in the odometry frame."""
    c, s = cos_sin(here[2] - estimate[2])
    x = here[0] - (c * estimate[0] - s * estimate[1])
    y = here[1] - (s * estimate[0] + c * estimate[1])
    points = np.empty_like(path)
    for k in range(path.shape[0]):
        points[k, 0] = c * path[k, 0] - s * path[k, 1] + x
        points[k, 1] = s * path[k, 0] + c * path[k, 1] + y
    return points


@kernel
def local_plan(
    path: Floats, estimate: Floats, here: Floats, corner: Floats, cell: float, side: int, nose: float
) -> tuple[Int32s, Int32s, Int32s, bool]:
    """Return the part of `path` from its first point within half a window of the robot to the first beyond.

    As rows and columns: (k, 2) cells of the part; (1, 2) its last cell; (1, 2) the last cell if the plan is
    extended by the nose; and whether its end is farther than the nose. For k = 0 the rest is meaningless.
    `path`: (n, 2), n ≥ 1, m, map frame. `estimate`, `here`: pose in the map frame and in the odometry frame;
    `corner`: of the window in the latter, m. `side`: of the window, cells. `nose`: distance from the centre,
    m.
    """
    first, last = _part_in_window(path, estimate, side * cell / 2)
    points = _to_odometry_frame(path[first:last], estimate, here)
    room = math.ceil(nose / cell) + 2
    for k in range(1, points.shape[0]):
        room += 1 + math.ceil(hypot(points[k, 0] - points[k - 1, 0], points[k, 1] - points[k - 1, 1]) / cell)
    cells = np.empty((min(room, side * side), 2), np.int32)
    count = _write_cells(points, cell, corner, side, cells)
    if count == 0:
        return cells[:0], cells[:0], cells[:0], False
    end_x, end_y = points[-1, 0], points[-1, 1]
    apart = hypot(end_x - here[0], end_y - here[1])
    east, north = (1.0, 0.0) if apart == 0.0 else ((end_x - here[0]) / apart, (end_y - here[1]) / apart)
    points[-1, 0], points[-1, 1] = end_x + nose * east, end_y + nose * north
    farther = np.empty_like(cells)
    ahead = _write_cells(points, cell, corner, side, farther)
    front = cells[count - 1 : count] if ahead == 0 else farther[ahead - 1 : ahead]
    return cells[:count], cells[count - 1 : count].copy(), front.copy(), apart > nose


@kernel
def _window(velocity: float, limits: Floats) -> tuple[float, float]:
    """Return the lowest and the highest velocity a period later, as SimpleTrajectoryGenerator::initialise."""
    near = np.float64(np.float32(velocity))  # 32 bits as in the original
    low = min(max(near - limits[0], limits[1]), limits[2])
    high = max(min(near + limits[0], limits[2]), limits[1])
    return np.float64(np.float32(low)), np.float64(np.float32(high))


@kernel
def choose_velocity(
    path: Floats,
    state: Floats,
    limits: Floats,
    nose: float,
    counts: tuple[int, int],
    barred: Flags,
    squared: Int16s,
    limit: float,
    table: Octets,
    outline: Floats,
    critics: Records,
    alignment: float,
) -> tuple[float, float, float]:
    """Return the fields of `CheapestVelocity`; no trajectory is valid if `path` is outside the window.

    `state`, (10,): pose in the map frame and in the odometry frame; corner of the window in the latter, m;
    speed, m/s, and turn rate, rad/s. `limits`, (2, 3), of both: change in a period, lowest, highest.
    `counts`: number of sampled speeds and turn rates. `alignment`: weight of that critic while the plan's end
    is farther than the nose. Other parameters as for `local_plan`, `wavefront` and `cheapest_velocity`.
    """
    cells, goal, front, far = local_plan(
        path, state[0:3], state[3:6], state[6:8], critics[0].cell, squared.shape[0], nose
    )
    if cells.shape[0] == 0:
        return 0.0, 0.0, INVALID
    # near the goal the nose is beyond it: aligning it with the plan would turn the robot around
    critics[0].alignment = alignment if far else 0.0
    to_path, to_goal = wavefront(squared, limit, cells), wavefront(squared, limit, goal)
    waves = Waves(to_path, to_goal, wavefront(squared, limit, front))
    slowest, fastest = _window(state[8], limits[0])
    right, left = _window(state[9], limits[1])
    speeds, turns = samples(slowest, fastest, counts[0]), samples(right, left, counts[1])
    return cheapest_velocity(state[3:8], speeds, turns, barred, squared, waves, table, outline, critics)


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    squared, table, corners, critics = example()
    path = np.column_stack((np.linspace(0.1, 5.0, 90), 0.8 + np.square(np.linspace(0, 1.5, 90))))
    state = np.array([0.4, 0.8, 0.3, 1.115, 2.52, 0.6, -0.5, 0.5, 0.2, 0.0])
    limits, barred = np.array([[0.3, -0.1, 0.6], [1.0, -2.0, 2.0]]), np.zeros(4, np.bool_)
    around = barred, squared, 4.5, table, corners, critics
    found = choose_velocity(path, state, limits, 0.33, (7, 8), *around, 3.2)
    return np.array(found).tobytes()


_GOAL_HEADING: Final = 0.0
"""Heading of every goal of the chapter's robots, rad, map frame: driveRobot of CleanerRobot in
d3scomp/deeco-adaptation-testbed sends the quaternion (0, 0, 0, 1)."""
_ALL: Final = np.zeros(4, np.bool_)
"""No barred direction."""
_UNCHANGED: Final = np.array([[0.0, -math.inf, math.inf]] * 2)
"""Limits of the current velocity only."""


class DwaLocalPlanner(BaseLocalPlanner):
    """The local planner of preset `chapter`."""

    def __init__(self, local: CostMap, limits: DriveParameters, parameters: DwaParameters) -> None:
        """Create a planner; the caller updates `local`. `limits`: of the base."""
        super().__init__(local, limits, parameters)
        p, cell = parameters, self._cell
        self._critics = self._record(
            CRITICS,
            obstacle=cell * p.occdist_scale,
            cell=cell,
            horizon=p.sim_time,
            stride=p.granularity,
            turn_stride=p.angular_granularity,
            least_speed=p.least_speed,
            least_turn=p.least_turn,
            most_speed=self._max_speed,
        )
        self._alignment = float(self._critics["alignment"][0])
        self._outline = local.outline / cell
        turn = self._max_turn
        self._limits = np.array([[self._gain, p.min_speed, self._max_speed], [self._turn_gain, -turn, turn]])
        self._end = 0.0, 0.0
        """End of the plan, m, map frame."""
        self._arrived = False
        """True if the robot has been near the end of the current plan."""

    def begin(self) -> None:
        """Reset plan and oscillations for a new goal."""
        super().begin()
        self._arrived = False

    def follow(self, path: Floats) -> None:
        """Follow `path` from now on: (n, 2), n ≥ 1, m, map frame; no direction is barred initially."""
        super().follow(path)
        self._end = float(path[-1, 0]), float(path[-1, 1])
        self._oscillation.forget()
        self._arrived = False

    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """Return True if the robot has been near the plan's end, has the goal's heading, and stands."""
        return (
            self._is_near_end(estimate)
            and abs(_heading_error(estimate)) <= self._p.heading_tolerance
            and self._is_stopped(velocity)
        )

    def _is_near_end(self, estimate: Pose) -> bool:
        if self._path.size and not self._arrived:
            x, y = self._end[0] - estimate.x, self._end[1] - estimate.y
            self._arrived = x * x + y * y <= self._p.goal_tolerance * self._p.goal_tolerance
        return self._arrived

    def _is_stopped(self, velocity: Twist) -> bool:
        return abs(velocity.omega) <= self._p.stopped_turn and abs(velocity.vx) <= self._p.stopped_speed

    def dynamic_window(self, here: Pose, estimate: Pose, velocity: Twist, barred: Flags) -> CheapestVelocity:
        """Return the cheapest velocity of the dynamic window, for any goal; parameters as for `steer`.

        `barred`: (4,), True if forward, backward, left turn, right turn is barred.
        """
        return self._cheapest(here, estimate, velocity, self._limits, barred)

    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        if self._is_near_end(estimate):
            return self._finish(here, estimate, velocity)
        choice = self._cheapest(here, estimate, velocity, self._limits, self._oscillation.barred)
        if choice.cost < 0.0:
            return NO_COMMAND
        self._oscillation.note(here, choice.speed, choice.turn)
        return new_tuple(Steering, (new_tuple(Twist, (choice.speed, 0.0, choice.turn)), True))

    def _cheapest(
        self, here: Pose, estimate: Pose, velocity: Twist, limits: Floats, barred: Flags
    ) -> CheapestVelocity:
        """Return the cheapest velocity within `limits`, as for `choose_velocity`."""
        local, p, cell = self._local, self._p, self._cell
        corner = local.corner
        found = choose_velocity(
            self._path,
            np.array(
                (*estimate, *here, corner.column * cell, corner.row * cell, velocity.vx, velocity.omega)
            ),
            limits,
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
        return new_tuple(CheapestVelocity, found)

    def _finish(self, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """Stop near the goal, then turn to its heading (computeVelocityCommandsStopRotate)."""
        astray = _heading_error(estimate)
        if abs(astray) <= self._p.heading_tolerance:
            self._turning = False
            return Steering(STILL, True)
        if not self._turning and not self._is_stopped(velocity):
            return self._checked(here, estimate, self._slower(velocity))
        self._turning = True
        return self._checked(here, estimate, Twist(0.0, 0.0, self._turn(astray, velocity.omega)))

    def _slower(self, velocity: Twist) -> Twist:
        """Return the lowest velocity that the base can have a period later."""
        vx = max(0.0, abs(velocity.vx) - self._gain)
        omega = max(0.0, abs(velocity.omega) - self._turn_gain)
        return Twist(math.copysign(vx, velocity.vx), 0.0, math.copysign(omega, velocity.omega))

    def _turn(self, astray: float, omega: float) -> float:
        """Return the turn rate for that angle, rad/s, with time to brake (rotateToGoal)."""
        least, gain = self._p.least_turn, self._turn_gain
        wanted = min(self._max_turn, max(least, abs(astray)))
        wanted = min(max(wanted, abs(omega) - gain), abs(omega) + gain)
        wanted = min(math.sqrt(2.0 * self._turn_acceleration * abs(astray)), wanted)
        return math.copysign(min(self._max_turn, max(least, wanted)), astray)

    def _checked(self, here: Pose, estimate: Pose, twist: Twist) -> Steering:
        """Return this velocity if its trajectory is valid; slow ones are not checked (checkTrajectory)."""
        self._oscillation.forget()
        slow = abs(twist.vx) < self._p.least_speed and abs(twist.omega) < self._p.least_turn
        if slow or twist == STILL:
            return Steering(twist, True)
        if self._cheapest(here, estimate, twist, _UNCHANGED, _ALL).cost < 0.0:
            return NO_COMMAND
        return Steering(twist, True)


def _heading_error(estimate: Pose) -> float:
    """Return the angle from the heading to that of the goal, rad."""
    return wrap(_GOAL_HEADING - estimate.heading)
