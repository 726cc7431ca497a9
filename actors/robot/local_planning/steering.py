"""What a local planner is asked and says: so much is the same whatever it chooses by."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.floor.grid import Cell
from actors.geometry import STILL, Pose, Twist, wrap
from actors.instant import Duration, Instant, in_seconds
from actors.portable import hypot
from actors.robot.cost_maps.cost_map import CostMap
from actors.robot.local_planning.dwa_parameters import DwaParameters


class OscillationCritic:
    """Remembers the directions that were commanded, and bars the reverse of them for a while."""

    def __init__(self, distance: float, angle: float, least_speed: float) -> None:
        """All is allowed again `distance`, m, or `angle`, rad, from where it was barred.

        Turns count from `least_speed`, m/s, downward only.
        """
        self._distance = distance
        self._angle = angle
        self._least_speed = least_speed
        self._last = [0, 0]  # sign of the last motion along, and of the last turn
        self._barred = np.zeros(4, np.bool_)
        self._where = Pose(0.0, 0.0, 0.0)

    @property
    def barred(self) -> NDArray[np.bool_]:
        """(4,): True if forward, backward, left turn, right turn must not be commanded."""
        return self._barred

    def forget(self) -> None:
        """Allow everything."""
        self._last = [0, 0]
        self._barred[:] = False

    def note(self, here: Pose, speed: float, turn: float) -> None:
        """`speed`, m/s, and `turn`, rad/s, are commanded at `here`, odometry frame."""
        reversed_now = self._reverse(0, speed)
        if abs(speed) <= self._least_speed:
            reversed_now |= self._reverse(1, turn)
        if reversed_now:
            self._where = here
        if self._barred.any() and self._away(here):
            self.forget()

    def _reverse(self, axis: int, value: float) -> bool:
        """Note the sign of a motion; True if it was the other one before, which is barred from now on."""
        sign = (value > 0) - (value < 0)
        if sign == 0:
            return False
        turned = self._last[axis] == -sign
        if turned:
            self._barred[2 * axis + (1 if sign > 0 else 0)] = True
        self._last[axis] = sign
        return turned

    def _away(self, here: Pose) -> bool:
        gone = hypot(here.x - self._where.x, here.y - self._where.y)
        return gone > self._distance or abs(wrap(here.heading - self._where.heading)) > self._angle


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


class BaseLocalPlanner(ABC):
    """Follows one plan at a time."""

    def __init__(self, local: CostMap, parameters: DwaParameters) -> None:
        """`local` is kept up to date by whoever owns it."""
        self._local = local
        self._p = p = parameters
        self._cell = local.parameters.cell
        self._oscillation = OscillationCritic(p.oscillation_distance, p.oscillation_angle, p.least_speed)
        self._way: NDArray[np.float64] = np.zeros((0, 2))
        self._turning = False
        self.witness: Callable[[Cycle], None] | None = None
        """Is told of every cycle; for those who execute a robot again to look into it."""

    @property
    def period(self) -> Duration:
        """How often it is to be asked: so long a command holds."""
        return self._p.period

    def begin(self) -> None:
        """The robot is to go somewhere else now: forget the plan, the command, and how it came about."""
        self._way = np.zeros((0, 2))
        self._oscillation.forget()
        self._turning = False

    def follow(self, way: NDArray[np.float64]) -> None:
        """From now on go along `way`: (n, 2), n ≥ 1, m in the map frame."""
        self._way = way

    def steer(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """What to command from `instant` on, for a period; not valid without a fresh scan.

        `here` and `estimate`: the body's pose at that instant, in the odometry frame, to which the local map
        has been rolled, and in the map frame. `velocity`: the base's own.
        """
        if not self._local.age(instant) <= in_seconds(self._p.scan_patience):
            return NOWHERE
        steering = self._choose(instant, here, estimate, velocity) if self._way.size else NOWHERE
        if self.witness is not None:
            local = self._local
            given = instant, here, estimate, velocity, self._way, local.corner, local.costs()
            self.witness(Cycle(*given, self._turning, steering))
        return steering

    @abstractmethod
    def reached(self, estimate: Pose, velocity: Twist) -> bool:
        """True once the robot is where its plan ends, as this local planner means it."""

    @abstractmethod
    def _choose(self, instant: Instant, here: Pose, estimate: Pose, velocity: Twist) -> Steering:
        """One cycle; there is a plan."""


def reachable(value: float, gain: float, low: float, high: float) -> tuple[float, float]:
    """The dynamic window: what is within `gain` of `value` and within the limits; else the nearest limit."""
    least, most = value - gain, value + gain
    least = max(least, low)
    least = min(least, high)
    most = min(most, high)
    most = max(most, low)
    return least, most
