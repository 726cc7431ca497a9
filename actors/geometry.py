"""Plane geometry: points, poses, convex polygons and doors.

x points east, y north; angles lie in (−π, π]; units are metres and radians (REP 103).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, NamedTuple, TypeAlias

import msgspec

from actors.portable import atan2, cos_sin, hypot
from deeco.knowledge import new_tuple

GREATEST_COORDINATE: Final = 1e5
"""Largest magnitude of a coordinate, m, and in messages of a velocity, m/s, and an angle, rad."""
Coordinate = Annotated[float, msgspec.Meta(ge=-GREATEST_COORDINATE, le=GREATEST_COORDINATE)]
"""Finite coordinate, velocity or angle; msgspec rejects other values when decoding."""


class Point(NamedTuple):
    """A point in the map frame, m."""

    x: float
    y: float

    def distance_to(self, other: "Point") -> float:
        """Return the Euclidean distance, m."""
        return hypot(self.x - other.x, self.y - other.y)

    def is_nearer(self, to: "Point", distance: float) -> bool:
        """Return True if `to` is less than `distance` away, m (compares squares: faster)."""
        x, y = self.x - to.x, self.y - to.y
        return x * x + y * y < distance * distance


class Pose(NamedTuple):
    """A position, m, and a heading, rad in (−π, π]."""

    x: float
    y: float
    heading: float

    @property
    def point(self) -> Point:
        """The position."""
        return new_tuple(Point, self[:2])

    def compose(self, local: "Pose") -> "Pose":
        """Transform `local` from this pose's frame to this pose's parent frame."""
        c, s = cos_sin(self.heading)
        x, y, heading = local
        turned = self.heading + heading
        if not -math.pi < turned <= math.pi:
            turned = wrap(turned)
        return new_tuple(Pose, (self.x + c * x - s * y, self.y + s * x + c * y, turned))

    def relative(self, other: "Pose") -> "Pose":
        """Transform `other` from this pose's parent frame to this pose's frame: the inverse of `compose`."""
        c, s = cos_sin(self.heading)
        dx, dy = other.x - self.x, other.y - self.y
        turned = other.heading - self.heading
        if not -math.pi < turned <= math.pi:
            turned = wrap(turned)
        return new_tuple(Pose, (c * dx + s * dy, c * dy - s * dx, turned))

    def frame(self, local: "Pose") -> "Pose":
        """Return the frame, in this pose's parent frame, in which this pose has the coordinates `local`."""
        return self.compose(local.relative(ORIGIN))


ORIGIN: Final = Pose(0.0, 0.0, 0.0)


Covariance: TypeAlias = tuple[float, float, float, float, float, float, float, float, float]
"""Covariance of x, y and heading, row by row: m², m·rad, rad²."""
CERTAIN: Final = (0.0,) * 9


class Twist(NamedTuple):
    """A velocity in the body frame: forward and left, m/s, and counter-clockwise, rad/s."""

    vx: float
    vy: float
    omega: float


STILL = Twist(0.0, 0.0, 0.0)


def interpolate(first: Pose, second: Pose, share: float) -> Pose:
    """Interpolate linearly between two poses; `share` is 0 at the first, 1 at the second."""
    turn = wrap(second.heading - first.heading)
    return Pose(
        first.x + share * (second.x - first.x),
        first.y + share * (second.y - first.y),
        wrap(first.heading + share * turn),
    )


def wrap(angle: float) -> float:
    """Return the same angle in (−π, π]."""
    if -math.pi < angle <= math.pi:
        return float(angle)  # a scenario may have whole numbers
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


Vertex = tuple[float, float]


def polygon_fault(vertices: Sequence[Vertex]) -> str:
    """Return why the vertices are not a strictly convex polygon around (0, 0); "" if they are.

    Clockwise and counter-clockwise order are valid.
    """
    ring = counter_clockwise(vertices)
    for (ax, ay), (bx, by), (cx, cy) in zip(ring, (*ring[1:], ring[0]), (*ring[2:], *ring[:2]), strict=True):
        if (bx - ax) * (cy - by) - (by - ay) * (cx - bx) <= 0:
            return f"it is not convex at ({bx:g}, {by:g})"
    if not math.isclose(_turning(ring), math.tau, rel_tol=1e-6):
        return "its border goes around more than once"
    for (ax, ay), (bx, by) in _edges(ring):
        if ax * by - ay * bx <= 0:
            return f"(0, 0) is not inside the edge from ({ax:g}, {ay:g}) to ({bx:g}, {by:g})"
    return ""


def counter_clockwise(vertices: Sequence[Vertex]) -> tuple[Vertex, ...]:
    """Return the polygon with its vertices in counter-clockwise order."""
    area = math.fsum(ax * by - ay * bx for (ax, ay), (bx, by) in _edges(vertices))
    return tuple(vertices) if area > 0 else tuple(reversed(vertices))


def distance_to_border(vertices: Sequence[Vertex]) -> float:
    """Return the distance from (0, 0), inside a convex polygon, to its border."""
    return min(abs(ax * by - ay * bx) / hypot(bx - ax, by - ay) for (ax, ay), (bx, by) in _edges(vertices))


def moment_of_inertia(vertices: Sequence[Vertex], mass: float) -> float:
    """Return the moment of inertia about (0, 0) of a polygon with uniform density; kg m² for kg and m."""
    weight = area = 0.0
    for (ax, ay), (bx, by) in _edges(vertices):
        cross = ax * by - ay * bx
        area += cross
        weight += cross * (ax * ax + ax * bx + bx * bx + ay * ay + ay * by + by * by)
    return mass * weight / (6 * area)


def _turning(ring: Sequence[Vertex]) -> float:
    """Return the sum of the angles between consecutive edges, rad."""
    headings = [atan2(by - ay, bx - ax) for (ax, ay), (bx, by) in _edges(ring)]
    return math.fsum((b - a) % math.tau for a, b in pairwise((*headings, headings[0])))


def _edges(ring: Sequence[Vertex]) -> list[tuple[Vertex, Vertex]]:
    return list(zip(ring, (*ring[1:], ring[0]), strict=True))


@dataclass(frozen=True)
class Door:
    """A narrow passage between regions."""

    index: int
    """Index in the map's list of doors."""
    middle: Point
    """Point of the door with the most clearance, m."""
    regions: tuple[int, ...]
    """Indices of the regions that it connects, two or more, ascending."""
