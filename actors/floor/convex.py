"""Convex polygons in the plane."""

import math
from collections.abc import Sequence
from itertools import pairwise

from actors.portable import atan2, hypot

Vertex = tuple[float, float]


def fault(vertices: Sequence[Vertex]) -> str:
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
