"""Exact and fast ray casting against the floor plan and bodies."""

import math
from typing import Any

import numpy as np

from actors.array_types import Floats, Int64s, Octets, Records, UInt16s
from actors.floor.raster import (
    Ray,
    bearing_to,
    cell_after,
    free_squares,
    half_width,
    quadrant,
    square_at,
    window,
)
from actors.kernels import kernel, njit
from actors.portable import arrays
from actors.portable.compiled import cos_sin, hypot

SENSOR = np.dtype(
    [
        *[(name, "f8") for name in ("x", "y", "heading", "first_angle", "increment")],
        *[(name, "i8") for name in ("rays", "table")],
        *[(name, "f8") for name in ("range_min", "range_max", "noise", "noise_growth")],
    ],
    align=True,
)
"""A range sensor on a body; `table`: index of its first ray in the table of directions."""
BODY = np.dtype(
    [("radius", "f8"), ("first_vertex", "i8"), ("vertices", "i8")],
    align=True,
)
"""A body's outline: a disc if it has no vertices, otherwise `radius` is its circumradius."""


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def cast(squares: Octets, x: float, y: float, directions: Floats, reach: float, distances: Floats) -> None:
    """Compute distances from (x, y) to the first blocking cell along unit vectors (2, n); inf beyond reach.

    squares: of `free_squares`; distances (n,), written. Units are cells; the distance is 0 from a blocking
    cell or from outside of the map.
    """
    column, row = math.floor(x), math.floor(y)
    distances[:] = 0.0
    if not (0 <= column < squares.shape[2] and 0 <= row < squares.shape[1]) or not squares[0, row, column]:
        return
    per_x, per_y, columns, rows = np.empty((4, distances.size))
    _first_leap(
        squares[:, row, column], x, y, directions[0], directions[1], per_x, per_y, columns, rows, distances
    )
    for k in range(distances.size):
        dx, dy = directions[0, k], directions[1, k]
        line = Ray(x, y, dx, dy, per_x[k], per_y[k], quadrant(dx, dy))
        distances[k] = _remaining_distance(squares, line, int(columns[k]), int(rows[k]), distances[k], reach)


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _first_leap(
    sides: Octets,
    x: float,
    y: float,
    dx: Floats,
    dy: Floats,
    per_x: Floats,
    per_y: Floats,
    columns: Floats,
    rows: Floats,
    distances: Floats,
) -> None:
    """Compute the first leap of all rays from a point, as `square_at` and `cell_after`.

    sides (4,): of the squares around the point, by quadrant; dx, dy (n,); the others (n,), written: values of
    `Ray`, column and row of the cell entered, and the distance along the ray.

    All rays leap out of the same four squares. As this needs no look at the map, compilers vectorise it,
    provided that all numbers are floats and the arrays do not overlap.
    """
    north_east, north_west = float(sides[0]), float(sides[1])
    south_east, south_west = float(sides[2]), float(sides[3])
    column, row = float(math.floor(x)), float(math.floor(y))
    for k in range(distances.size):
        ray_x, ray_y = dx[k], dy[k]
        inverse_x = 1 / ray_x if ray_x != 0 else 1e300
        inverse_y = 1 / ray_y if ray_y != 0 else 1e300
        east, north = ray_x >= 0, ray_y >= 0
        side = (north_east if east else north_west) if north else (south_east if east else south_west)
        left = column if east else column - side + 1
        bottom = row if north else row - side + 1
        border_x = column + side if east else left
        border_y = row + side if north else bottom
        to_x, to_y = (border_x - x) * inverse_x, (border_y - y) * inverse_y
        distance = to_x if to_x < to_y else to_y
        at_x = min(max(np.floor(x + distance * ray_x), left), left + side - 1)
        at_y = min(max(np.floor(y + distance * ray_y), bottom), bottom + side - 1)
        per_x[k], per_y[k] = inverse_x, inverse_y
        columns[k] = (border_x if east else border_x - 1) if to_x < to_y else at_x
        rows[k] = at_y if to_x < to_y else (border_y if north else border_y - 1)
        distances[k] = distance


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _remaining_distance(
    squares: Octets, line: Ray, column: int, row: int, distance: float, reach: float
) -> float:
    """Return the distance to the first blocking cell of a ray from a cell on its way; inf beyond reach."""
    if distance > reach:
        return math.inf
    sides = squares[line.quadrant]
    side = int(sides[np.uint64(row), np.uint64(column)])  # unsigned, as numba wraps negative indices
    while side:
        square = square_at(line, column, row, side)
        distance = min(square.to_x, square.to_y)
        if distance > reach:
            return math.inf
        column, row = cell_after(line, square, distance)
        side = int(sides[np.uint64(row), np.uint64(column)])
    return distance


