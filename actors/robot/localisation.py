"""Where the robot is on the map: the seam for localisers, and the one that trusts the odometry."""

from typing import Final, NamedTuple, Protocol

from actors.geometry import Pose
from actors.messages import Odometry, Scan

Covariance = tuple[float, float, float, float, float, float, float, float, float]
"""Of x, y and heading, row by row: m², m·rad, rad²."""

CERTAIN: Final[Covariance] = (0.0,) * 9


class Estimate(NamedTuple):
    """Where the robot holds itself to be, and how far it trusts that."""

    pose: Pose
    covariance: Covariance


class Localisation(Protocol):
    """Keeps track of the robot's pose in the map frame."""

    def update(self, odometry: Odometry, scan: Scan | None) -> Estimate:
        """The estimate at a step's start from what the base sensed then."""


class DeadReckoning:
    """The pose at switch-on, moved as the odometry says: as exact as that."""

    def __init__(self, start: Pose) -> None:
        self._start = start

    def update(self, odometry: Odometry, scan: Scan | None) -> Estimate:
        """The odometry's pose in the frame of the start pose; the covariance is 0, for it knows no better."""
        moved = Pose(odometry.x, odometry.y, odometry.heading)
        return Estimate(self._start.compose(moved), CERTAIN)
