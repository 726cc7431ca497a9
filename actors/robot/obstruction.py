"""Kernel: how far a disc gets along an arc before it touches what a scan shows."""

import math
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.messages import NO_ECHO_MM

STRAIGHT_BELOW: Final = 1e-3
"""Arcs of less curvature, 1/m, are taken as straight: over a metre the difference is 0.5 mm."""


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    angles = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    # read-only, as what a message holds: so this compiles the very variant that the robot will call
    ranges = np.frombuffer((700 + 400 * np.sin(5 * angles)).astype("<u2").tobytes(), "<u2")
    rays = np.column_stack((np.cos(angles), np.sin(angles)))
    mount, moved = np.array([-0.1, 0.0]), np.array([0.01, -0.02, 0.1])
    curvatures = (-9.0, -1.0, 0.0, 0.4, 4.0)
    return np.array([free_arc(ranges, rays, mount, moved, c, 0.18, 1.5) for c in curvatures]).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _arc_to(x: float, y: float, curvature: float, radius: float) -> float:
    """How far the disc's centre travels from (0, 0), heading along x, until the point is `radius` away, m.

    inf if that never happens. A point that is nearer already counts, as 0, if it is ahead: within 60° of the
    heading; else the disc is leaving it, or sliding along it.
    """
    apart = math.hypot(x, y)
    if apart <= radius:
        return 0.0 if x >= 0.5 * apart else math.inf
    if abs(curvature) < STRAIGHT_BELOW:
        if x <= 0.0 or abs(y) >= radius:
            return math.inf
        return x - math.sqrt(radius * radius - y * y)
    turn = 1.0 / abs(curvature)
    across = turn - (y if curvature > 0.0 else -y)
    from_centre = math.hypot(x, across)
    if from_centre == 0.0:
        return math.inf
    cosine = (turn * turn + from_centre * from_centre - radius * radius) / (2.0 * turn * from_centre)
    if abs(cosine) > 1.0:
        return math.inf
    bearing = math.atan2(x, across)
    if bearing < 0.0:
        bearing += 2.0 * math.pi
    return turn * max(0.0, bearing - math.acos(cosine))


@njit(cache=True)  # type: ignore[untyped-decorator]
def free_arc(
    ranges_mm: NDArray[np.uint16],
    rays: NDArray[np.float64],
    mount: NDArray[np.float64],
    moved: NDArray[np.float64],
    curvature: float,
    radius: float,
    horizon: float,
) -> float:
    """Length of the arc, at most `horizon`, along which a disc of `radius` touches no point of the scan, m.

    `ranges_mm`: (n,), NO_ECHO_MM where a ray met nothing. `rays`: (n, 2) unit vectors in the body's frame;
    `mount`: x, y of the sensor in it, m. `moved`: x, y, heading of the body at the time of the scan, as seen
    from where it is now. `curvature`: of the arc that starts forward, 1/m, > 0 to the left.
    """
    c, s = math.cos(moved[2]), math.sin(moved[2])
    sensor_x = moved[0] + c * mount[0] - s * mount[1]
    sensor_y = moved[1] + s * mount[0] + c * mount[1]
    free = horizon
    for ray in range(ranges_mm.size):
        if ranges_mm[ray] == NO_ECHO_MM:
            continue
        distance = ranges_mm[ray] * 1e-3
        if distance > free + radius + abs(sensor_x) + abs(sensor_y):
            continue
        x = sensor_x + distance * (c * rays[ray, 0] - s * rays[ray, 1])
        y = sensor_y + distance * (s * rays[ray, 0] + c * rays[ray, 1])
        free = min(free, _arc_to(x, y, curvature, radius))
    return free
