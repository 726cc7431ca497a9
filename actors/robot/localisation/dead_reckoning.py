"""Localisation without a map: the odometry is believed."""

from collections.abc import Sequence

from actors.geometry import CERTAIN, Point, Pose
from actors.robot.localisation.estimate import Estimate
from actors.robot.sweep import Sweep


class DeadReckoning:
    """The pose at switch-on, moved as the odometry says: as exact as that."""

    def __init__(self, start: Pose, doubt: float | None = None) -> None:
        """`doubt`: as for Amcl; it never ends, for nothing here finds out where the robot is."""
        self._start = start
        self._located = doubt is None

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """The odometry's pose in the frame of the start pose; the covariance is 0, for it knows no better."""
        lost = 0.0 if self._located else 1.0
        return Estimate(self._start.compose(here), CERTAIN, self._located, lost)

    def mask(self, peers: Sequence[Point]) -> None:
        """Without effect, as no beam is believed."""

    def relocalise(self) -> None:
        """Without effect: nothing here could find out where the robot is."""

    def outcome(self) -> dict[str, object]:
        """Nothing to say."""
        return {}
