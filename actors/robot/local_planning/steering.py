"""What a local planner says, and when it chooses anew: so much is the same whatever it chooses by."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import Cell
from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Duration, Instant, in_seconds
from actors.portable import cos_sin
from actors.robot.cost_maps.cost_map import CostMap
from actors.robot.local_planning.dwa_parameters import DwaParameters
from actors.robot.local_planning.oscillation import OscillationCritic


class Steering(NamedTuple):
    """What to command now."""

    twist: Twist
    valid: bool
    """False without any valid trajectory, or without a plan or a scan to find one with; `twist` is STILL."""


NOWHERE: Final = Steering(STILL, False)


class Cycle(NamedTuple):
    """One choice of a local planner: what it was made from, and what was chosen."""

    instant: Instant
    here: Pose
    """The body's pose, m and rad, odometry frame."""
    estimate: Pose
    """The same, map frame."""
    velocity: Twist
    """The base's own."""
    way: NDArray[np.float64]
    """(n, 2): the plan, m, map frame."""
    corner: Cell
    """Row and column of the window's south-west cell, counted from the odometry frame's origin."""
    costs: NDArray[np.uint8]
    """(rows, columns) of the window, row 0 the southernmost: costs as costmap_2d has them."""
    turning: bool
    """True while the robot turns on the spot."""
    steering: Steering


class PeriodicPlanner(ABC):
    """Follows one plan at a time: a choice per period, held until the next."""

    def __init__(self, local: CostMap, parameters: DwaParameters) -> None:
        """`local` is kept up to date by whoever owns it."""
        self._local = local
        self._p = p = parameters
        self._cell = local.parameters.cell
        self._oscillation = OscillationCritic(p.oscillation_distance, p.oscillation_angle, p.least_speed)
        self._way: NDArray[np.float64] = np.zeros((0, 2))
        self._turning = False
        self._due: Instant | None = None
        self._held = NOWHERE
        self.witness: Callable[[Cycle], None] | None = None
        """Is told of every cycle; for those who execute a robot again to look into it."""

    @property
    def period(self) -> Duration:
        """So long a command holds."""
        return self._p.period

    def begin(self) -> None:
        """The robot is to go somewhere else now: forget the plan, the command, and how it came about."""
        self._way = np.zeros((0, 2))
        self._oscillation.forget()
        self._turning = False
        self._due, self._held = None, NOWHERE

    def follow(self, way: NDArray[np.float64]) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame."""
        self._way = way

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """What to command at `instant`; a new choice once a period, otherwise the last one again.

        `here` and `estimate`: the body's pose at that instant, in the odometry frame, to which the local map
        has been rolled, and in the map frame. `velocity`: the base's own.
        """
        p = self._p
        if not self._local.age(instant) <= in_seconds(p.scan_patience):
            self._due, self._held = None, NOWHERE
            return self._held
        if self._due is None or instant >= self._due:
            since = Duration(0) if self._due is None else Duration((instant - self._due) % p.period)
            self._due = Instant(instant - since + p.period)
            self._held = self._choose(instant, here, estimate, velocity) if self._way.size else NOWHERE
            if self.witness is not None:
                local = self._local
                given = instant, here, estimate, velocity, self._way, local.corner, local.costs()
                self.witness(Cycle(*given, self._turning, self._held))
        return self._held

    @abstractmethod
    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """True once the robot is where its plan ends, as this local planner means it."""

    @abstractmethod
    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """One cycle; there is a plan."""

    def _body(self, here: Pose) -> NDArray[np.float64]:
        """x and y in the window, cells, and heading, rad."""
        corner = self._local.corner
        return np.array([here.x / self._cell - corner.column, here.y / self._cell - corner.row, here.heading])

    def _motion(self, here: Pose, estimate: Pose) -> NDArray[np.float64]:
        """From the map frame to the window: cosine and sine of the angle, shift of x and y, m, cells per
        m."""
        turn = wrap(here.heading - estimate.heading)
        c, s = cos_sin(turn)
        x = here.x - (c * estimate.x - s * estimate.y)
        y = here.y - (s * estimate.x + c * estimate.y)
        corner, cell = self._local.corner, self._cell
        return np.array([c, s, x - corner.column * cell, y - corner.row * cell, 1.0 / cell])


def reachable(value: float, gain: float, low: float, high: float) -> tuple[float, float]:
    """The dynamic window: what is within `gain` of `value` and within the limits; else the nearest limit."""
    return min(max(value - gain, low), high), max(min(value + gain, high), low)
