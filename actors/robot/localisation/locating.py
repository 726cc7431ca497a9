"""When a robot that was in doubt about its pose knows it again."""

from typing import Final

from actors.geometry import Point
from actors.robot.localisation.histogram import Cluster

_IN_A_ROW: Final = 5
"""So many scans have to say so on end; own choices, as all below."""
_REACH: Final = 3.0
"""No farther from where it last was than so many standard deviations, for rooms are alike, ..."""
_TOGETHER: Final = 0.95
"""So much of the particles' weight is in one cluster, ..."""
_APART: Final = 0.15
"""... which lies within so much of its mean on the root of the mean square, m, ..."""
_TURNED: Final = 0.1
"""... and rad, ..."""
_FIT: Final = 0.85
"""... and such a share of the beams end where the map has something."""


class Locating:
    """Counts the scans that agree, all made while the robot stands."""

    def __init__(self, doubt: float) -> None:
        """`doubt`: standard deviation of what was known, m."""
        self._reach = _REACH * doubt
        self._agreed = 0
        self.believed: Point | None = None
        """Where it held itself to be at first; to be set."""

    def take(self, cluster: Cluster, fit: float) -> bool:
        """What came of one more scan; True once the robot is located."""
        pose, covariance, weight = cluster
        near = self.believed is not None and self.believed.distance_to(pose.point) <= self._reach
        narrow = covariance[0] + covariance[4] <= _APART * _APART and covariance[8] <= _TURNED * _TURNED
        agrees = near and narrow and weight >= _TOGETHER and fit >= _FIT
        self._agreed = self._agreed + 1 if agrees else 0
        return self._agreed >= _IN_A_ROW