@kernel
def _to_disc(x: float, y: float, radius: float, dx: float, dy: float) -> float:
    """Return the distance from the origin along (dx, dy) to a disc around (x, y); inf without a hit."""
    along = x * dx + y * dy
    aside = x * dy - y * dx
    rest = radius * radius - aside * aside
    if rest < 0:
        return math.inf
    half = math.sqrt(rest)
    return max(along - half, 0.0) if along + half >= 0 else math.inf


@kernel
def _to_polygon(ring: Floats, dx: float, dy: float) -> float:
    """Return the distance to a convex polygon (n, 2), counter-clockwise: where the ray is inside all edges.

    Cyrus and Beck, "Generalized two- and three-dimensional clipping", Computers & Graphics 3, 1978.
    """
    enter, leave = 0.0, math.inf
    for k in range(ring.shape[0]):
        ax, ay = ring[k - 1, 0], ring[k - 1, 1]
        normal_x, normal_y = ring[k, 1] - ay, ax - ring[k, 0]
        outside = -(ax * normal_x + ay * normal_y)
        slope = dx * normal_x + dy * normal_y
        if slope < 0:
            enter = max(enter, outside / -slope)
        elif slope > 0:
            leave = min(leave, -outside / slope)
        elif outside > 0:
            return math.inf
    return enter if enter <= leave else math.inf


@kernel
def _occlude(
    x: float,
    y: float,
    radius: float,
    ring: Floats,
    sensor: Any,
    heading: float,
    directions: Floats,
    ranges: Floats,
) -> None:
    """Shorten the ranges of rays that hit a body; (x, y): its centre relative to the sensor, map frame."""
    apart = hypot(x, y)
    if apart - radius > sensor.range_max:
        return
    bearing, half = bearing_to(x, y, heading, sensor.first_angle), half_width(apart, radius)
    for turn in range(-1, 2):
        begin, end = window(bearing, half, turn, sensor.increment, sensor.rays)
        for k in range(begin, end):
            dx, dy = directions[0, k], directions[1, k]
            found = _to_polygon(ring, dx, dy) if ring.shape[0] else _to_disc(x, y, radius, dx, dy)
            ranges[k] = min(ranges[k], found)


@kernel
def _vertices_at(body: Any, pose: Floats, vertices: Floats, x: float, y: float) -> Floats:
    """Return the (n, 2) vertices of a body at a pose relative to (x, y), map frame."""
    ring = np.empty((body.vertices, 2))
    c, s = cos_sin(pose[2])
    for k in range(body.vertices):
        forward, leftward = vertices[body.first_vertex + k, 0], vertices[body.first_vertex + k, 1]
        ring[k, 0] = pose[0] - x + c * forward - s * leftward
        ring[k, 1] = pose[1] - y + s * forward + c * leftward
    return ring


