"""Scans with the odometry pose at their stamp."""

from collections import deque
from typing import Final

import msgspec
import numpy as np

from actors.array_types import UInt16s
from actors.geometry import Pose, interpolate
from actors.instant import Instant
from actors.messages import Scan
from actors.robot_model import RangeSensor
from actors.runtime.errors import AcrcError

_CAPACITY: Final = 128
"""Number of stored poses: more than a second at the shortest step."""


class Sweep(msgspec.Struct, frozen=True, gc=False):
    """A scan and its odometry pose."""

    ranges_mm: UInt16s
    """(rays,), read-only, mm; NO_ECHO_MM for rays without echo."""
    pose: Pose
    """Pose of the body at the time of the scan, m and rad, odometry frame."""


class OdometryBuffer:
    """Buffer of odometry poses that interpolates the pose of each scan."""

    def __init__(self, sensor: RangeSensor) -> None:
        self._rays = sensor.rays
        self._track: deque[tuple[Instant, Pose]] = deque(maxlen=_CAPACITY)

    def take(self, instant: Instant, here: Pose, scan: Scan | None) -> Sweep | None:
        """Store the odometry pose of a step's start; return the scan that arrived, with its pose."""
        self._track += ((instant, here),)
        return None if scan is None else self.sweep_of(scan)

    def sweep_of(self, scan: Scan) -> Sweep:
        """Return a scan with its pose. Raises AcrcError for a wrong number of rays.

        A stamp outside of the buffer gets the nearest pose.
        """
        if len(scan.ranges_mm) != 2 * self._rays:
            raise AcrcError(
                f"received a scan of {len(scan.ranges_mm)} bytes; the robot's range sensor with "
                f"{self._rays} rays should send {2 * self._rays}"
            )
        newest, pose = self._track[-1]
        if scan.stamp < newest:
            pose = self._pose_at(scan.stamp)
        return Sweep(np.frombuffer(scan.ranges_mm, "<u2"), pose)

    def _pose_at(self, stamp: int) -> Pose:
        later, after = self._track[-1]
        for instant, pose in reversed(self._track):
            if instant <= stamp:
                if instant == later or stamp >= later:
                    return pose
                return interpolate(pose, after, (stamp - instant) / (later - instant))
            later, after = instant, pose
        return after
