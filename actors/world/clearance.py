"""How far apart two bodies are, exactly, or how deep they overlap."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.portable import arrays, cos_sin
from actors.robot_model import Footprint


class Shape(NamedTuple):
    """A convex polygon, rounded: everything within `radius` of it. One vertex: a disc; two: a line."""

    vertices: NDArray[np.float64]
    """(n, 2), counter-clockwise, m in the map frame."""
    radius: float


def disc(x: float, y: float, radius: float) -> Shape:
    """A disc of that centre and radius, m."""
    return Shape(np.array([[x, y]]), radius)


def placed(footprint: Footprint, pose: Pose) -> Shape:
    """A robot's outline where the robot is."""
    if footprint.radius is not None:
        return disc(pose.x, pose.y, footprint.radius)
    c, s = cos_sin(pose.heading)
    vertices = [(c * x - s * y + pose.x, s * x + c * y + pose.y) for x, y in footprint.vertices or ()]
    return Shape(np.array(vertices), 0.0)


def gap(a: Shape, b: Shape) -> float:
    """Shortest distance between two shapes, m; if they overlap, minus the shortest way apart.

    The shortest way apart of convex polygons lies along the normal of one of their edges (separating axes:
    Gottschalk, Lin & Manocha, "OBBTree", SIGGRAPH 1996, for the plane).
    """
    radii = a.radius + b.radius
    depth = max(_separation(a.vertices, b.vertices), _separation(b.vertices, a.vertices))
    if depth <= 0 and max(len(a.vertices), len(b.vertices)) > 2:
        return depth - radii
    return min(_border_distance(a.vertices, b.vertices), _border_distance(b.vertices, a.vertices)) - radii


def wall_gap(shape: Shape, segments: NDArray[np.float64]) -> float:
    """The smallest gap to those wall segments (n, 4) that reach into the shape's bounding box, m; or inf."""
    low = shape.vertices.min(axis=0) - shape.radius
    high = shape.vertices.max(axis=0) + shape.radius
    ends = segments.reshape(-1, 2, 2)
    near = ((ends.max(axis=1) >= low) & (ends.min(axis=1) <= high)).all(axis=1)
    return smallest_gap(shape, (Shape(line, 0.0) for line in ends[near]))


def smallest_gap(shape: Shape, others: Iterable[Shape]) -> float:
    """The gap to the nearest of the others, m; inf without any."""
    return min((gap(shape, other) for other in others), default=math.inf)


def _separation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """How far b lies beyond a along that of a's edge normals where it does so most; −inf if a is a point."""
    if len(a) == 1:
        return -math.inf
    edges = np.roll(a, -1, axis=0) - a
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / arrays.hypot(*edges.T)[:, None]
    reach = _products(a, normals)
    return float((_products(b[:, None], normals).min(axis=0) - reach).max())


def _border_distance(points: NDArray[np.float64], ring: NDArray[np.float64]) -> float:
    """Distance from the nearest of the points to the border of the ring."""
    edges = np.roll(ring, -1, axis=0) - ring
    lengths = np.maximum(_products(edges, edges), np.finfo(float).tiny)
    offsets = points[:, None, :] - ring[None, :, :]
    along = np.clip(_products(offsets, edges) / lengths, 0.0, 1.0)
    away = offsets - along[:, :, None] * edges
    return float(np.sqrt(_products(away, away).min()))


def _products(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inner products of vectors in the plane: (…, 2) and (…, 2) give (…), as numpy broadcasts them."""
    product: NDArray[np.float64] = a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]
    return product
