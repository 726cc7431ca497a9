"""Other robots around the robot, and what it hears of where they are."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from actors.floor.grid import OccupancyGrid
from actors.geometry import Point

_HEADINGS: Final = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0, 180.0)
"""By how much a peer turns off the straight line to where it wants to be, degrees; tried in this order."""


@dataclass(frozen=True)
class CrowdParameters:
    """How the others move around the robot. The distances are those of the dose; the rest is own choice."""

    nearest: float = 0.45
    """Between the centres of the robot and a peer at least, m."""
    farthest: float = 2.0
    """Between the two at most, m; a peer that was left behind so far comes in anew."""
    radius: float = 0.177
    """Of a peer's body, m: a TurtleBot 2."""
    speed: float = 0.7
    """A peer's highest, m/s: a Kobuki's, so that it can go before or after a robot of 0.5 m/s."""
    circling: float = 0.25
    """A peer's wish goes round the robot at up to this rate either way, rad/s."""
    whim: float = 0.02
    """Chance per step that a peer wishes for another distance and another way round."""
    near: float = 15.0
    """Of the realistic dose: the others are near for so long, s …"""
    every: float = 60.0
    """… once in so long, s; when within the period is drawn."""
    tries: int = 60
    """A peer that comes in tries so many places, then waits for the next step."""


@dataclass
class _Peer:
    at: Point | None
    distance: float
    bearing: float
    rate: float
    side: float
    """1 to turn off to its left first, else the opposite."""


class Crowd:
    """The others. Which places they take depends on the generator and on where the robot drives, only."""

    def __init__(
        self,
        grid: OccupancyGrid,
        count: int,
        generator: Generator,
        *,
        at_times: bool = False,
        parameters: CrowdParameters = CrowdParameters(),
    ) -> None:
        """`at_times`: the realistic dose, else they are near all the time."""
        self._grid = grid
        self._generator = generator
        self._told = parameters
        self._begin = generator.uniform(0.0, parameters.every - parameters.near) if at_times else 0.0
        self._at_times = at_times
        self._free = (grid.clearance >= parameters.radius + grid.resolution * 0.75).tolist()
        self._open = grid.free.tolist()
        self._peers = [self._born() for _ in range(count)]

    def advance(self, time: float, robot: Point, step: float) -> NDArray[np.float64]:
        """Where the peers are at that time, s, when the robot is there: (n, 2) m, NaN for one that is away.

        `step`: since the call before, s.
        """
        present = not self._at_times or 0 <= time % self._told.every - self._begin < self._told.near
        for peer in self._peers:
            self._move(peer, robot, step, present)
        return np.array([peer.at or (math.nan, math.nan) for peer in self._peers]).reshape(-1, 2)

    def _born(self) -> _Peer:
        peer = _Peer(None, 0.0, self._generator.uniform(-math.pi, math.pi), 0.0, 1.0)
        self._change_mind(peer)
        return peer

    def _change_mind(self, peer: _Peer) -> None:
        distance, rate, side = self._generator.random(3).tolist()
        peer.distance = self._told.nearest + distance * (self._told.farthest - self._told.nearest)
        peer.rate = (2 * rate - 1) * self._told.circling
        peer.side = 1.0 if side < 0.5 else -1.0

    def _move(self, peer: _Peer, robot: Point, step: float, present: bool) -> None:
        if self._generator.random() < self._told.whim:
            self._change_mind(peer)
        peer.bearing += peer.rate * step
        if not present:
            peer.at = None
            return
        if peer.at is not None:
            peer.at = self._stepped(peer, peer.at, robot, step)
        if peer.at is None:
            peer.at = self._entrance(peer, robot)

    def _stepped(self, peer: _Peer, here: Point, robot: Point, step: float) -> Point | None:
        """Where a peer goes next; None if it is hemmed in or left behind."""
        x = robot.x + peer.distance * math.cos(peer.bearing)
        y = robot.y + peer.distance * math.sin(peer.bearing)
        apart = math.hypot(x - here.x, y - here.y)
        way = min(apart, self._told.speed * step)
        if apart < 1e-6 and self._has_room(here, robot, peer):
            return here
        direction = math.atan2(y - here.y, x - here.x)
        for turn in _HEADINGS:
            if turn == 120.0 and self._has_room(here, robot, peer):
                return here
            # who gives way does so at full speed, however near the wish is
            length = way if turn <= 90.0 else self._told.speed * step
            for side in (peer.side, -peer.side):
                angle = direction + side * math.radians(turn)
                there = Point(here.x + length * math.cos(angle), here.y + length * math.sin(angle))
                if self._has_room(there, robot, peer):
                    return there
        return None

    def _entrance(self, peer: _Peer, robot: Point) -> Point | None:
        """A random place in the robot's sight for a peer to come in at; None if none was found."""
        told = self._told
        for _ in range(told.tries):
            distance, angle = self._generator.random(2).tolist()
            distance = told.nearest + distance * (told.farthest - told.nearest)
            angle *= math.tau
            there = Point(robot.x + distance * math.cos(angle), robot.y + distance * math.sin(angle))
            if self._has_room(there, robot, peer) and self._sees(robot, there):
                peer.bearing, peer.distance = angle, distance
                return there
        return None

    def _has_room(self, there: Point, robot: Point, peer: _Peer) -> bool:
        """True if the peer can stand there: within its distances from the robot, off walls and the others."""
        apart = there.distance_to(robot)
        if not self._told.nearest <= apart <= self._told.farthest or not self._on(self._free, there):
            return False
        for other in self._peers:
            if other is peer or other.at is None:
                continue
            if there.distance_to(other.at) < 2 * self._told.radius:
                return False
        return True

    def _sees(self, one: Point, other: Point) -> bool:
        """True if no wall stands between the two; looked at every 5 cm."""
        count = math.ceil(one.distance_to(other) / 0.05)
        return all(
            self._on(
                self._open,
                Point(one.x + k / count * (other.x - one.x), one.y + k / count * (other.y - one.y)),
            )
            for k in range(count + 1)
        )

    def _on(self, cells: list[list[bool]], point: Point) -> bool:
        if not self._grid.contains(point):
            return False
        row, column = self._grid.cell(point)
        return cells[row][column]


