"""Emulated Kobuki in an empty room, with or without a driver."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Point, Pose, wrap
from actors.instant import START, Duration, Instant, in_seconds, milliseconds
from actors.portable import arrays, cos, sin
from firmware_bridge.device_lines import NO_NOISE
from firmware_bridge.kobuki.driver import KobukiDriver
from firmware_bridge.kobuki.emulated_kobuki import BaseParameters, BodyTruth, EmulatedKobuki
from firmware_bridge.safety import StateChange

ROUND = milliseconds(5)
SUBSTEP_US = 5_000


@dataclass(frozen=True)
class Room:
    """A rectangle with a corner at the origin, m; x along its width, y along its depth."""

    width: float = 6.0
    depth: float = 4.0

    def ranges(self, sensor: Pose, angles: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distance of the wall in each direction of the sensor's frame: (n,), m."""
        c, s = arrays.cos(sensor.heading + angles), arrays.sin(sensor.heading + angles)
        with np.errstate(divide="ignore"):
            along_x = np.where(c > 0, self.width - sensor.x, -sensor.x) / c
            along_y = np.where(s > 0, self.depth - sensor.y, -sensor.y) / s
        nearest: NDArray[np.float64] = np.minimum(
            np.where(c == 0, np.inf, along_x), np.where(s == 0, np.inf, along_y)
        )
        return nearest

    def nearest_free(self, point: Point, radius: float) -> Point:
        """Return the nearest point at which a disc of this radius fits."""
        return Point(
            min(max(point.x, radius), self.width - radius), min(max(point.y, radius), self.depth - radius)
        )


class Unicycle:
    """A body without inertia that stops at the walls of a room; `radius`: of a Kobuki, m."""

    def __init__(self, pose: Pose | None, room: Room, radius: float = 0.177) -> None:
        self._room, self._radius = room, radius
        self._pose = Pose(room.width / 2, room.depth / 2, 0.0) if pose is None else pose
        self._now = START
        self._wanted = (0.0, 0.0)
        self._v = self._omega = 0.0

    def drive(self, v: float, omega: float) -> None:
        self._wanted = (v, omega)

    def advance(self, now: Instant) -> None:
        while self._now < now:
            step = min(SUBSTEP_US, now - self._now)
            self._now = Instant(self._now + step)
            self._move(Duration(step))

    def truth(self) -> BodyTruth:
        return BodyTruth(self._pose, self._v, self._omega)

    def bumper(self) -> int:
        """Return the centre sector for contact with any wall."""
        x, y, _ = self._pose
        gaps = (x, self._room.width - x, y, self._room.depth - y)
        return 2 * (min(gaps) < self._radius + 1e-6)

    def _move(self, step: Duration) -> None:
        time = in_seconds(step)
        v, omega = self._wanted
        here, turn = self._pose, omega * time
        course = here.heading + turn / 2
        way = v * time * (sin(turn / 2) / (turn / 2) if turn else 1.0)
        there = self._room.nearest_free(
            Point(here.x + way * cos(course), here.y + way * sin(course)), self._radius
        )
        self._pose = Pose(*there, wrap(here.heading + turn))
        self._v = math.copysign(here.point.distance_to(there), v) / time
        self._omega = omega


class Rig:
    """A driver and an emulated base on a line without delay."""

    def __init__(
        self, base: BaseParameters | None = None, room: Room = Room(20.0, 20.0), pose: Pose | None = None
    ) -> None:
        self.now = START
        self.body = Unicycle(pose, room)
        self.base = EmulatedKobuki(self.body, np.random.default_rng(7), base or BaseParameters())
        self.driver = KobukiDriver(START)
        self.changes: list[StateChange] = []
        self.noise, self._random = NO_NOISE, np.random.default_rng(8)
        """Noise of the bytes from the base."""
        self.written: list[tuple[Instant, bytes]] = []
        self.fed = 0

    def run(
        self, seconds: float, wish: tuple[float, float] | None = None, each: Callable[[], None] = lambda: None
    ) -> None:
        """Advance with the command `wish` in every round; None: no command."""
        end = self.now + round(seconds * 1e6)
        while self.now < end:
            self.now = Instant(self.now + ROUND)
            if wish is not None:
                self.driver.command(self.now, *wish)
            data = self.noise.apply(self.base.run(self.now), self._random)
            self.fed += len(self.driver.take(self.now, data))
            self.changes += self.driver.changes()
            if data := self.driver.due(self.now):
                self.written.append((self.now, data))
                self.base.take(self.now, data)
            each()
