"""How far each robot's own idea of where it is lies from the truth: measured, and told to no robot."""

import math
from typing import Final

import msgspec

from actors.messages import RobotTruth
from actors.portable import hypot

ASTRAY: Final = 0.5
"""A robot farther than this from where it holds itself to be, m, is astray."""
LOST: Final = 1.0
"""A robot farther than this from where it holds itself to be, m, is lost."""


class PoseError(msgspec.Struct, frozen=True):
    """How far one robot's held positions lay from its true ones, over all steps in which it said any."""

    samples: int
    """Steps in which it said where it holds itself to be; 0: never, and the numbers below are all 0."""
    rmse: float
    """Root of the mean of the squared distances, m: the absolute trajectory error."""
    greatest: float
    """The greatest distance, m."""
    astray_share: float
    """Share of the samples with a distance above ASTRAY."""
    lost_share: float
    """Share of the samples with a distance above LOST."""
    times_lost: int
    """How often the distance rose above LOST."""
    lost_at_end: bool
    """Whether the last distance lies above LOST."""


class Whereabouts:
    """Collects the distances of all robots, by index."""

    def __init__(self, robots: int) -> None:
        self._samples = [0] * robots
        self._squares = [0.0] * robots
        self._greatest = [0.0] * robots
        self._astray = [0] * robots
        self._lost = [0] * robots
        self._times_lost = [0] * robots
        self._is_lost = [False] * robots

    def take(self, robot: int, held: tuple[float, float, float] | None, true: RobotTruth) -> None:
        """Compare what one robot holds to be its pose at a step's start with the true one."""
        if held is None:
            return
        distance = hypot(held[0] - true.x, held[1] - true.y)
        self._samples[robot] += 1
        self._squares[robot] += distance * distance
        self._greatest[robot] = max(self._greatest[robot], distance)
        self._astray[robot] += distance > ASTRAY
        is_lost = distance > LOST
        self._lost[robot] += is_lost
        self._times_lost[robot] += is_lost and not self._is_lost[robot]
        self._is_lost[robot] = is_lost

    def error(self, robot: int) -> PoseError:
        """What has come together for one robot."""
        samples = self._samples[robot]
        share = 1 / samples if samples else 0.0
        return PoseError(
            samples=samples,
            rmse=math.sqrt(self._squares[robot] * share),
            greatest=self._greatest[robot],
            astray_share=self._astray[robot] * share,
            lost_share=self._lost[robot] * share,
            times_lost=self._times_lost[robot],
            lost_at_end=self._is_lost[robot],
        )
