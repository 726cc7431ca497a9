"""Whether two sweeps of a range sensor show one room, if it moved between them as a hypothesis says."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.portable import arrays
from firmware_bridge.onboard.motion_track import PoseTrack
from firmware_bridge.range_sensors.sensor import SensorSweep

_POINTS: Final = 90
"""Points of the later sweep that are looked for in the earlier one; enough to see a door frame."""
_GAP: Final = 0.5
"""Neighbouring points of a sweep so near to each other are taken for one wall, m."""
_BREAK: Final = 0.15
"""Neighbouring points farther apart than this, m, ..."""
_BREAK_SHARE: Final = 0.07
"""... or than this share of their range belong to two things; a wall looked along at 15° does not break."""
_EXTENT: Final = 0.8
"""Smaller things, m, are no witnesses: people and robots, which may go along with the robot. Own choice."""
_NEAR: Final = 0.02
"""A point so near to that room belongs to it, m; own choice, and ..."""
_NEAR_SHARE: Final = 0.008
"""... so much of its range more: noise, and what a degree leaves open."""


class ScanReading(NamedTuple):
    """How a sweep is read: as it says, or as if the sensor were mounted or timed otherwise."""

    turned: float = 0.0
    """rad, counter-clockwise."""
    mirrored: bool = False
    late_us: int = 0


class Points(NamedTuple):
    """A sweep in the frame of a track."""

    xy: NDArray[np.float64]
    """(n, 2), m; by angle."""
    near: NDArray[np.float64]
    """(n,): how near to the room each has to be, m."""


def load_kernels() -> None:
    """Load what this computes with, before a robot drives: without a cache it takes some seconds."""
    for function in (arrays.cos, arrays.sin):
        function(np.zeros(1))
    arrays.hypot(np.zeros(1), np.zeros(1))


def of_the_room(sweep: SensorSweep) -> SensorSweep:
    """The echoes of a sweep that are of large things; of those people and robots are not."""
    seen = np.isfinite(sweep.ranges)
    sweep = SensorSweep(sweep.stamps[seen], sweep.angles[seen], sweep.ranges[seen])
    if not sweep.ranges.size:
        return sweep
    x, y = sweep.ranges * arrays.cos(sweep.angles), sweep.ranges * arrays.sin(sweep.angles)
    gaps = arrays.hypot(np.diff(x), np.diff(y))
    breaks = gaps > np.maximum(_BREAK, _BREAK_SHARE * sweep.ranges[1:])
    things = np.append(0, np.cumsum(breaks, dtype=np.int64))
    large = (arrays.hypot(_extents(x, things), _extents(y, things)) >= _EXTENT)[things]
    return SensorSweep(sweep.stamps[large], sweep.angles[large], sweep.ranges[large])


def _extents(axis: NDArray[np.float64], things: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of each thing along an axis, m; (n,) coordinates, (n,) numbers of things from 0 on."""
    count = int(things[-1]) + 1
    least, most = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(least, things, axis)
    np.maximum.at(most, things, axis)
    extents: NDArray[np.float64] = most - least
    return extents


def placed(sweep: SensorSweep, mount: Pose, track: PoseTrack, reading: ScanReading) -> Points:
    """The points of a sweep's echoes where the hypothesis has them; `mount`: of the sensor on the body."""
    seen = np.isfinite(sweep.ranges)
    ranges, angles = sweep.ranges[seen], sweep.angles[seen] + reading.turned
    angles = mount.heading + (-angles if reading.mirrored else angles)
    body_x, body_y = mount.x + ranges * arrays.cos(angles), mount.y + ranges * arrays.sin(angles)
    poses = track.at(sweep.stamps[seen] - reading.late_us)
    c, s = arrays.cos(poses.heading), arrays.sin(poses.heading)
    xy = np.column_stack((poses.x + c * body_x - s * body_y, poses.y + s * body_x + c * body_y))
    return Points(xy, _NEAR + _NEAR_SHARE * ranges)


def thinned(points: Points) -> Points:
    """Some of them, evenly."""
    step = max(1, len(points.xy) // _POINTS)
    return Points(points.xy[::step], points.near[::step])


def misfit(later: Points, earlier: Points) -> NDArray[np.float64]:
    """How far each later point is from the room that the earlier ones draw, as a multiple of near: (n,)."""
    begins = earlier.xy[:-1]
    along = earlier.xy[1:] - begins
    squares = along[:, 0] * along[:, 0] + along[:, 1] * along[:, 1]
    joined = (squares > 0) & (squares <= _GAP * _GAP)
    per_square = np.where(joined, 1.0 / np.where(joined, squares, 1.0), 0.0)
    x = later.xy[:, 0, None] - begins[None, :, 0]
    y = later.xy[:, 1, None] - begins[None, :, 1]
    shares = x * along[:, 0] + y * along[:, 1]
    shares *= per_square
    np.clip(shares, 0.0, 1.0, out=shares)
    x -= shares * along[:, 0]
    y -= shares * along[:, 1]
    x *= x
    y *= y
    x += y
    nearest: NDArray[np.float64] = np.sqrt(x.min(axis=1)) / later.near
    return nearest


def sectors(chosen: NDArray[np.bool_], count: int = 12) -> int:
    """In how many equal parts of the sweep some are chosen, two at least."""
    parts = np.array_split(chosen, count)
    return sum(np.count_nonzero(part) >= 2 for part in parts)


def headings(step_deg: int) -> tuple[float, ...]:
    """All mountings but the right one, rad."""
    return tuple(math.radians(turned) for turned in range(step_deg, 360, step_deg))
