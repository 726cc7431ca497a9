"""Which beams of a scan the filter looks at, and where they end."""

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.messages import NO_ECHO_MM
from actors.portable import arrays
from actors.portable.compiled import cos_sin, hypot
from actors.robot.localisation.likelihood_field import LEVELS, LikelihoodField
from actors.robot_model import RangeSensor, scan_angles

_NO_ECHO: Final = NO_ECHO_MM


class Beams(NamedTuple):
    """A choice of a sensor's rays."""

    rays: NDArray[np.int64]
    """(b,): which of the scan."""
    directions: NDArray[np.float64]
    """(b, 2): unit vectors in the body's frame."""
    mount: NDArray[np.float64]
    """(2,): where they begin in the body's frame, m."""
    reach: float
    """The sensor's range_max, m: what is not nearer counts as no echo."""


class Ends(NamedTuple):
    """Where the believed beams of a scan end."""

    points: NDArray[np.float64]
    """(k, 2), m, body's frame."""
    masked: int
    """So many ended at a masked peer."""
    strangers: int
    """So many were dropped as they ended at what is not on the map."""


def beams(sensor: RangeSensor, count: int) -> Beams:
    """`count` rays at equal angles over the sensor's view; all of them if it has no more."""
    count = min(count, sensor.rays)
    spaces = count if sensor.full_circle else max(count - 1, 1)
    angles = np.arange(count) * (math.radians(sensor.field_of_view_deg) / spaces)
    rays = np.minimum(np.rint(angles / sensor.increment).astype(np.int64), sensor.rays - 1)
    directions = scan_angles(sensor)[rays]
    return Beams(
        rays,
        np.column_stack((arrays.cos(directions), arrays.sin(directions))),
        np.array([sensor.x, sensor.y]),
        sensor.range_max,
    )


def ends(
    ranges_mm: NDArray[np.uint16],
    beams: Beams,
    pose: Pose,
    peers: NDArray[np.float64],
    radius: float,
    field: LikelihoodField,
    stranger_distance: float,
    most_strangers: float,
) -> Ends:
    """The ends of the beams with an echo, but for those within `radius`, m, of a peer, and strangers.

    `ranges_mm`: (rays,). `peers`: (p, 2), m, map frame; `pose`: the robot's there, as far as known. Strangers
    are ends farther than `stranger_distance`, m, from the walls of `field`, with no wall before them; inf:
    there are none. If their share of the beams is `most_strangers` or more, none is dropped.
    """
    step = field.max_distance / (LEVELS - 1)
    return Ends(
        *_ends(
            ranges_mm,
            *beams,
            *pose,
            peers,
            radius,
            field.levels,
            field.frame,
            step,
            stranger_distance,
            most_strangers,
        )
    )


def fingerprint() -> bytes:
    """What the kernel gives for fixed inputs: differs where a processor or compiler computes differently."""
    angles = np.linspace(-3.0, 3.0, 30)
    ranges = np.frombuffer((2000 + 900 * arrays.sin(5 * angles)).astype("<u2").tobytes(), "<u2")  # read-only
    chosen = Beams(
        np.arange(0, 30, 3),
        np.column_stack((arrays.cos(angles[::3]), arrays.sin(angles[::3]))),
        np.array([-0.1, 0.0]),
        2.7,
    )
    row, column = np.indices((50, 50))
    levels = np.minimum(12 * np.minimum(row, abs(column - 20)), 255).astype(np.uint8)
    frame = np.array([-0.5, -0.5, 0.1])
    for shared in (levels, frame):
        shared.setflags(write=False)  # as in the robot: this compiles the very variant that it calls
    field = LikelihoodField(levels, frame, 2.0, np.empty((0, 2)))
    peers = np.array([[2.0, 3.0]])
    return ends(ranges, chosen, Pose(1.0, 2.0, 0.5), peers, 0.9, field, 0.3, 0.8).points.tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _ends(
    ranges_mm: NDArray[np.uint16],
    rays: NDArray[np.int64],
    directions: NDArray[np.float64],
    mount: NDArray[np.float64],
    reach: float,
    x: float,
    y: float,
    heading: float,
    peers: NDArray[np.float64],
    radius: float,
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    step: float,
    stranger_distance: float,
    most_strangers: float,
) -> tuple[NDArray[np.float64], int, int]:
    points = np.empty((rays.size, 2))
    kept = masked = strangers = 0
    c, s = cos_sin(heading)
    eye_x, eye_y = x + c * mount[0] - s * mount[1], y + s * mount[0] + c * mount[1]
    for beam in range(rays.size):
        millimetres = ranges_mm[rays[beam]]
        length = 0.001 * millimetres
        if millimetres == _NO_ECHO or length >= reach:
            continue
        forward = mount[0] + length * directions[beam, 0]
        left = mount[1] + length * directions[beam, 1]
        end_x, end_y = x + c * forward - s * left, y + s * forward + c * left
        if _near(peers, end_x, end_y, radius):
            masked += 1
        elif stranger_distance < math.inf and _in_the_open(
            levels, frame, step, stranger_distance, eye_x, eye_y, end_x, end_y
        ):
            strangers += 1  # at the back, to be taken up if there are too many
            points[rays.size - strangers, 0], points[rays.size - strangers, 1] = forward, left
        else:
            points[kept, 0], points[kept, 1] = forward, left
            kept += 1
    if strangers < most_strangers * (kept + strangers):
        return points[:kept], masked, strangers
    for stranger in range(rays.size - strangers, rays.size):
        points[kept, 0], points[kept, 1] = points[stranger, 0], points[stranger, 1]
        kept += 1
    return points[:kept], masked, 0


@njit(cache=True)  # type: ignore[untyped-decorator]
def _in_the_open(
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    step: float,
    margin: float,
    eye_x: float,
    eye_y: float,
    end_x: float,
    end_y: float,
) -> bool:
    """True if a beam's end is farther than `margin` from walls, and none lies before it.

    The line is followed in leaps as long as the distance to the nearest wall (Hart, "Sphere tracing", The
    Visual Computer 12, 1996).
    """
    if step * _level(levels, frame, end_x, end_y) <= margin:
        return False
    length = hypot(end_x - eye_x, end_y - eye_y)
    gone = 0.0
    while gone < length:
        share = gone / length
        level = _level(levels, frame, eye_x + share * (end_x - eye_x), eye_y + share * (end_y - eye_y))
        if level == 0:
            return False
        gone += max(step * level - frame[2], 0.5 * frame[2])
    return True


@njit(cache=True)  # type: ignore[untyped-decorator]
def _level(levels: NDArray[np.uint8], frame: NDArray[np.float64], x: float, y: float) -> int:
    column = min(max((x - frame[0]) / frame[2], 0.0), levels.shape[1] - 1.0)
    row = min(max((y - frame[1]) / frame[2], 0.0), levels.shape[0] - 1.0)
    return int(levels[int(row), int(column)])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _near(points: NDArray[np.float64], x: float, y: float, radius: float) -> bool:
    for i in range(points.shape[0]):  # noqa: SIM110 - numba knows no any() of a generator
        if hypot(points[i, 0] - x, points[i, 1] - y) <= radius:
            return True
    return False