@kernel
def sweep(
    squares: Octets,
    resolution: float,
    west: float,
    south: float,
    due: Int64s,
    poses: Floats,
    sensors: Records,
    table: Floats,
    bodies: Records,
    vertices: Floats,
    obstacles: Floats,
    starts: Int64s,
    ranges: Floats,
) -> None:
    """Compute the true ranges of all due sensors, m; inf beyond a sensor's reach.

    west, south: the map's corner; due (k,): robots; poses (n, 3); sensors (n,) of SENSOR; table (m, 2):
    cosine and sine of the rays in the body's frame; bodies (n,) of BODY; vertices (v, 2) in the body's frame;
    obstacles (o, 3): x, y, radius; starts (k,): index of each scan in ranges, written.
    """
    nothing = np.empty((0, 2))
    for scan in range(due.size):
        own = due[scan]
        sensor: Any = sensors[own]
        c, s = cos_sin(poses[own, 2])
        x = poses[own, 0] + c * sensor.x - s * sensor.y
        y = poses[own, 1] + s * sensor.x + c * sensor.y
        found = ranges[starts[scan] : starts[scan] + sensor.rays]
        directions = np.empty((2, sensor.rays))
        column, row = (x - west) / resolution + 1, (y - south) / resolution + 1
        reach = sensor.range_max / resolution
        for k in range(sensor.rays):
            ray_x, ray_y = table[sensor.table + k, 0], table[sensor.table + k, 1]
            directions[0, k], directions[1, k] = c * ray_x - s * ray_y, s * ray_x + c * ray_y
        cast(squares, column, row, directions, reach, found)
        found *= resolution
        heading = poses[own, 2] + sensor.heading
        for other in range(bodies.size):
            body: Any = bodies[other]
            away_x, away_y = poses[other, 0] - x, poses[other, 1] - y
            if other == own or hypot(away_x, away_y) - body.radius > sensor.range_max:
                continue
            ring = _vertices_at(body, poses[other], vertices, x, y) if body.vertices else nothing
            _occlude(away_x, away_y, body.radius, ring, sensor, heading, directions, found)
        for k in range(obstacles.shape[0]):
            away_x, away_y = obstacles[k, 0] - x, obstacles[k, 1] - y
            _occlude(away_x, away_y, obstacles[k, 2], nothing, sensor, heading, directions, found)
        for k in range(sensor.rays):
            if found[k] > sensor.range_max:
                found[k] = math.inf


@kernel
def report_ranges(
    ranges: Floats,
    normals: Floats,
    due: Int64s,
    sensors: Records,
    starts: Int64s,
    report: UInt16s,
) -> None:
    """Convert true ranges, (n,) m, to reported ones with noise, (n,) mm; 65535 = no echo.

    ranges, due, sensors, starts: see `sweep`; report: written; normals: standard normal draws, (rays,) for
    each scan of a sensor with noise, consecutively.
    """
    drawn = 0
    for scan in range(due.size):
        sensor: Any = sensors[due[scan]]
        noisy = sensor.noise > 0 or sensor.noise_growth > 0
        for k in range(starts[scan], starts[scan] + sensor.rays):
            value = ranges[k]
            if noisy:
                if value < math.inf:
                    value += normals[drawn] * (sensor.noise + sensor.noise_growth * value * value)
                drawn += 1
            echo = sensor.range_min <= max(value, 0.0) <= sensor.range_max
            report[k] = np.uint16(math.floor(max(value, 0.0) * 1000 + 0.5)) if echo else np.uint16(65535)


def fingerprint() -> bytes:
    """Return the kernels' results for fixed inputs, which differ if a processor computes differently."""
    blocking = arrays.sin(np.square(np.arange(1200.0))).reshape(30, 40) > 0.9
    blocking[14:17, 9:31] = False
    squares = free_squares(blocking)
    sensors = np.array(
        [
            (-0.1, 0.02, 0.3, -3.1, 0.02, 310, 0, 0.05, 6.5, 0.01, 0.001),
            (0.2, 0, 0, -0.5, 0.1, 11, 0, 0.0, 0.7, 0, 0),
        ],
        SENSOR,
    )
    bodies = np.array([(0.177, 0, 0), (0.2, 0, 3)], BODY)
    angles = -3.1 + 0.02 * np.arange(310)
    table = np.stack([arrays.cos(angles), arrays.sin(angles)], axis=1)
    poses = np.array([[0.8, 0.78, 0.1], [1.2, 0.79, -2.0]])
    corners = np.array([[0.1, 0.1], [-0.15, 0.12], [0.0, -0.2]])
    obstacles = np.array([[1.0, 0.9, 0.05]])
    due, ranges, starts = np.arange(2), np.empty(321), np.array([0, 310])
    carriers = due, poses, sensors, table, bodies, corners
    sweep(squares, 0.05, 0.0, 0.0, *carriers, obstacles, starts, ranges)
    report = np.empty(321, np.uint16)
    report_ranges(ranges, arrays.cos(np.arange(310.0)), due, sensors, starts, report)
    return squares.tobytes() + ranges.tobytes() + report.tobytes()
