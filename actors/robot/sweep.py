"""Scans with the pose that they were made at: the odometry's, at the scan's own stamp."""

from collections import deque
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose, between
from actors.instant import Instant
from actors.messages import Scan
from actors.robot_model import RangeSensor
from actors.runtime.errors import AcrcError

_KEPT: Final = 128
"""So many poses are remembered: more than a second at the shortest step."""


class Sweep(msgspec.Struct, frozen=True, gc=False):
    """One scan, and where it was made."""

    ranges_mm: NDArray[np.uint16]
    """(rays,), read-only, mm; NO_ECHO_MM where a ray met nothing."""
    pose: Pose
    """The body's when the scan was made, m and rad, odometry frame."""


class Sweeps:
    """Gives each scan the pose of its stamp, between those that the odometry gave before and after it."""

    def __init__(self, sensor: RangeSensor) -> None:
        self._rays = sensor.rays
        self._track: deque[tuple[Instant, Pose]] = deque(maxlen=_KEPT)

    def take(self, instant: Instant, here: Pose, scan: Scan | None) -> Sweep | None:
        """The odometry's pose, and the scan if one did, that arrived at a step's start: see `placed`."""
        self._track += ((instant, here),)
        return None if scan is None else self.placed(scan)

    def placed(self, scan: Scan) -> Sweep:
        """A scan with its pose. Raises AcrcError for a wrong number of rays.

        A stamp beyond what is remembered, or in the future, gets the nearest pose that is known.
        """
        if len(scan.ranges_mm) != 2 * self._rays:
            raise AcrcError(
                f"a scan of {len(scan.ranges_mm)} bytes arrived; the {self._rays} rays of the robot's "
                f"range sensor give {2 * self._rays}"
            )
        newest, pose = self._track[-1]
        if scan.stamp < newest:
            pose = self._at(scan.stamp)
        return Sweep(np.frombuffer(scan.ranges_mm, "<u2"), pose)

    def _at(self, stamp: int) -> Pose:
        later, after = self._track[-1]
        for instant, pose in reversed(self._track):
            if instant <= stamp:
                if instant == later or stamp >= later:
                    return pose
                return between(pose, after, (stamp - instant) / (later - instant))
            later, after = instant, pose
        return after
