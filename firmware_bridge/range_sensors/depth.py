"""Scans from the middle row of depth images, and the driver of depth cameras by OpenNI2.

Geometry as in ROS depthimage_to_laserscan. Image columns are not at equal angles, so samples are assigned to
the rays of the robot's model by angle.
"""

import ctypes
import ctypes.util
import hashlib
import math
import threading
from collections.abc import Callable
from contextlib import closing
from ctypes import byref, c_int, c_void_p
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from actors.array_types import Floats, UInt16s
from actors.instant import Instant, milliseconds
from actors.portable import atan, tan
from actors.robot_model import RangeSensor as SensorModel
from actors.runtime.errors import AcrcError
from firmware_bridge.range_sensors.sensor import REACH, RangeReader, SensorSweep
from firmware_bridge.serial_port import Say, changed_only

WIDTH, HEIGHT = 640, 480
FIELD_OF_VIEW_DEG: Final = 58.0
"""Angle between the outer edges of the outer columns, degrees; ASUS Xtion and similar cameras."""
_RANGE_MIN, _RANGE_MAX = 0.45, 10.0
"""Limits of valid ranges, m; depthimage_to_laserscan."""
_ROW: Final = math.ceil(HEIGHT / 2) - 1
_KEPT: Final = 64
"""Number of earlier images for comparison, 2 s; own choice."""
_REPEATED: Final = 3
"""Consecutive repeated images that are a fault; own choice: 0.1 s."""
SIGHT: Final = milliseconds(200)
"""Timeout of images with echoes; own choice, six images."""


class DepthError(AcrcError):
    """Mismatch of depth camera and robot model."""


def column_slopes() -> Floats:
    """Return the slope of each column to the right of the optical axis: (WIDTH,), m per m."""
    focal_length = WIDTH / 2 / tan(math.radians(FIELD_OF_VIEW_DEG) / 2)
    return (np.arange(WIDTH, dtype=np.float64) - (WIDTH - 1) / 2) / focal_length


class DepthScanner(RangeReader):
    """Converter of depth images to scans."""

    def __init__(self, model: SensorModel) -> None:
        """Create it. Raises DepthError if the camera's field of view is narrower than the model's rays."""
        super().__init__(model, _KEPT, _REPEATED, _REPEATED)
        slopes = column_slopes()
        self._angles = -np.array([atan(slope) for slope in slopes.tolist()])
        self._lengths = np.sqrt(1.0 + slopes * slopes) / 1000
        first, last = self.rays.angles[[0, -1]]
        if self._angles[-1] - REACH > first or self._angles[0] + REACH < last:
            raise DepthError(
                f"the camera's field of view is {FIELD_OF_VIEW_DEG:g}°, that of the robot model's sensor is "
                f"{model.field_of_view_deg:g}°; choose a sensor within the camera's field of view"
            )
        self._seen: Instant | None = None

    def is_measuring(self, now: Instant) -> bool:
        """Return whether a recent image has echoes."""
        return self._seen is not None and now - self._seen <= SIGHT

    def take(self, stamp: Instant, depth: UInt16s) -> None:
        """Process the image at `stamp`: (HEIGHT, WIDTH), mm along the axis; 0 = no measurement.

        An image without echoes (covered, dark, or everything too near) gives no scan.
        """
        if depth.shape != (HEIGHT, WIDTH):
            raise DepthError(
                f"depth image of {depth.shape[1]} x {depth.shape[0]} pixels; must be {WIDTH} x {HEIGHT}"
            )
        ranges = depth[_ROW] * self._lengths
        if not (ranges >= _RANGE_MIN).any():
            return
        ranges[(ranges < _RANGE_MIN) | (ranges > _RANGE_MAX)] = np.inf
        self._seen = stamp
        self._repeats.take(hashlib.blake2b(depth.tobytes(), digest_size=16).digest())
        self.store_sweep(stamp, SensorSweep(np.full(ranges.size, stamp, np.int64), self._angles, ranges))


_PATIENCE_S: Final = 0.1
"""Timeout of one image, s: three images at 30 Hz."""
_RETRY_S: Final = 1.0
"""Delay before reopening a failed camera, s."""


class Camera(Protocol):
    """Source of depth images."""

    def read(self, patience: float) -> UInt16s | None:
        """Return the next image, mm; None after a timeout of `patience` s."""

    def close(self) -> None:
        """Close the camera."""


class Image(NamedTuple):
    """A depth image with its time of arrival."""

    stamp: Instant
    depth: UInt16s


class CameraFeed:
    """Latest image of a camera, read by a thread that reopens the camera after errors."""

    def __init__(self, open_camera: Callable[[], Camera], clock: Callable[[], Instant], say: Say) -> None:
        """Start the thread; `say`: called by it with each new error."""
        self._open = open_camera
        self._clock = clock
        self._say = changed_only(say)
        self._newest: Image | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def take(self) -> Image | None:
        """Return the latest image, once; does not block."""
        image, self._newest = self._newest, None
        return image

    def close(self) -> None:
        """Close the camera, unless its library hangs."""
        self._ended.set()
        self._thread.join(2 * _PATIENCE_S)

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                self._follow()
            except Exception as error:
                self._say(str(error) or type(error).__name__)
                self._ended.wait(_RETRY_S)

    def _follow(self) -> None:
        with closing(self._open()) as camera:
            while not self._ended.is_set():
                depth = camera.read(_PATIENCE_S)
                if depth is not None:
                    self._say("")
                    self._newest = Image(self._clock(), depth)


