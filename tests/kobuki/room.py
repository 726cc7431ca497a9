"""A disc in an empty room with four walls, for emulated bases and lidars."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point, Pose, wrap
from actors.instant import START, Duration, Instant, in_seconds
from actors.portable import arrays, cos, sin
from firmware_bridge.kobuki.base import BodyTruth


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


_SUBSTEP_US = 5_000


class Unicycle:
    """A disc that does at once what its wheels do, and stops at the walls of a room."""

    def __init__(
        self,
        pose: Pose | None = None,
        room: Room = EMPTY,
        radius: float = 0.177,
        started: Instant = START,
    ) -> None:
        """`pose`: the middle of the room, if not given; `radius`: of a Kobuki, m."""
        self.room = room
        self._radius = radius
        self._pose = Pose(*room.middle, 0.0) if pose is None else pose
        self._now = started
        self._wanted = (0.0, 0.0)
        self._v = self._omega = 0.0
        self._bumper = 0

    def drive(self, v: float, omega: float) -> None:
        """As in Body."""
        self._wanted = (v, omega)

    def advance(self, now: Instant) -> None:
        """As in Body."""
        while self._now < now:
            step = min(_SUBSTEP_US, now - self._now)
            self._now = Instant(self._now + step)
            self._move(Duration(step))

    def truth(self) -> BodyTruth:
        """As in Body."""
        return BodyTruth(self._pose, self._v, self._omega)

    def bumper(self) -> int:
        """As in Body."""
        return self._bumper

    def _move(self, step: Duration) -> None:
        time = in_seconds(step)
        v, omega = self._wanted
        here, turn = self._pose, omega * time
        course = here.heading + turn / 2
        way = v * time * (sin(turn / 2) / (turn / 2) if turn else 1.0)
        aim = Point(here.x + way * cos(course), here.y + way * sin(course))
        there = self.room.held(aim, self._radius)
        self._pose = Pose(*there, wrap(here.heading + turn))
        self._v = math.copysign(here.point.distance_to(there), v) / time
        self._omega = omega
        self._bumper = 0
        for wall in self.room.touched(there, self._radius):
            self._bumper |= _sector(wrap(wall - self._pose.heading))


def _sector(bearing: float) -> int:
    """The bumper's bit towards a wall: three sectors of 60° round the front."""
    if abs(bearing) <= math.radians(30):
        return 2
    if abs(bearing) <= math.radians(90):
        return 4 if bearing > 0 else 1
    return 0