@dataclass(frozen=True)
class ReportParameters:
    """How peers tell their positions; own choices for a beacon of an IEEE 802.15.4 swarm."""

    every: int = 10
    """Steps from one report of a peer to its next: 1 s. The peers take turns."""
    delay: int = 2
    """Steps from where a peer was to when its report is used: 0.2 s."""
    spread: float = 0.10
    """Standard deviation of a reported coordinate, m: how well a peer localises itself."""
    kept: int = 30
    """A report older than so many steps, 3 s, is forgotten."""


Known = Sequence[tuple[Point, ...] | None]
"""Per step of a course: all positions now known, or None where nothing has changed."""


def reports(
    peers: NDArray[np.float64], generator: Generator, parameters: ReportParameters = ReportParameters()
) -> Known:
    """What is known of `peers`, (steps, m, 2) m with NaN while away, at each step."""
    steps, count, _ = peers.shape
    noise = parameters.spread * generator.standard_normal((steps, count, 2))
    latest: list[tuple[int, Point] | None] = [None] * count
    known: list[tuple[Point, ...] | None] = []
    for step in range(steps):
        changed = False
        for i in range(count):
            told, sent = latest[i], step - parameters.delay
            turn = (sent - i * parameters.every // count) % parameters.every == 0
            if sent >= 0 and turn and not np.isnan(peers[sent, i, 0]):
                latest[i] = sent, Point(*(peers[sent, i] + noise[sent, i]).tolist())
            elif told is not None and step - told[0] > parameters.kept:
                latest[i] = None
            changed |= latest[i] is not told
        known.append(tuple(told[1] for told in latest if told is not None) if changed else None)
    return known
