"""Bodies for an emulated Kobuki to drive: a small protocol, and a disc in an empty room."""

import math
from typing import NamedTuple, Protocol

from actors.geometry import Point, Pose, wrap
from actors.instant import START, Duration, Instant, in_seconds
from actors.portable import cos, sin
from firmware_bridge.room import EMPTY, Room

_SUBSTEP_US = 5_000


class BodyTruth(NamedTuple):
    """Where a body truly is, and how it moves."""

    pose: Pose
    v: float
    """Forward, m/s."""
    omega: float
    """rad/s."""


class Body(Protocol):
    """What an emulated base drives, in a simulated world or all alone."""

    def drive(self, v: float, omega: float) -> None:
        """Turn the wheels for `v` m/s forward and `omega` rad/s from now on."""

    def advance(self, now: Instant) -> None:
        """Let time pass until `now`; nothing, where somebody else moves the body."""

    def truth(self) -> BodyTruth:
        """Where it is now."""

    def bumper(self) -> int:
        """Pressed sectors: bit 0 right, 1 centre, 2 left."""


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
