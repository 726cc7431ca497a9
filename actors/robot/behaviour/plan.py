"""The way that a robot means to go: what its behaviour may know of the plan."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point
from actors.instant import Duration, seconds

PACE: Final = 0.33
"""So fast robots get on, m/s: 0.5 m/s by the slowness of 1.5 that `acrc verify navigation` measures."""


@dataclass(frozen=True, eq=False)
class Plan:
    """One plan of navigation's, which makes a new one every second."""

    way: NDArray[np.float64]
    """(n, 2), n ≥ 1: points from where the robot was to the goal, m, map frame; nobody's to change."""

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """The same as points."""
        return tuple(Point(x, y) for x, y in self.way.tolist())

    def ahead(self, here: Point) -> tuple[Point, ...]:
        """The points from the one nearest to `here` on."""
        nearest = min(range(len(self.points)), key=lambda index: self.points[index].distance_to(here))
        return self.points[nearest:]

    def distance_to_go(self, here: Point) -> float:
        """How far it is from `here` to the plan's nearest point and on to its end, m."""
        total, last = 0.0, here
        for point in self.ahead(here):
            total += last.distance_to(point)
            last = point
        return total

    def time_to_go(self, here: Point) -> Duration:
        """How long that takes at PACE: an estimate that knows of nobody in the way."""
        return seconds(self.distance_to_go(here) / PACE)
