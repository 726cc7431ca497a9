"""Geometry in the plane: points, poses, convex polygons, and the door of a floor.

x points east, y north; angles lie in (−π, π]; metres and radians (REP 103).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, NamedTuple, TypeAlias

import msgspec

from actors.portable import atan2, cos_sin, hypot
from deeco.knowledge import made

GREATEST_COORDINATE: Final = 1e5
"""Of a point, either way, m. A velocity, m/s, and an angle, rad, have the same limit in messages."""
Coordinate = Annotated[float, msgspec.Meta(ge=-GREATEST_COORDINATE, le=GREATEST_COORDINATE)]
"""A finite coordinate, velocity or angle; msgspec refuses others where it decodes."""


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


Vertex = tuple[float, float]


def polygon_fault(vertices: Sequence[Vertex]) -> str:
    """Why the vertices do not go once round a strictly convex polygon with (0, 0) inside; "" if they do.

    Either direction is good.
    """
    ring = counter_clockwise(vertices)
    for (ax, ay), (bx, by), (cx, cy) in zip(ring, (*ring[1:], ring[0]), (*ring[2:], *ring[:2]), strict=True):
        if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) <= 0:
            return f"it does not bend outward at ({bx:g}, {by:g})"
    if not math.isclose(_turning(ring), math.tau, rel_tol=1e-6):
        return "its border goes round more than once"
    for (ax, ay), (bx, by) in _edges(ring):
        if ax * by - ay * bx <= 0:
            return f"(0, 0) is not inside of the edge from ({ax:g}, {ay:g}) to ({bx:g}, {by:g})"
    return ""


def counter_clockwise(vertices: Sequence[Vertex]) -> tuple[Vertex, ...]:
    """The same polygon with its area on the left of its border."""
    area = math.fsum(ax * by - ay * bx for (ax, ay), (bx, by) in _edges(vertices))
    return tuple(vertices) if area > 0 else tuple(reversed(vertices))


def distance_to_border(vertices: Sequence[Vertex]) -> float:
    """How far (0, 0), inside a convex polygon, is from its border."""
    return min(abs(ax * by - ay * bx) / hypot(bx - ax, by - ay) for (ax, ay), (bx, by) in _edges(vertices))


def moment(vertices: Sequence[Vertex], mass: float) -> float:
    """Moment of inertia about (0, 0) of a polygon of evenly spread mass: kg m² if given kg and m."""
    weight = area = 0.0
    for (ax, ay), (bx, by) in _edges(vertices):
        cross = ax * by - ay * bx
        area += cross
        weight += cross * (ax * ax + ax * bx + bx * bx + ay * ay + ay * by + by * by)
    return mass * weight / (6 * area)


def _turning(ring: Sequence[Vertex]) -> float:
    """Sum of the angles between successive edges, rad."""
    headings = [atan2(by - ay, bx - ax) for (ax, ay), (bx, by) in _edges(ring)]
    return math.fsum((b - a) % math.tau for a, b in pairwise((*headings, headings[0])))


def _edges(ring: Sequence[Vertex]) -> list[tuple[Vertex, Vertex]]:
    return list(zip(ring, (*ring[1:], ring[0]), strict=True))


@dataclass(frozen=True)
class Door:
    """A narrow place between regions."""

    index: int
    """Its place in the map's list of doors."""
    middle: Point
    """A point of it with the most room, m."""
    regions: tuple[int, ...]
    """The regions that it joins, two or more, ascending."""
