"""Follows a path: turns to it on the spot, drives along it, around what stands there, and stops before it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Instant
from actors.robot.aim import aim
from actors.robot.detour import Detour
from actors.robot.planning import Ground
from actors.robot.surroundings import Surroundings


@dataclass(frozen=True)
class DrivingParameters:
    """How the robot follows a path; numbers without a source are own choices, tried on the corridor map."""

    speed: float = 0.5
    """The highest, m/s (d3scomp/ROSRemote, simulation/params: DWA max_vel_x)."""
    turn_rate: float = 1.5
    """The highest, rad/s; the testbed allowed 5, at which 0.1 s of delay is 30°."""
    acceleration: float = 1.0
    """m/s² (same place: acc_lim_x)."""
    turn_acceleration: float = 2.0
    """rad/s² (same place: acc_lim_theta)."""
    braking: float = 0.4
    """Deceleration that stopping is planned with, m/s²: less than half of what the base can do, because what
    is ahead may be a robot that comes as fast."""
    delay: float = 0.2
    """Time from a scan until a command based on it shows, s: one step of 0.1 s for each of two robots."""
    gap: float = 0.08
    """Kept to what is ahead, m."""
    creep: float = 0.05
    """The lowest speed forward that is commanded, m/s."""
    resume: float = 0.15
    """Once blocked, the robot starts again when it may drive that fast, m/s."""
    lookahead: float = 0.5
    """The robot heads for a point of the path so far ahead, m."""
    turn_gain: float = 2.0
    """Turn rate per angle to that point, 1/s."""
    turn_angle: float = 0.7
    """From this angle on the robot turns on the spot, rad; below, it drives the slower the larger it is."""
    scan_patience: float = 0.5
    """Without a scan for so long the robot does not drive, s; five periods of a sensor of 10 Hz."""


class Steering(NamedTuple):
    """The velocity to command, and whether something keeps the robot from driving on."""

    twist: Twist
    blocked: bool


class Driver:
    """Follows one path at a time."""

    def __init__(
        self,
        ground: Ground,
        surroundings: Surroundings,
        radius: float,
        step: float,
        parameters: DrivingParameters,
    ) -> None:
        """`radius`: of the body, m; `step`: for how long a command holds, s."""
        self._surroundings = surroundings
        self._detour = Detour(ground, surroundings, radius, step)
        self._radius = radius
        self._step = step
        self._p = parameters
        self._clearance = ground.clearance
        self._need = ground.reach
        self._frame = np.array([*ground.grid.origin, ground.grid.resolution])
        self._way: NDArray[np.float64] = np.zeros((1, 2))
        self._index = 0
        self._blocked = False

    def begin(self) -> None:
        """Forget what kept the robot from driving: it is to go somewhere else now."""
        self._blocked = False

    def follow(self, way: NDArray[np.float64]) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame."""
        self._way = way
        self._index = 0

    def steer(self, instant: Instant, pose: Pose, velocity: Twist) -> Steering:
        """What to command at `pose` and `velocity`, the base's own, to get on along the path."""
        if self._surroundings.age(instant) > self._p.scan_patience:
            self._blocked = True
            return Steering(STILL, True)
        self._index, x, y = aim(
            self._way,
            self._index,
            pose.x,
            pose.y,
            self._p.lookahead,
            self._clearance,
            self._frame,
            self._need,
        )
        x, y = self._detour.around(pose, self._way, self._index, x, y)
        angle = wrap(math.atan2(y - pose.y, x - pose.x) - pose.heading)
        omega = self._turn(angle, velocity.omega)
        wanted = self._speed(angle, pose)
        if wanted < self._p.creep:
            return Steering(Twist(0.0, 0.0, omega), False)
        allowed = self._allowed(omega / wanted)
        self._blocked = allowed < (self._p.resume if self._blocked else self._p.creep)
        if self._blocked:
            return Steering(Twist(0.0, 0.0, omega), True)
        reached = max(self._p.creep, velocity.vx + self._p.acceleration * self._step)
        return Steering(Twist(min(wanted, allowed, reached), 0.0, omega), False)

    def _turn(self, angle: float, omega: float) -> float:
        """The turn rate that brings the robot to face `angle`, rad, without turning past it."""
        p = self._p
        size = min(p.turn_rate, p.turn_gain * abs(angle), math.sqrt(p.turn_acceleration * abs(angle)))
        wanted = math.copysign(size, angle)
        change = p.turn_acceleration * self._step
        return min(max(wanted, omega - change), omega + change)

    def _speed(self, angle: float, pose: Pose) -> float:
        """The speed that the angle to the path and the rest of it allow."""
        p = self._p
        end_x, end_y = self._way[-1]
        rest = math.hypot(end_x - pose.x, end_y - pose.y)
        return min(
            p.speed * max(0.0, 1.0 - abs(angle) / p.turn_angle),
            math.sqrt(2.0 * p.braking * rest),
        )

    def _allowed(self, curvature: float) -> float:
        """The speed from which the robot stops in time before what is ahead on an arc."""
        p = self._p
        horizon = p.gap + p.speed * p.delay + p.speed**2 / (2 * p.braking)
        free = self._surroundings.free_arc(curvature, self._radius, horizon) - p.gap
        if free <= 0.0:
            return 0.0
        # v·delay + v²/(2·braking) = free, solved for v
        return p.braking * (math.sqrt(p.delay**2 + 2.0 * free / p.braking) - p.delay)
