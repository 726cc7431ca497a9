"""The oscillation critic: who has just turned one way must not turn back before it has got anywhere.

As ros-planning/navigation, base_local_planner/src/oscillation_cost_function.cpp.
"""

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose, wrap
from actors.portable import hypot


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
