"""One robot of the simulated world, as its emulated devices see it."""

import math

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Drive
from actors.robot_model import RangeSensor, scan_angles
from actors.world.body import Bodies
from firmware_bridge.kobuki.body import Truth


class RobotBody:
    """A body that somebody else moves: what a Kobuki drives, and what a lidar on it sees."""

    def __init__(self, bodies: Bodies, index: int, sensor: RangeSensor) -> None:
        self._bodies = bodies
        self._index = index
        self._first = float(scan_angles(sensor)[0])
        self._increment = sensor.increment
        self._full = sensor.full_circle
        self._ranges: NDArray[np.float64] = np.full(sensor.rays, np.inf)
        self._pressed = 0
        self._now = Instant(0)

    def drive(self, v: float, omega: float) -> None:
        """As in Body."""
        self._bodies.command(self._index, Drive(0, v, 0.0, omega, 0), self._now)

    def advance(self, now: Instant) -> None:
        """As in Body: the simulated world moves it."""

    def truth(self) -> Truth:
        """As in Body."""
        x, y, heading, vx, vy, omega = self._bodies.truth(self._index)
        return Truth(Pose(x, y, heading), vx * math.cos(heading) + vy * math.sin(heading), omega)

    def bumper(self) -> int:
        """As in Body."""
        return self._pressed

    def sense(self, now: Instant) -> None:
        """Take in what the world's sensors have measured since the last call."""
        self._now = now
        senses = self._bodies.senses(self._index, 0, now, 0, False)
        self._pressed = senses.bumper
        if senses.scan is not None:
            ranges = np.frombuffer(senses.scan.ranges_mm, "<u2")
            self._ranges = np.where(ranges == NO_ECHO_MM, np.inf, ranges / 1000)

    def sight(self, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,): range of the last sweep's ray nearest to each angle, m; inf = nothing, or no ray there."""
        turned = np.remainder(angles - self._first, math.tau)
        rays = np.rint(turned / self._increment).astype(np.intp)
        if self._full:
            rays %= self._ranges.size
        seen = rays < self._ranges.size
        found = np.full(angles.shape, np.inf)
        found[seen] = self._ranges[rays[seen]]
        return found
