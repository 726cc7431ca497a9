"""Depth camera: scans from images, repeated images, the reading thread, and OpenNI2 with a fake library."""

import ctypes
import threading
import time
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.instant import Instant
from actors.messages import NO_ECHO_MM
from actors.robot_model import load_model
from firmware_bridge.range_sensors import depth as depth_camera
from firmware_bridge.range_sensors.depth import (
    Camera,
    CameraError,
    CameraFeed,
    DepthError,
    DepthScanner,
    OpenNICamera,
    column_slopes,
)
from firmware_bridge.range_sensors.sensor import FrozenBeamDetector
from firmware_bridge.safety import HoldCause
from tests.helpers import until
from tests.kobuki.rig import Room

KINECT = load_model("turtlebot2", "kinect").sensor


def picture(depth_of_column: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return an image with equal rows; m."""
    row = np.rint(1000 * depth_of_column).astype(np.uint16)
    return np.tile(row, (480, 1))


def scanned(depth: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Return the ranges along the model's rays, m; nan = no echo."""
    scanner = DepthScanner(KINECT)
    scanner.take(Instant(7), depth)
    scan = scanner.scan()
    assert scan is not None and scan.stamp == 7
    assert scanner.scan() is None
    ranges = np.frombuffer(scan.ranges_mm, "<u2")
    metres: NDArray[np.float64] = np.where(ranges == NO_ECHO_MM, np.nan, ranges / 1000)
    return metres


def test_scans_of_a_room_are_as_in_the_simulated_world() -> None:
    """Columns are not at equal angles, and depth is measured along the axis, unlike a ray's range."""
    room, here = Room(6.0, 4.0), Pose(1.5, 1.2, 0.7)
    columns = -np.arctan(column_slopes())
    along_axis = room.ranges(here, columns) * np.cos(columns)
    truth = room.ranges(here, np.radians(np.linspace(-29, 29, 640)))
    assert np.nanmax(np.abs(scanned(picture(along_axis)) - truth)) < 0.02


def test_an_object_on_the_left_is_on_the_correct_ray() -> None:
    column = round(319.5 - 320 / np.tan(np.radians(29)) * np.tan(np.radians(20)))
    depth = np.full(640, 5.0)
    depth[column - 3 : column + 4] = 1.0
    near = np.flatnonzero(scanned(picture(depth)) < 2.0)
    degrees = np.linspace(-29, 29, 640)[near]
    assert degrees.mean() == pytest.approx(20.0, abs=0.1)
    assert degrees.max() - degrees.min() == pytest.approx(7 * 58 / 640 * 0.96, abs=0.12)


@pytest.mark.parametrize(
    ("depth_mm", "seen"), [(449, False), (450, True), (6499, True), (6501, False), (65535, False)]
)
def test_values_outside_the_limits_are_no_echo(depth_mm: int, seen: bool) -> None:
    depth = np.zeros((480, 640), np.uint16)
    depth[:, 310:330] = depth_mm
    depth[:, 0] = 3000  # one valid value
    ranges = scanned(depth)
    assert np.isfinite(ranges[317:323]).any() == seen
    assert np.isnan(ranges[:300]).all()


def test_mismatching_models_and_images_are_refused() -> None:
    with pytest.raises(DepthError, match="field of view is 58°, that of the robot model's sensor is 360°"):
        DepthScanner(load_model("turtlebot2", "chapter").sensor)
    DepthScanner(replace(KINECT, field_of_view_deg=40.0))
    with pytest.raises(DepthError, match="of 320 x 240 pixels; must be 640 x 480"):
        DepthScanner(KINECT).take(Instant(0), np.zeros((240, 320), np.uint16))


@pytest.mark.parametrize("depth_mm", [0, 300])
def test_images_without_echoes_are_not_free_floor(depth_mm: int) -> None:
    scanner = DepthScanner(KINECT)
    assert not scanner.is_measuring(Instant(0))
    scanner.take(Instant(10_000), np.full((480, 640), 2000, np.uint16))
    assert scanner.scan() is not None
    for stamp in range(40_000, 250_000, 33_000):
        scanner.take(Instant(stamp), np.full((480, 640), depth_mm, np.uint16))
        assert scanner.scan() is None
        assert scanner.is_measuring(Instant(stamp)) == (stamp <= 210_000)
    scanner.take(Instant(270_000), np.full((480, 640), 20_000, np.uint16))
    assert scanner.is_measuring(Instant(270_000)), "far objects are echoes, too"


@pytest.mark.parametrize(("share", "found"), [(0.0, False), (0.2, False), (0.35, True), (1.0, True)])
def test_frozen_beams_are_detected_from_a_share_of_30_percent(share: float, found: bool) -> None:
    beams, random = FrozenBeamDetector(), np.random.default_rng(2)
    still = np.arange(360) % 20 < 20 * share
    for _ in range(6):
        beams.take(np.radians(np.arange(360.0)), np.where(still, 4000, 4000 + random.integers(0, 3, 360)))
    assert beams.found == found
    for _ in range(6):
        beams.take(np.radians(np.arange(360.0)), np.zeros(360, np.int64))
    assert not beams.found, "beams without an echo are not frozen"


def test_repeated_images_are_detected_after_three() -> None:
    scanner, random = DepthScanner(KINECT), np.random.default_rng(1)
    images = [(2000 + random.integers(0, 9, (480, 640))).astype(np.uint16) for _ in range(4)]
    for at, image in enumerate(images):
        scanner.take(Instant(33_000 * at), image)
    for at in range(3):
        assert scanner.fault is None
        scanner.take(Instant(33_000 * (5 + at)), images[at])
    assert scanner.fault is HoldCause.REPEATED_DATA
    assert scanner.sweep() is not None and scanner.sweep() is None


IMAGE: NDArray[np.uint16] = np.full((2, 2), 7, np.uint16)


class Scripted:
    """A scripted camera: an image for True, an error for a string; hangs at the end."""

    def __init__(self, script: list[bool | str], hang: threading.Event) -> None:
        self._script = script
        self._hang = hang
        self.closed = False

    def read(self, patience: float) -> NDArray[np.uint16] | None:
        if not self._script:
            self._hang.wait(10)
            return None
        said = self._script.pop(0)
        if isinstance(said, str):
            raise CameraError(said)
        return IMAGE if said else None

    def close(self) -> None:
        self.closed = True


def test_a_failed_camera_is_reopened_and_a_hanging_one_does_not_block(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(depth_camera, "_RETRY_S", 0.1)
    hang = threading.Event()
    cameras = [Scripted([True, "no image"], hang), Scripted([True, True], hang)]
    opened: list[Camera] = []
    said: list[str] = []

    def open_camera() -> Camera:
        if len(opened) == 1 and not said[1:]:
            raise OSError("no such device")
        opened.append(cameras[len(opened)])
        return opened[-1]

    feed = CameraFeed(open_camera, lambda: Instant(5), said.append)
    until(lambda: len(opened) == 2 and not cameras[1]._script)
    assert said == ["no image", "no such device"]
    assert cameras[0].closed
    image = feed.take()
    assert image is not None and image.stamp == 5 and image.depth is IMAGE
    assert feed.take() is None
    begun = time.monotonic()
    feed.close()
    assert time.monotonic() - begun < 1.0
    hang.set()


class FakeOpenNI:
    """A fake library with a camera of 4 x 2 pixels; `failing`: name of a failing call."""

    def __init__(self, failing: str = "", said: bytes = b"") -> None:
        self.calls: list[str] = []
        self.settings: dict[int, bytes] = {}
        self.waiting = 0
        self._failing, self._said = failing, said
        self.pixels = np.arange(8, dtype=np.uint16).reshape(2, 4) * 100
        # Rows of 10 bytes, of which two are padding.
        self._data = ctypes.create_string_buffer(b"".join(row.tobytes() + b"\xff\xff" for row in self.pixels))
        self.frame = depth_camera._Frame(size=20, width=4, height=2, stride=10)
        self.frame.data = ctypes.addressof(self._data)

    def __getattr__(self, name: str) -> Any:
        def function(*arguments: Any) -> Any:
            return self._call(name, *arguments)

        setattr(self, name, function)  # allows setting restype
        return function

    def _call(self, name: str, *arguments: Any) -> Any:
        if name == "oniGetExtendedError":
            return self._said
        self.calls.append(name)
        if name == self._failing:
            return 1
        if name == "oniWaitForAnyStream":
            return self.waiting
        if name in {"oniDeviceOpen", "oniDeviceCreateStream"}:
            arguments[-1]._obj.value = 99
        elif name == "oniStreamSetProperty":
            self.settings[arguments[1]] = bytes(arguments[2]._obj)
        elif name == "oniStreamReadFrame":
            arguments[1]._obj.contents = self.frame
        return 0


def test_errors_without_library_or_camera_name_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(_: str) -> Any:
        raise OSError("cannot open shared object file")

    library = FakeOpenNI("oniDeviceOpen", b"\tDeviceOpen using default: no devices found\n\n")
    with pytest.raises(CameraError) as failure:
        OpenNICamera(library=library)
    assert "(DeviceOpen using default: no devices found); install drivers with `sudo apt" in str(
        failure.value
    )
    assert library.calls == ["oniInitialize", "oniDeviceOpen", "oniShutdown"]
    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(
        CameraError, match="on Debian and Ubuntu, install it with `sudo apt install libopenni2-0`"
    ):
        OpenNICamera()


def test_images_are_read_unmirrored_without_padding_and_short_ones_refused() -> None:
    library = FakeOpenNI()
    with closing(OpenNICamera(4, 2, 30, library=library)) as camera:
        image = camera.read(0.1)
        library.waiting = 102
        assert camera.read(0.1) is None
        library.waiting, library.frame.size = 0, 19
        with pytest.raises(CameraError, match="image of 19 bytes is too small for 4 x 2 pixels"):
            camera.read(0.1)
    assert image is not None
    assert image.dtype == np.uint16
    assert image.tolist() == library.pixels.tolist()
    assert library.settings[7] == bytes(4)
    assert np.frombuffer(library.settings[3], np.int32).tolist() == [100, 4, 2, 30]
    assert library.calls[-4:] == ["oniStreamStop", "oniStreamDestroy", "oniDeviceClose", "oniShutdown"]
