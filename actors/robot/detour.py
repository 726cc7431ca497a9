"""Goes around what stands in the way or comes along it: on the right, and on the left if that stays shut."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.robot.planning import Ground
from actors.robot.surroundings import Surroundings
from actors.robot.swerve import FREE, RIGHT, swerve


@dataclass(frozen=True)
class DetourParameters:
    """How the robot swerves; all own choices, tried on the corridor map with 1, 4 and 8 robots."""

    view: float = 2.0
    """So far ahead the way must be free, m: 2 s until two robots that drive at 0.5 m/s meet."""
    wall: float = 0.1
    """What is nearer than this to a wall of the map is taken for it, m: cells, and what the pose may err."""
    berth: float = 0.12
    """Kept between the body and what it goes around, m; more than the gap before which the driver stops."""
    beyond: float = 0.6
    """The line out ends so far behind where the way ceases to be free, m: two bodies and their berths."""
    turn: float = 0.05
    """Headings are tried so far apart, rad."""
    widest: float = 1.6
    """Headings are tried up to so far from that of the way, rad: a right angle."""
    spare: float = 0.3
    """Taken is twice the angle needed, as what is ahead may come as fast; at most so much more, rad."""
    left: float = 0.5
    """A heading to the left must be so much nearer to the way's than the one to the right, rad."""
    wait: float = 1.5
    """Left is no choice until the right has been shut for so long, s: a robot that comes swerves too."""


class Detour:
    """Replaces the point to head for while something stands in the way."""

    def __init__(
        self,
        ground: Ground,
        surroundings: Surroundings,
        radius: float,
        step: float,
        parameters: DetourParameters = DetourParameters(),
    ) -> None:
        """`radius`: of the body, m; `step`: time from one call to the next, s."""
        self._surroundings = surroundings
        self._clearance = ground.clearance
        self._need = ground.reach
        self._frame = np.array([*ground.grid.origin, ground.grid.resolution])
        self._radius = radius
        self._wait = round(parameters.wait / step)
        self._p = parameters
        self._shut = 0
        """Steps with the right-hand side shut, less those since then, up to twice the wait."""

    def around(
        self, pose: Pose, way: NDArray[np.float64], index: int, x: float, y: float
    ) -> tuple[float, float]:
        """The point to head for instead of `x`, `y`, m, along `way` from its point `index` on."""
        p = self._p
        points = self._surroundings.strangers(pose, self._clearance, self._frame, p.wall, p.view)
        if not len(points):
            self._shut = 0
            return x, y
        side, x, y = swerve(
            points,
            way,
            index,
            pose.x,
            pose.y,
            x,
            y,
            self._radius + p.berth,
            p.view,
            p.beyond,
            p.turn,
            p.widest,
            p.spare,
            p.left if self._shut >= self._wait else math.inf,
            self._clearance,
            self._frame,
            self._need,
        )
        if side in (FREE, RIGHT):
            self._shut = max(self._shut - 1, 0)
        else:
            self._shut = min(self._shut + 1, 2 * self._wait)
        return x, y