_API_VERSION: Final = 2002
_DEPTH: Final = 3
_DEPTH_1_MM: Final = 100
_VIDEO_MODE: Final = 3
_MIRRORING: Final = 7
_TIME_OUT: Final = 102


class CameraError(AcrcError):
    """Failure of a depth camera."""


class _VideoMode(ctypes.Structure):
    _fields_ = (
        ("pixel_format", c_int),
        ("width", c_int),
        ("height", c_int),
        ("rate", c_int),
    )


class _Frame(ctypes.Structure):
    _fields_ = (
        ("size", c_int),
        ("data", c_void_p),
        ("sensor", c_int),
        ("stamp_us", ctypes.c_uint64),
        ("number", c_int),
        ("width", c_int),
        ("height", c_int),
        ("mode", _VideoMode),
        ("cropped", c_int),
        ("crop_x", c_int),
        ("crop_y", c_int),
        ("stride", c_int),
    )


def find_library() -> Any:
    """Load OpenNI2. Raises CameraError."""
    for name in (ctypes.util.find_library("OpenNI2"), "libOpenNI2.so.0", "libOpenNI2.so"):
        try:
            if name is not None:
                return ctypes.CDLL(name)
        except OSError:
            continue
    raise CameraError(
        "the depth camera needs the library OpenNI2; on Debian and Ubuntu, install it with "
        "`sudo apt install libopenni2-0`"
    )


class OpenNICamera:
    """The first depth camera found by OpenNI2."""

    def __init__(self, width: int = 640, height: int = 480, rate: int = 30, library: Any = None) -> None:
        """Open the camera; `library`: OpenNI2, None: load it. Raises CameraError."""
        self._library = find_library() if library is None else library
        self._device = c_void_p()
        self._stream = c_void_p()
        self._library.oniGetExtendedError.restype = ctypes.c_char_p
        self._library.oniFrameRelease.restype = None
        self._try(self._library.oniInitialize(_API_VERSION), "OpenNI2 does not start")
        try:
            self._open(_VideoMode(_DEPTH_1_MM, width, height, rate))
        except CameraError:
            self.close()
            raise

    def read(self, patience: float) -> UInt16s | None:
        """Return the next image, (height, width), mm, unmirrored; None after `patience` s. Raises
        CameraError."""
        library = self._library
        streams, ready = (c_void_p * 1)(self._stream), c_int()
        status = library.oniWaitForAnyStream(streams, 1, byref(ready), int(1000 * patience))
        if status == _TIME_OUT:
            return None
        self._try(status, "no image from the depth camera")
        frame = ctypes.POINTER(_Frame)()
        self._try(library.oniStreamReadFrame(self._stream, byref(frame)), "the image cannot be read")
        try:
            return _image(frame.contents)
        finally:
            library.oniFrameRelease(frame)

    def close(self) -> None:
        """Close the camera."""
        if self._stream:
            self._library.oniStreamStop(self._stream)
            self._library.oniStreamDestroy(self._stream)
            self._stream = c_void_p()
        if self._device:
            self._library.oniDeviceClose(self._device)
            self._device = c_void_p()
        self._library.oniShutdown()

    def _open(self, mode: _VideoMode) -> None:
        library = self._library
        device, stream = byref(self._device), byref(self._stream)
        self._try(library.oniDeviceOpen(None, device), "no depth camera found, or no permission")
        self._try(
            library.oniDeviceCreateStream(self._device, _DEPTH, stream), "the camera has no depth sensor"
        )
        asked = f"the camera does not support {mode.width} x {mode.height} at {mode.rate} Hz in mm"
        self._set(_VIDEO_MODE, mode, asked)
        # The driver mirrors images by default.
        self._set(_MIRRORING, c_int(0), "the camera's mirroring cannot be switched off")
        self._try(library.oniStreamStart(self._stream), "the camera does not start")

    def _set(self, setting: int, value: Any, otherwise: str) -> None:
        status = self._library.oniStreamSetProperty(self._stream, setting, byref(value), ctypes.sizeof(value))
        self._try(status, otherwise)

    def _try(self, status: int, otherwise: str) -> None:
        if status != 0:
            said = (self._library.oniGetExtendedError() or b"").decode("utf-8", "replace")
            reason = " ".join(said.split()) or f"status {status}"
            raise CameraError(
                f"{otherwise} ({reason}); install drivers with `sudo apt install libopenni2-0 openni2-utils` "
                "and test the camera with NiViewer2"
            )


def _image(frame: _Frame) -> UInt16s:
    """Return a copy of the frame's pixels, (height, width)."""
    if frame.stride < 2 * frame.width or frame.stride * frame.height > frame.size or not frame.data:
        raise CameraError(
            f"image of {frame.size} bytes is too small for {frame.width} x {frame.height} pixels of 2 bytes "
            f"in rows of {frame.stride}"
        )
    raw = ctypes.string_at(frame.data, frame.stride * frame.height)
    rows = np.frombuffer(raw, np.uint8).reshape(frame.height, frame.stride)
    return np.ascontiguousarray(rows[:, : 2 * frame.width]).view("<u2")
