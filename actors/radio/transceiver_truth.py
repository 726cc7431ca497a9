"""Where the transceivers are during one step, and which of them are on."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actors.messages import RobotTruth
from actors.portable import arrays


class TransceiverTruth:
    """What is true of the transceivers in one step, by number; one whose robot is gone is switched off.

    A robot moves on from its pose at the step's start with constant speed and angular velocity: along an arc.
    """

    def __init__(self, start_us: int, robots: Sequence[RobotTruth | None]) -> None:
        self._start_ns = start_us * 1000
        self.powered = tuple(robot is not None and robot.powered for robot in robots)
        self.epochs = tuple(robot.epoch if robot is not None else 0 for robot in robots)
        truths = [(r.x, r.y, r.vx, r.vy, r.omega) if r else (0.0, 0.0, 0.0, 0.0, 0.0) for r in robots]
        table = np.array(truths, dtype=np.float64).reshape(-1, 5)
        self.places: NDArray[np.float64] = table[:, :2]
        """(transceivers, 2), m, at the step's start."""
        self._velocities = table[:, 2:4]
        self._omega = table[:, 4]
        self.still = not self._velocities.any()

    def positions(self, instant_ns: int) -> NDArray[np.float64]:
        """Positions at the instant: (transceivers, 2), m."""
        elapsed = (instant_ns - self._start_ns) / 1e9
        half_angle = self._omega * (elapsed / 2)
        cos, sin = arrays.cos(half_angle), arrays.sin(half_angle)
        # the chord of an arc: as long as sin(h)/h of the way driven, turned by the half angle h
        driven = elapsed * np.divide(sin, half_angle, out=np.ones_like(half_angle), where=half_angle != 0)
        cos, sin = driven * cos, driven * sin
        vx, vy = self._velocities[:, 0], self._velocities[:, 1]
        moved: NDArray[np.float64] = self.places + np.stack(
            [vx * cos - vy * sin, vx * sin + vy * cos], axis=1
        )
        return moved
