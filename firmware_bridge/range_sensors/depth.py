"""Depth images read as scans: the nearest thing in a few rows round the middle of the picture.

Geometry as in ROS depthimage_to_laserscan; but the columns of an image are not at equal angles, so the rays
of the robot's model are filled by angle and none counts twice.
"""

import hashlib
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.instant import Duration, Instant, milliseconds
from actors.messages import Scan
from actors.portable import atan, tan
from actors.robot_model import RangeSensor as SensorModel
from actors.runtime.errors import AcrcError
from firmware_bridge.range_sensors.sensor import REACH, Rays, Repeats, SensorSweep

_KEPT: Final = 64
"""Earlier images that one is compared with, 2 s; own choice."""
_REPEATED: Final = 3
"""Images on end that may not be repeated; own choice: 0.1 s."""
SIGHT: Final[Duration] = milliseconds(200)
"""An image in which something is seen says so much of the time after it; own choice, six images."""


class DepthError(AcrcError):
    """A depth camera that cannot serve the robot's model."""


@dataclass(frozen=True)
class DepthCamera:
    """A pinhole camera that looks horizontally."""

    width: int = 640
    """Columns."""
    height: int = 480
    """Rows."""
    field_of_view_deg: float = 58.0
    """Between the outer edges of the outer columns, degrees; ASUS Xtion and its like."""
    centre_x: float | None = None
    """Column of the optical axis, counted from the middle of the first; None: the image's middle."""
    centre_y: float | None = None
    """The same of the rows."""
    scan_height: int = 1
    """How many rows round the axis are read; depthimage_to_laserscan: 1."""
    range_min: float = 0.45
    """Nearer than this a value is none, m; depthimage_to_laserscan."""
    range_max: float = 10.0
    """The same for farther, m."""

    @property
    def focal_length(self) -> float:
        """In columns."""
        return self.width / 2 / tan(math.radians(self.field_of_view_deg) / 2)

    @property
    def slopes(self) -> NDArray[np.float64]:
        """How far to the right of the axis each column looks, per metre ahead: (width,)."""
        centre = (self.width - 1) / 2 if self.centre_x is None else self.centre_x
        return (np.arange(self.width, dtype=np.float64) - centre) / self.focal_length

    @property
    def rows(self) -> slice:
        """Those that are read."""
        centre = (self.height - 1) / 2 if self.centre_y is None else self.centre_y
        first = math.ceil(centre - self.scan_height / 2)
        return slice(first, first + self.scan_height)


class DepthScanner:
    """Makes scans of depth images; a RangeSensor."""

    def __init__(self, model: SensorModel, camera: DepthCamera = DepthCamera()) -> None:
        """Raises DepthError if the camera does not see as far round as the model's rays go."""
        self._camera = camera
        self._rays = Rays(model)
        slopes = camera.slopes
        self._angles = -np.array([atan(slope) for slope in slopes.tolist()])
        self._lengths = np.sqrt(1.0 + slopes * slopes) / 1000
        first, last = self._rays.angles[[0, -1]]
        if self._angles[-1] - REACH > first or self._angles[0] + REACH < last:
            raise DepthError(
                f"the camera sees {camera.field_of_view_deg:g}°, but the robot model's sensor has rays over "
                f"{model.field_of_view_deg:g}°; it should be a sensor that sees no more than the camera"
            )
        if not 0 <= camera.rows.start < camera.rows.stop <= camera.height:
            raise DepthError(
                f"{camera.scan_height} rows round the camera's axis are to be read, "
                f"but the image has {camera.height}; scan_height should fit in"
            )
        self._scan: Scan | None = None
        self.missed = 0
        """Scans that nobody fetched before the next."""
        self.blind = 0
        """Images in which nothing was seen: covered, dark, or too near. They make no scan."""
        self._seen: Instant | None = None
        self._sweep: SensorSweep | None = None
        self._repeats = Repeats(_KEPT, _REPEATED, _REPEATED)

    @property
    def repeats(self) -> bool:
        """True while it gives images again that it has given before, as no camera that measures does."""
        return self._repeats.found

    @property
    def stands_still(self) -> bool:
        """A part of a picture that stays the same is not looked for."""
        return False

    def sees(self, now: Instant) -> bool:
        """True while images come in which something is seen."""
        return self._seen is not None and now - self._seen <= SIGHT

    def take(self, stamp: Instant, depth: NDArray[np.uint16]) -> None:
        """An image that was taken at `stamp`: (height, width), mm along the axis; 0 = nothing measured."""
        camera = self._camera
        if depth.shape != (camera.height, camera.width):
            raise DepthError(
                f"a depth image has {depth.shape[1]} columns and {depth.shape[0]} rows; "
                f"it should have {camera.width} and {camera.height}"
            )
        if not (depth[camera.rows] * self._lengths >= camera.range_min).any():
            self.blind += 1
            return
        self._seen = stamp
        self._repeats.take(hashlib.blake2b(depth.tobytes(), digest_size=16).digest())
        self.missed += self._scan is not None
        ranges = self.ranges(depth)
        self._scan = self._rays.scan(stamp, self._angles, ranges)
        self._sweep = SensorSweep(np.full(ranges.size, stamp, np.int64), self._angles, ranges)

    def ranges(self, depth: NDArray[np.uint16]) -> NDArray[np.float64]:
        """The nearest valid range of each column: (width,), m; inf = none."""
        camera = self._camera
        ranges = depth[camera.rows] * self._lengths
        ranges[(ranges < camera.range_min) | (ranges > camera.range_max)] = np.inf
        nearest: NDArray[np.float64] = ranges.min(axis=0)
        return nearest

    def scan(self) -> Scan | None:
        """As for RangeSensor."""
        scan, self._scan = self._scan, None
        return scan

    def sweep(self) -> SensorSweep | None:
        """The ranges of the last image, once."""
        sweep, self._sweep = self._sweep, None
        return sweep
