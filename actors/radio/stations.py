"""Where the transceivers are during one step."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from actors.messages import RobotTruth


class Stations:
    """The robots of one step by station number; a station without a robot is switched off.

    A robot moves on from its pose at the step's start in a straight line.
    """

    def __init__(self, start: int, robots: Sequence[RobotTruth | None]) -> None:
        self.start = start
        self.powered = tuple(robot is not None and robot.powered for robot in robots)
        self._robots = robots
        self._motion: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None

    def positions(self, instant: int) -> NDArray[np.float64]:
        """Positions at the instant: (2, stations), m."""
        if self._motion is None:  # most steps have no frame and need no positions
            truths = [(r.x, r.y, r.vx, r.vy) if r else (0.0, 0.0, 0.0, 0.0) for r in self._robots]
            table = np.array(truths, dtype=np.float64).T
            self._motion = (table[:2], table[2:])
        place, velocity = self._motion
        moved: NDArray[np.float64] = place + velocity * ((instant - self.start) / 1e6)
        return moved
