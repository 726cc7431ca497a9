"""Points and poses in the plane: x east, y north, angles in (−π, π], metres and radians (REP 103)."""

import math
from typing import Final, NamedTuple, TypeAlias

from actors.portable import cos_sin, hypot
from deeco.knowledge import made

GREATEST_COORDINATE: Final = 1e5
"""Of a point, either way, m. A velocity, m/s, and an angle, rad, have the same limit in messages."""


class Point(NamedTuple):
    """A point of the map frame, m."""

    x: float
    y: float

    def distance_to(self, other: "Point") -> float:
        """Euclidean distance, m."""
        return hypot(self.x - other.x, self.y - other.y)

    def is_nearer(self, to: "Point", distance: float) -> bool:
        """True if the other point is less than `distance` away, m: by squares, which is quicker."""
        x, y = self.x - to.x, self.y - to.y
        return x * x + y * y < distance * distance


class Pose(NamedTuple):
    """A position, m, and the direction faced, rad in (−π, π]."""

    x: float
    y: float
    heading: float

    @property
    def point(self) -> Point:
        """Where the pose is."""
        return made(Point, self[:2])

    def compose(self, local: "Pose") -> "Pose":
        """The pose, in this pose's parent frame, of something at `local` in this pose's own frame."""
        c, s = cos_sin(self.heading)
        x, y, heading = local
        turned = self.heading + heading
        if not -math.pi < turned <= math.pi:
            turned = wrap(turned)
        return made(Pose, (self.x + c * x - s * y, self.y + s * x + c * y, turned))

    def relative(self, other: "Pose") -> "Pose":
        """`other`, given in this pose's parent frame, as seen from this pose: the inverse of `compose`."""
        c, s = cos_sin(self.heading)
        dx, dy = other.x - self.x, other.y - self.y
        turned = other.heading - self.heading
        if not -math.pi < turned <= math.pi:
            turned = wrap(turned)
        return made(Pose, (c * dx + s * dy, c * dy - s * dx, turned))

    def frame(self, local: "Pose") -> "Pose":
        """The frame in which this pose is `local`, as a pose in this one's parent frame."""
        return self.compose(local.relative(ORIGIN))


ORIGIN: Final = Pose(0.0, 0.0, 0.0)


Covariance: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""Of x, y and heading, row by row: m², m·rad, rad²."""
CERTAIN: Final[Covariance] = (0.0,) * 9


class Twist(NamedTuple):
    """A velocity in the robot's own frame: forward and leftward, m/s, and counter-clockwise, rad/s."""

    vx: float
    vy: float
    omega: float


STILL = Twist(0.0, 0.0, 0.0)


def between(first: Pose, second: Pose, share: float) -> Pose:
    """The pose at a share, 0 to 1, of the straight way from the first to the second."""
    turn = wrap(second.heading - first.heading)
    return Pose(
        first.x + share * (second.x - first.x),
        first.y + share * (second.y - first.y),
        wrap(first.heading + share * turn),
    )


def wrap(angle: float) -> float:
    """The same angle in (−π, π]."""
    if -math.pi < angle <= math.pi:
        return float(angle)  # a scenario may have whole numbers
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped
