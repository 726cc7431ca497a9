"""Where a robot came from, and the way back along it, in reverse."""

from collections import deque
from dataclasses import dataclass
from typing import Final

from actors.geometry import Point, Pose, Twist
from actors.instant import Duration, Instant, seconds
from actors.robot.behaviour.ports import FARTHEST_BACK

_SPACING: Final = 0.05
"""Points of the trail are so far apart, m."""
_LOOK_BACK: Final = 0.25
"""It steers for the point of the trail so far behind, m: about the body's radius and a half."""
_SPEED: Final = 0.2
"""m/s; own choice, below half of what it drives forward: the sensor may see nothing behind."""
_TURN: Final = 1.0
"""At most so fast it turns, rad/s."""


class Trail:
    """The last few metres that a robot has driven, in the frame of its odometry."""

    def __init__(self) -> None:
        self._points: deque[Point] = deque(maxlen=round(FARTHEST_BACK / _SPACING) + 1)

    def take(self, here: Point) -> None:
        """The robot is here now."""
        if not self._points or not self._points[-1].is_nearer(here, _SPACING):
            self._points.append(here)

    def behind(self, here: Point) -> Point | None:
        """What to steer for on the way back; what has been passed is forgotten. None where the trail ends."""
        while self._points and self._points[-1].is_nearer(here, _LOOK_BACK):
            self._points.pop()
        return self._points[-1] if self._points else None


@dataclass
class Withdrawal:
    """Backing out along the trail, as a behaviour has told the robot to."""

    left: float
    """How far yet, m."""
    last: Point
    """Where the robot was in the step before, odometry frame."""
    ends: Instant
    """Whatever has come of it, it is over then."""

    @classmethod
    def of(cls, distance: float, here: Point, instant: Instant) -> "Withdrawal":
        """One by `distance`, m, that may take twice as long as it should, and a turn."""
        return cls(distance, here, Instant(instant + patience(distance)))

    def gone_to(self, here: Point) -> None:
        """Count what has been driven."""
        self.left -= self.last.distance_to(here)
        self.last = here


def patience(distance: float) -> Duration:
    """How long backing out by `distance`, m, may take."""
    return seconds(3 + 2 * distance / _SPEED)


def backward(here: Pose, target: Point) -> Twist:
    """The velocity that leads backward on an arc to `target` (pure pursuit), or turns round first."""
    aim = here.relative(Pose(target.x, target.y, 0.0))
    if aim.x > -abs(aim.y):
        return Twist(0.0, 0.0, -_TURN if aim.y > 0 else _TURN)
    curvature = 2 * aim.y / (aim.x * aim.x + aim.y * aim.y)
    return Twist(-_SPEED, 0.0, max(-_TURN, min(_TURN, -_SPEED * curvature)))
