"""Exact and fast ray casting against the floor plan and bodies."""

import math
from typing import Any, Final

import numpy as np

from actors.array_types import Floats, Int64s, Octets, Records, UInt16s
from actors.floor.raster import (
    Ray,
    bearing_to,
    cell_after,
    free_squares,
    half_width,
    ray,
    square_at,
    window,
)
from actors.floor.raster_arrays import runs
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


def wall_faces(squares: Octets) -> tuple[Floats, Int64s]:
    """Return the border of free and blocking cells as faces, (8, n), and (5,) bounds.

    Rows of a face: line, begin, end, side; x and y of its first end, counter-clockwise, and of the other one.

    squares: of `free_squares`. Units are cells; a face is of maximum length. Side 0: the wall is north of row
    `line`, 1: south; 2: east of column `line`, 3: west. The faces of side k, ordered by line, are
    bounds[k] to bounds[k + 1].
    """
    wall = squares[0] == 0
    faces: list[Floats] = []
    for side, cells in enumerate((wall, wall, wall.T, wall.T)):
        low, high = cells[:-1], cells[1:]
        line, begin, end = runs(high & ~low if side % 2 == 0 else low & ~high)
        first, last = (end, begin) if side in (0, 3) else (begin, end)
        corners = (first, line + 1, last, line + 1) if side < 2 else (line + 1, first, line + 1, last)
        faces.append(np.array([line + 1, begin, end, np.full(line.size, side), *corners], np.float64))
    return np.concatenate(faces, axis=1), np.cumsum([0, *(part.shape[1] for part in faces)])


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def cast(squares: Octets, x: float, y: float, directions: Floats, reach: float, distances: Floats) -> None:
    """Compute distances from (x, y) to the first blocking cell along unit vectors (2, n); inf beyond reach.

    squares: of `free_squares`; distances (n,), written. Units are cells; the distance is 0 from a blocking
    cell or from outside of the map.
    """
    for k in range(distances.size):
        distances[k] = _cast_ray(squares, ray(x, y, directions[0, k], directions[1, k]), reach)


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def _cast_ray(squares: Octets, line: Ray, reach: float) -> float:
    """Return the distance from the start of a ray to the first blocking cell, see `cast`."""
    column, row, distance = math.floor(line.x), math.floor(line.y), 0.0
    if not (0 <= column < squares.shape[2] and 0 <= row < squares.shape[1]):
        return distance
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


_MARGIN: Final = 1e-3
"""Distance from the lines between cells, cells, within which `_cast_fan` does not cast."""
_UNSURE: Final = 1e-6
"""Angle between a ray and a corner, rad, within which the traversal decides what the ray hits."""
_ROUNDING: Final = 1e-9
"""More than the rounding error of the distance to a body, m."""


