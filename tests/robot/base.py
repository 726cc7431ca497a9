"""Simulated base for closed-loop tests: follows commands within limits, and casts rays in small steps."""

import math

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import FREE, OCCUPIED, OccupancyGrid
from actors.geometry import Point, Pose, Twist
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Drive, Odometry, Scan, SensorData
from actors.robot_model import RobotModel, load_model, scan_angles

STEP_US = 100_000
STRIDE = 0.01


def model(rays: int = 180) -> RobotModel:
    turtlebot = load_model("turtlebot2", "chapter")
    return turtlebot.with_sensor(rays=rays, range_max=3.0)


def plan(drawing: str, resolution: float = 0.05) -> OccupancyGrid:
    lines = [line for line in drawing.splitlines() if line.strip()]
    width = max(map(len, lines))
    walls = np.array([[c == "#" for c in line.ljust(width)] for line in reversed(lines)])
    fine = np.kron(walls, np.ones((5, 5), dtype=bool))
    return OccupancyGrid(np.where(fine, OCCUPIED, FREE).astype(np.uint8), resolution)


TWO_ROOMS = plan(
    """
########################################
#                  #                   #
#                  #                   #
#                  #                   #
#                  #                   #
#                                      #
#                                      #
#                                      #
#                                      #
#                  #                   #
#                  #                   #
#                  #                   #
#                  #                   #
########################################
"""
)
"""10 m by 3.5 m, two rooms and a door of 1 m at x = 4.75 to 5, y = 1.25 to 2.25."""


class FakeBase:
    def __init__(self, floor: OccupancyGrid, kind: RobotModel, start: Pose) -> None:
        self._floor = floor
        self._kind = kind
        self._start = start
        self._angles = scan_angles(kind.sensor)
        self.pose = start
        self.velocity = Twist(0.0, 0.0, 0.0)
        self.obstacles: list[tuple[Point, float]] = []

    def senses(self, step: int, events: int = 0) -> SensorData:
        moved = self._start.relative(self.pose)
        instant = step * STEP_US
        odometry = Odometry(moved.x, moved.y, moved.heading, *self.velocity)
        return SensorData(step, instant, events, odometry, 0, Scan(instant, self._scan().tobytes()))

    def drive(self, drive: Drive) -> None:
        dt, limits = STEP_US / 1e6, self._kind.drive
        v = _towards(self.velocity.vx, drive.vx, limits.acceleration * dt)
        w = _towards(self.velocity.omega, drive.omega, limits.turn_acceleration * dt)
        for _ in range(10):
            self.pose = self.pose.compose(Pose(v * dt / 10, 0.0, w * dt / 10))
        self.velocity = Twist(v, 0.0, w)

    def wall_gap(self) -> float:
        x, y = self._floor.centres()
        rows, columns = np.nonzero(self._floor.blocking)
        half = self._floor.resolution / 2
        dx = np.maximum(np.abs(x[columns] - self.pose.x) - half, 0)
        dy = np.maximum(np.abs(y[rows] - self.pose.y) - half, 0)
        gaps = [float(np.hypot(dx, dy).min())]
        gaps += [centre.distance_to(self.pose.point) - radius for centre, radius in self.obstacles]
        return min(gaps) - self._kind.footprint.circumradius

    def _scan(self) -> NDArray[np.uint16]:
        sensor = self._kind.sensor
        eye = self.pose.compose(sensor.mount)
        strides = np.arange(0.0, sensor.range_max, STRIDE)
        angles = self._angles + self.pose.heading
        x = eye.x + np.outer(np.cos(angles), strides)
        y = eye.y + np.outer(np.sin(angles), strides)
        floor = self._floor
        rows = np.clip(((y - floor.origin.y) / floor.resolution).astype(int), 0, floor.rows - 1)
        columns = np.clip(((x - floor.origin.x) / floor.resolution).astype(int), 0, floor.columns - 1)
        hit = floor.blocking[rows, columns]
        for centre, radius in self.obstacles:
            hit |= np.hypot(x - centre.x, y - centre.y) < radius
        ranges = np.rint(strides[hit.argmax(axis=1)] * 1000)
        return np.where(hit.any(axis=1), ranges, NO_ECHO_MM).astype("<u2")


def _towards(value: float, wanted: float, change: float) -> float:
    return value + math.copysign(min(abs(wanted - value), change), wanted - value)


def at_step(step: int) -> Instant:
    return Instant(step * STEP_US)
