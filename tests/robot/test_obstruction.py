"""The free arc against a disc that is pushed along it in small steps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import NO_ECHO_MM, Odometry, Scan
from actors.robot.obstruction import fingerprint, free_arc
from actors.robot.surroundings import ScanError, Surroundings
from tests.robot.base import model

STRIDE = 0.002
HORIZON = 1.2
RAYS = np.column_stack((np.cos(np.linspace(-3.1, 3.1, 24)), np.sin(np.linspace(-3.1, 3.1, 24))))


def pushed(points: NDArray[np.float64], curvature: float, radius: float) -> float:
    """How far the disc gets until a point outside of it at the start is touched."""
    s = np.arange(0.0, HORIZON, STRIDE)
    if curvature == 0:
        x, y = s, np.zeros_like(s)
    else:
        x, y = np.sin(curvature * s) / curvature, (1 - np.cos(curvature * s)) / curvature
    outside = points[np.hypot(points[:, 0], points[:, 1]) > radius]
    if not len(outside):
        return HORIZON
    touched = (np.hypot(outside[:, 0] - x[:, None], outside[:, 1] - y[:, None]) <= radius).any(axis=1)
    return float(s[touched.argmax()]) if touched.any() else HORIZON


@settings(max_examples=200, deadline=None)
@given(
    ranges=st.lists(st.integers(400, 2500) | st.just(NO_ECHO_MM), min_size=24, max_size=24),
    curvature=st.sampled_from([0.0, 0.3, -0.3, 2.0, -2.0, 8.0, -8.0]),
    moved=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-3, 3)),
)
def test_the_free_arc_ends_where_a_pushed_disc_touches(
    ranges: list[int], curvature: float, moved: tuple[float, float, float]
) -> None:
    mount, radius = Pose(-0.1, 0.02, 0.0), 0.177
    seen = [r / 1000 for r in ranges]
    points = [
        Pose(*moved).compose(Pose(mount.x + r * c, mount.y + r * s, 0.0)).point
        for r, (c, s) in zip(seen, RAYS.tolist(), strict=True)
        if r < 60
    ]
    free = free_arc(
        np.array(ranges, np.uint16), RAYS, np.array(mount[:2]), np.array(moved), curvature, radius, HORIZON
    )
    expected = pushed(np.array(points).reshape(-1, 2), curvature, radius)
    assert free == pytest.approx(expected, abs=2 * STRIDE + grazing(points, curvature, radius))


def grazing(points: list[Point], curvature: float, radius: float) -> float:
    """Where a point is passed within 0.1 mm of touching, small strides cannot tell: anything is allowed."""
    for x, y in points:
        if curvature == 0:
            gap = abs(abs(y) - radius)
        else:
            gap = abs(abs(math.hypot(x, y - 1 / curvature) - abs(1 / curvature)) - radius)
        if gap < 1e-4 or abs(math.hypot(x, y) - radius) < 1e-3:
            return math.inf
    return 0.0


@pytest.mark.parametrize("curvature", [0.0, 3.0, -3.0])
def test_what_already_touches_stops_the_disc_in_front_and_nowhere_else(curvature: float) -> None:
    rays = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    here, still = np.zeros(2), np.zeros(3)
    for ray, expected in enumerate([0.0, 1.0, 1.0, 1.0]):
        ranges = np.full(4, NO_ECHO_MM, np.uint16)
        ranges[ray] = 170
        assert free_arc(ranges, rays, here, still, curvature, 0.177, 1.0) == expected


def test_a_scan_is_remembered_where_it_was_taken() -> None:
    surroundings = Surroundings(model(rays=4).sensor)  # rays at −90°, 0°, 90° and 180°, from 0.1 m behind
    assert surroundings.age(Instant(5)) == math.inf
    ranges = np.array([NO_ECHO_MM, 1100, NO_ECHO_MM, NO_ECHO_MM], "<u2")
    surroundings.take(Instant(0), Odometry(3, 1, math.pi / 2, 0, 0, 0), Scan(0, ranges.tobytes()))
    assert surroundings.free_arc(0.0, 0.177, 2.0) == pytest.approx(1.0 - 0.177)
    surroundings.take(Instant(200_000), Odometry(3, 1.4, math.pi / 2, 0, 0, 0), None)
    assert surroundings.free_arc(0.0, 0.177, 2.0) == pytest.approx(0.6 - 0.177)
    surroundings.take(Instant(300_000), Odometry(3, 1.4, 0, 0, 0, 0), None)
    assert surroundings.free_arc(0.0, 0.177, 2.0) == 2.0
    assert surroundings.age(Instant(300_000)) == 0.3


def test_a_scan_of_another_sensor_is_refused() -> None:
    surroundings = Surroundings(model(rays=180).sensor)
    with pytest.raises(ScanError) as caught:
        surroundings.take(Instant(0), Odometry(0, 0, 0, 0, 0, 0), Scan(0, bytes(10)))
    assert (
        str(caught.value) == "a scan of 10 bytes arrived; the 180 rays of the robot's range sensor give 360"
    )


def test_the_fingerprint_is_the_same_each_time() -> None:
    assert fingerprint() == fingerprint()
