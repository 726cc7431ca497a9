"""Whether two sweeps of a range sensor show one room, if it moved between them as a hypothesis says."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from firmware_bridge.onboard.motion_track import Track
from firmware_bridge.range_sensors.sensor import Sweep

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


class Reading(NamedTuple):
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


def of_the_room(sweep: Sweep) -> Sweep:
    """The echoes of a sweep that are of large things; of those people and robots are not."""
    seen = np.isfinite(sweep.ranges)
    sweep = Sweep(sweep.stamps[seen], sweep.angles[seen], sweep.ranges[seen])
    if not sweep.ranges.size:
        return sweep
    x, y = sweep.ranges * np.cos(sweep.angles), sweep.ranges * np.sin(sweep.angles)
    gaps = np.hypot(np.diff(x), np.diff(y))
    breaks = np.flatnonzero(gaps > np.maximum(_BREAK, _BREAK_SHARE * sweep.ranges[1:])) + 1
    firsts = np.append(0, breaks)
    wide, deep = (np.maximum.reduceat(axis, firsts) - np.minimum.reduceat(axis, firsts) for axis in (x, y))
    large = np.repeat(np.hypot(wide, deep) >= _EXTENT, np.diff(firsts, append=x.size))
    return Sweep(sweep.stamps[large], sweep.angles[large], sweep.ranges[large])


def placed(sweep: Sweep, mount: Pose, track: Track, reading: Reading) -> Points:
    """The points of a sweep's echoes where the hypothesis has them; `mount`: of the sensor on the body."""
    seen = np.isfinite(sweep.ranges)
    ranges, angles = sweep.ranges[seen], sweep.angles[seen] + reading.turned
    angles = mount.heading + (-angles if reading.mirrored else angles)
    body_x, body_y = mount.x + ranges * np.cos(angles), mount.y + ranges * np.sin(angles)
    poses = track.at(sweep.stamps[seen] - reading.late_us)
    c, s = np.cos(poses.heading), np.sin(poses.heading)
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
    squares = along[:, 0] ** 2 + along[:, 1] ** 2
    joined = (squares > 0) & (squares <= _GAP**2)
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
    return sum(int(part.sum()) >= 2 for part in parts)


def headings(step_deg: int) -> tuple[float, ...]:
    """All mountings but the right one, rad."""
    return tuple(math.radians(turned) for turned in range(step_deg, 360, step_deg))
