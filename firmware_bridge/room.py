"""An empty room with four walls, for emulated devices: what a sensor sees in it, what a body runs into."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.portable import arrays


@dataclass(frozen=True)
class Room:
    """A rectangle with a corner at the origin; x along its width, y along its depth."""

    width: float = 6.0
    """m."""
    depth: float = 4.0
    """m."""

    @property
    def middle(self) -> Point:
        """Its middle."""
        return Point(self.width / 2, self.depth / 2)

    def ranges(self, sensor: Pose, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance of the wall from a sensor within, in each direction of the sensor's own frame: (n,), m."""
        c, s = arrays.cos(sensor.heading + angles), arrays.sin(sensor.heading + angles)
        with np.errstate(divide="ignore"):
            along_x = np.where(c > 0, self.width - sensor.x, -sensor.x) / c
            along_y = np.where(s > 0, self.depth - sensor.y, -sensor.y) / s
        nearest: NDArray[np.float64] = np.minimum(
            np.where(c == 0, np.inf, along_x), np.where(s == 0, np.inf, along_y)
        )
        return nearest

    def touched(self, point: Point, radius: float) -> list[float]:
        """Directions of the walls that a disc of `radius` touches, rad."""
        gaps = {
            0.0: self.width - radius - point.x,
            math.pi / 2: self.depth - radius - point.y,
            math.pi: point.x - radius,
            -math.pi / 2: point.y - radius,
        }
        return [direction for direction, gap in gaps.items() if gap < 1e-6]

    def held(self, point: Point, radius: float) -> Point:
        """The nearest point at which a disc of `radius` fits in."""
        return Point(
            min(max(point.x, radius), self.width - radius), min(max(point.y, radius), self.depth - radius)
        )


EMPTY: Final = Room()
"""As large as an office."""
