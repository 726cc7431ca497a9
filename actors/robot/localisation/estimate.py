"""What a localiser is asked, and what it answers."""

from collections.abc import Sequence
from typing import Protocol

import msgspec

from actors.geometry import Covariance, Point, Pose
from actors.robot.sweep import Sweep


class Estimate(msgspec.Struct, frozen=True, gc=False):
    """Where the robot holds itself to be, and how far it trusts that."""

    pose: Pose
    covariance: Covariance
    located: bool = True
    """False while the robot does not know where it is: it should stand."""
    lost: float = 0.0
    """Probability that the robot is somewhere else altogether."""


class Localisation(Protocol):
    """Keeps track of the robot's pose in the map frame."""

    def update(self, here: Pose, sweep: Sweep | None) -> Estimate:
        """The estimate at a step's start: `here` is the odometry's pose then, `sweep` the scan that came."""

    def mask(self, peers: Sequence[Point]) -> None:
        """From now on, believe no beam that ends at one of these points of the map frame, m.

        They replace the former ones; without any, all beams are believed.
        """

    def relocalise(self) -> None:
        """Forget where the robot is, and look for it all over the map."""

    def outcome(self) -> dict[str, object]:
        """What can be said about the whole run, JSON-able, by subject."""
