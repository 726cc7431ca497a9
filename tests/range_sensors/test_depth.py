"""Depth images as scans: geometry against a hand-made wall, the limits, and what does not fit."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import NO_ECHO_MM
from actors.robot_model import load_model
from firmware_bridge.emulate import Room
from firmware_bridge.range_sensors.depth import DepthCamera, DepthError, DepthScanner

KINECT = load_model("turtlebot2", "kinect").sensor
CAMERA = DepthCamera()


def picture(depth_of_column: NDArray[np.float64]) -> NDArray[np.uint16]:
    """An image with the same in all rows; m."""
    row = np.rint(1000 * depth_of_column).astype(np.uint16)
    return np.tile(row, (CAMERA.height, 1))


def scanned(depth: NDArray[np.uint16], camera: DepthCamera = CAMERA) -> NDArray[np.float64]:
    """The ranges that the model's rays get, m; nan = no echo."""
    scanner = DepthScanner(KINECT, camera)
    scanner.take(Instant(7), depth)
    scan = scanner.scan()
    assert scan is not None
    assert scan.stamp == 7
    assert scanner.scan() is None
    ranges = np.frombuffer(scan.ranges_mm, "<u2")
    metres: NDArray[np.float64] = np.where(ranges == NO_ECHO_MM, np.nan, ranges / 1000)
    return metres


def test_a_wall_straight_ahead_has_the_same_depth_in_all_columns() -> None:
    ranges = scanned(picture(np.full(640, 2.0)))
    angles = np.radians(np.linspace(-29, 29, 640))
    assert np.abs(ranges - 2.0 / np.cos(angles)).max() < 0.004
    assert ranges[0] == pytest.approx(2.287, abs=0.003)  # 2 m / cos 29 degrees


def test_equal_columns_are_not_equal_angles() -> None:
    """Something at 20 degrees to the left is on the left, and at the ray that looks there."""
    column = round(319.5 - CAMERA.focal_length * math.tan(math.radians(20)))
    assert column == 109  # as if equal: 319.5 - 20 / 58 * 640 = 99
    depth = np.full(640, 5.0)
    depth[column - 3 : column + 4] = 1.0
    near = np.flatnonzero(scanned(picture(depth)) < 2.0)
    degrees = np.linspace(-29, 29, 640)[near]
    assert degrees.mean() == pytest.approx(20.0, abs=0.1)
    assert degrees.max() - degrees.min() == pytest.approx(7 * 58 / 640 * 0.96, abs=0.12)


def test_a_room_looks_as_the_simulated_world_sees_it() -> None:
    room, here = Room(6.0, 4.0), Pose(1.5, 1.2, 0.7)
    columns = -np.arctan(CAMERA.slopes)
    along_axis = room.ranges(here, columns) * np.cos(columns)
    truth = room.ranges(here, np.radians(np.linspace(-29, 29, 640)))
    assert np.nanmax(np.abs(scanned(picture(along_axis)) - truth)) < 0.02


def test_the_nearest_valid_value_of_the_rows_counts() -> None:
    depth = np.full((480, 640), 3000, np.uint16)
    depth[238] = 1000
    depth[239] = 0
    depth[240] = 2000
    depth[241] = 300  # nearer than the camera can measure
    ahead = slice(315, 325)
    depth[:, 0] = 3000  # not all is unseen
    assert np.isnan(scanned(depth)[ahead]).all()
    assert scanned(depth, DepthCamera(scan_height=2))[ahead] == pytest.approx(2.0, abs=0.001)
    assert scanned(depth, DepthCamera(scan_height=4))[ahead] == pytest.approx(1.0, abs=0.001)
    assert scanned(depth, DepthCamera(centre_y=238.0))[ahead] == pytest.approx(1.0, abs=0.001)


@pytest.mark.parametrize(
    ("depth_mm", "seen"),
    [(449, False), (450, True), (6500, True), (6501, False), (0, False), (65535, False)],
)
def test_values_outside_the_limits_are_no_echo(depth_mm: int, seen: bool) -> None:
    depth = np.full((480, 640), depth_mm, np.uint16)
    depth[:, :310] = depth[:, 330:] = 0
    depth[:, 0] = 3000  # not all is unseen
    ranges = scanned(depth, DepthCamera(centre_x=320.0))
    assert np.isfinite(ranges[315:325]).any() == seen
    assert np.isnan(ranges[:300]).all()


def test_a_camera_cannot_serve_rays_all_round() -> None:
    with pytest.raises(DepthError) as failure:
        DepthScanner(load_model("turtlebot2", "chapter").sensor)
    assert str(failure.value) == (
        "the camera sees 58°, but the robot model's sensor has rays over 360°; "
        "it should be a sensor that sees no more than the camera"
    )
    DepthScanner(KINECT.model_copy(update={"field_of_view_deg": 40.0}))


def test_images_and_rows_that_do_not_fit() -> None:
    with pytest.raises(DepthError) as failure:
        DepthScanner(KINECT).take(Instant(0), np.zeros((240, 320), np.uint16))
    assert str(failure.value) == ("a depth image has 320 columns and 240 rows; it should have 640 and 480")
    with pytest.raises(DepthError) as failure:
        DepthScanner(KINECT, DepthCamera(scan_height=500))
    assert str(failure.value) == (
        "500 rows round the camera's axis are to be read, but the image has 480; scan_height should fit in"
    )


def test_scans_that_nobody_fetches_are_counted() -> None:
    scanner = DepthScanner(KINECT)
    for _ in range(3):
        scanner.take(Instant(0), np.full((480, 640), 2000, np.uint16))
    assert scanner.missed == 2


@pytest.mark.parametrize("depth_mm", [0, 300])
def test_an_image_in_which_nothing_is_seen_or_all_is_too_near_is_no_free_floor(depth_mm: int) -> None:
    scanner = DepthScanner(KINECT)
    assert not scanner.sees(Instant(0))
    scanner.take(Instant(10_000), np.full((480, 640), 2000, np.uint16))
    assert scanner.scan() is not None
    for stamp in range(40_000, 250_000, 33_000):
        scanner.take(Instant(stamp), np.full((480, 640), depth_mm, np.uint16))
        assert scanner.scan() is None
        assert scanner.sees(Instant(stamp)) == (stamp <= 210_000)
    assert scanner.blind == 7
    scanner.take(Instant(270_000), np.full((480, 640), 20_000, np.uint16))
    assert scanner.sees(Instant(270_000)), "what is far away is seen, too"
