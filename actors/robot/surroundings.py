"""What stands around the robot, as its last scan showed it."""

import math

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import Odometry, Scan
from actors.robot.obstruction import free_arc
from actors.robot.swerve import strangers
from actors.robot_model import RangeSensor, scan_angles
from actors.runtime.errors import AcrcError


class ScanError(AcrcError):
    """A scan that this robot's sensor cannot have made."""


class Surroundings:
    """Keeps the last scan and where the robot was when it arrived."""

    def __init__(self, sensor: RangeSensor) -> None:
        angles = scan_angles(sensor)
        self._rays = np.column_stack((np.cos(angles), np.sin(angles)))
        self._mount = np.array([sensor.x, sensor.y])
        self._ranges: NDArray[np.uint16] = np.empty(0, np.uint16)
        self._taken_at = Pose(0.0, 0.0, 0.0)
        self._here = self._taken_at
        self._moved = np.zeros(3)
        self.seen: Instant | None = None
        """When the last scan arrived; None before the first."""

    def take(self, instant: Instant, odometry: Odometry, scan: Scan | None) -> None:
        """Take in what the base sensed at a step's start. Raises ScanError for a wrong number of rays."""
        self._here = Pose(odometry.x, odometry.y, odometry.heading)
        if scan is None:
            self._moved[:] = self._here.relative(self._taken_at)
            return
        if len(scan.ranges_mm) != 2 * len(self._rays):
            raise ScanError(
                f"a scan of {len(scan.ranges_mm)} bytes arrived; the {len(self._rays)} rays of the robot's "
                f"range sensor give {2 * len(self._rays)}"
            )
        self._ranges = np.frombuffer(scan.ranges_mm, "<u2")
        self._taken_at = self._here
        self._moved[:] = 0.0
        self.seen = instant

    def free_arc(self, curvature: float, radius: float, horizon: float) -> float:
        """How far a disc of `radius` gets forward along an arc of `curvature`, 1/m, at most `horizon`, m."""
        free: float = free_arc(self._ranges, self._rays, self._mount, self._moved, curvature, radius, horizon)
        return free

    def strangers(
        self,
        pose: Pose,
        clearance: NDArray[np.float64],
        frame: NDArray[np.float64],
        wall: float,
        view: float,
    ) -> NDArray[np.float64]:
        """Points within `view`, m, of what is not on the map, with the body at `pose`: (k, 2), m, map frame.

        `clearance`, `frame`, `wall` as for the kernel.
        """
        found: NDArray[np.float64] = strangers(
            self._ranges, self._rays, self._mount, self._moved, *pose, clearance, frame, wall, view
        )
        return found

    def age(self, instant: Instant) -> float:
        """Seconds since the last scan; inf before the first."""
        return math.inf if self.seen is None else (instant - self.seen) / 1_000_000
