"""Depth images read as scans: the middle row of the picture.

Geometry as in ROS depthimage_to_laserscan. The columns of an image are not at equal angles, so the rays of
the robot's model are filled by angle.
"""

import hashlib
import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.instant import Duration, Instant, milliseconds
from actors.messages import Scan
from actors.portable import atan, tan
from actors.robot_model import RangeSensor as SensorModel
from actors.runtime.errors import AcrcError
from firmware_bridge.range_sensors.sensor import REACH, Rays, Repeats, SensorSweep

WIDTH, HEIGHT = 640, 480
FIELD_OF_VIEW_DEG: Final = 58.0
"""Between the outer edges of the outer columns, degrees; ASUS Xtion and similar cameras."""
_RANGE_MIN, _RANGE_MAX = 0.45, 10.0
"""Ranges outside these are invalid, m; depthimage_to_laserscan."""
_ROW: Final = math.ceil(HEIGHT / 2) - 1
_KEPT: Final = 64
"""Earlier images that one is compared with, 2 s; own choice."""
_REPEATED: Final = 3
"""Consecutive images that must not be repeated; own choice: 0.1 s."""
SIGHT: Final[Duration] = milliseconds(200)
"""How long an image in which something is seen counts; own choice, six images."""


class DepthError(AcrcError):
    """A depth camera that cannot serve the robot's model."""


def column_slopes() -> NDArray[np.float64]:
    """How far to the right of the optical axis each column looks, per metre ahead: (WIDTH,)."""
    focal_length = WIDTH / 2 / tan(math.radians(FIELD_OF_VIEW_DEG) / 2)
    return (np.arange(WIDTH, dtype=np.float64) - (WIDTH - 1) / 2) / focal_length


class DepthScanner:
    """Makes scans of depth images; a RangeSensor."""

    def __init__(self, model: SensorModel) -> None:
        """Raises DepthError if the camera's field of view is narrower than the model's rays."""
        self._rays = Rays(model)
        slopes = column_slopes()
        self._angles = -np.array([atan(slope) for slope in slopes.tolist()])
        self._lengths = np.sqrt(1.0 + slopes * slopes) / 1000
        first, last = self._rays.angles[[0, -1]]
        if self._angles[-1] - REACH > first or self._angles[0] + REACH < last:
            raise DepthError(
                f"the camera sees {FIELD_OF_VIEW_DEG:g}°, but the robot model's sensor has rays over "
                f"{model.field_of_view_deg:g}°; it should be a sensor that sees no more than the camera"
            )
        self._scan: Scan | None = None
        self._seen: Instant | None = None
        self._sweep: SensorSweep | None = None
        self._repeats = Repeats(_KEPT, _REPEATED, _REPEATED)

    @property
    def repeats(self) -> bool:
        """True while it repeats earlier images, which a measuring camera never does."""
        return self._repeats.found

    def sees(self, now: Instant) -> bool:
        """True while images come in which something is seen."""
        return self._seen is not None and now - self._seen <= SIGHT

    def take(self, stamp: Instant, depth: NDArray[np.uint16]) -> None:
        """Take an image of the instant `stamp`: (HEIGHT, WIDTH), mm along the axis; 0 = nothing measured.

        An image in which nothing is seen (covered, dark, or everything too near) makes no scan.
        """
        if depth.shape != (HEIGHT, WIDTH):
            raise DepthError(
                f"a depth image has {depth.shape[1]} columns and {depth.shape[0]} rows; "
                f"it should have {WIDTH} and {HEIGHT}"
            )
        ranges = depth[_ROW] * self._lengths
        if not (ranges >= _RANGE_MIN).any():
            return
        ranges[(ranges < _RANGE_MIN) | (ranges > _RANGE_MAX)] = np.inf
        self._seen = stamp
        self._repeats.take(hashlib.blake2b(depth.tobytes(), digest_size=16).digest())
        self._scan = self._rays.scan(stamp, self._angles, ranges)
        self._sweep = SensorSweep(np.full(ranges.size, stamp, np.int64), self._angles, ranges)

    def scan(self) -> Scan | None:
        """As for RangeSensor."""
        scan, self._scan = self._scan, None
        return scan

    def sweep(self) -> SensorSweep | None:
        """The ranges of the last image, once."""
        sweep, self._sweep = self._sweep, None
        return sweep