@njit(error_model="numpy")  # type: ignore[untyped-decorator]
def cast_fan(
    squares: Octets,
    faces: Floats,
    bounds: Int64s,
    x: float,
    y: float,
    bearing: float,
    increment: float,
    directions: Floats,
    reach: float,
    distances: Floats,
) -> None:
    """Compute the results of `cast`, bit for bit, for rays from the angle `bearing` on, `increment` apart.

    faces, bounds: of `wall_faces`. Each face near the sensor shortens the rays between its ends. The
    traversal of cells computes rays near a corner, and all rays if there are too many faces, or from a place
    near a line between cells, where rounding errors decide.
    """
    near = np.empty(distances.size // 2, np.int64)
    found = _faces_near(faces, bounds, x, y, reach + 1.0, near)
    off_x, off_y = abs(x - math.floor(x + 0.5)), abs(y - math.floor(y + 0.5))
    inside = 0 <= x < squares.shape[2] and 0 <= y < squares.shape[1]
    if not inside or squares[0, int(y), int(x)] == 0 or min(off_x, off_y) < _MARGIN or found > near.size:
        cast(squares, x, y, directions, reach, distances)
        return
    per = np.empty((2, distances.size))
    for axis in range(2):
        for k in range(distances.size):
            along = directions[axis, k]
            per[axis, k] = 1 / along if along != 0 else 1e300
    distances[:] = math.inf
    _shorten(faces, near[:found], x, y, bearing, increment, per, distances)
    for k in range(distances.size):
        if distances[k] < 0:
            line = ray(x, y, directions[0, k], directions[1, k])
            distances[k] = _cast_ray(squares, line, reach)
        elif distances[k] > reach:
            distances[k] = math.inf


@kernel
def _faces_near(faces: Floats, bounds: Int64s, x: float, y: float, reach: float, near: Int64s) -> int:
    """Write the faces towards (x, y) within reach; return their number, more than near.size if too many."""
    found = 0
    for side in range(4):
        across, along = (y, x) if side < 2 else (x, y)
        low = across if side % 2 == 0 else across - reach
        lines = faces[0, bounds[side] : bounds[side + 1]]
        begin, end = np.searchsorted(lines, low), np.searchsorted(lines, low + reach)
        for face in range(bounds[side] + begin, bounds[side] + end):
            if faces[1, face] < along + reach and faces[2, face] > along - reach:
                if found < near.size:
                    near[found] = face
                found += 1
    return found


@kernel
def _shorten(
    faces: Floats,
    near: Int64s,
    x: float,
    y: float,
    bearing: float,
    increment: float,
    per: Floats,
    distances: Floats,
) -> None:
    """Shorten the distances of rays that hit the faces `near`; negative: near an end of one.

    per (2, rays): distance along each ray per unit of x and of y.
    """
    ends = np.empty((4, near.size))
    for axis in range(4):
        origin = y if axis % 2 else x
        for k in range(near.size):
            ends[axis, k] = faces[4 + axis, near[k]] - origin
    turn, margin = 2 * math.pi / increment, _UNSURE / increment
    places = _places(ends, bearing, increment)
    for k in range(near.size):
        along = 0 if faces[3, near[k]] > 1 else 1
        ahead, rays = ends[along, k], per[along]
        low, high = places[0, k], places[1, k]
        if high < low:
            high += turn
        for _ in range(2):
            for ray_k in range(max(math.ceil(low), 0), min(math.floor(high) + 1, distances.size)):
                distances[ray_k] = min(distances[ray_k], ahead * rays[ray_k])
            for edge in (low, high):
                nearest = math.floor(edge + 0.5)
                if 0 <= nearest < distances.size and abs(edge - nearest) < margin:
                    distances[nearest] = -1.0
            low, high = low - turn, high - turn


@kernel
def _places(ends: Floats, bearing: float, increment: float) -> Floats:
    """Return both bearings of faces, (2, n), in increments from the first ray; ends (4, n): x, y, x, y."""
    places, turn = np.empty((2, ends.shape[1])), 2 * math.pi / increment
    for end in range(2):
        for k in range(ends.shape[1]):
            place = (_rough_atan2(ends[2 * end + 1, k], ends[2 * end, k]) - bearing) / increment
            places[end, k] = place - turn * math.floor(place / turn)
    return places


@kernel
def _rough_atan2(y: float, x: float) -> float:
    """Return atan2 with an error below 3e-8 rad, without branches, so that loops over it are vectorised.

    Abramowitz and Stegun, "Handbook of Mathematical Functions", 4.4.49.
    """
    high, wide = abs(y), abs(x)
    ratio = min(high, wide) / max(high, wide)
    z = ratio * ratio
    even = 0.0429096138 + z * (-0.0161657367 + z * 0.0028662257)
    even = -0.1420889944 + z * (0.1065626393 + z * (-0.0752896400 + z * even))
    angle = ratio + ratio * (z * (-0.3333314528 + z * (0.1999355085 + z * even)))
    angle = math.pi / 2 - angle if high > wide else angle
    angle = math.pi - angle if x < 0 else angle
    return -angle if y < 0 else angle


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
    nearest = apart - radius - _ROUNDING
    bearing, half = bearing_to(x, y, heading, sensor.first_angle), half_width(apart, radius)
    for turn in range(-1, 2):
        begin, end = window(bearing, half, turn, sensor.increment, sensor.rays)
        for k in range(begin, end):
            if ranges[k] < nearest:
                continue
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
    faces: Floats,
    bounds: Int64s,
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

    squares, faces, bounds: see `cast_fan`; west, south: the map's corner; due (k,): robots; poses (n, 3);
    sensors (n,) of SENSOR; table (m, 2): cosine and sine of the rays in the body's frame; bodies (n,) of
    BODY; vertices (v, 2) in the body's frame; obstacles (o, 3): x, y, radius; starts (k,): index of each scan
    in ranges, written.
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
        heading = poses[own, 2] + sensor.heading
        fan = heading + sensor.first_angle, sensor.increment
        cast_fan(squares, faces, bounds, column, row, *fan, directions, reach, found)
        found *= resolution
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
    faces, bounds = wall_faces(squares)
    sweep(squares, faces, bounds, 0.05, 0.0, 0.0, *carriers, obstacles, starts, ranges)
    report = np.empty(321, np.uint16)
    report_ranges(ranges, arrays.cos(np.arange(310.0)), due, sensors, starts, report)
    return squares.tobytes() + ranges.tobytes() + report.tobytes()
