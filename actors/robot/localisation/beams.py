"""Which beams of a scan the filter looks at, and where they end."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Pose
from actors.kernels import njit
from actors.messages import NO_ECHO_MM
from actors.portable import arrays
from actors.portable.compiled import cos_sin, hypot
from actors.robot.localisation.line_of_sight import placed
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
    """Where the beams of a scan end that have an echo and are to be believed."""

    points: NDArray[np.float64]
    """(k, 2), m, body's frame."""
    masked: int
    """So many ended at a masked peer."""


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
    ranges_mm: NDArray[np.uint16], beams: Beams, pose: Pose, peers: NDArray[np.float64], radius: float
) -> Ends:
    """The ends of the beams with an echo, but for those within `radius`, m, of a peer.

    `ranges_mm`: (rays,). `peers`: (p, 2), m, map frame; `pose`: the robot's there, as far as known.
    """
    return Ends(*_ends(ranges_mm, *beams, *pose, peers, radius))


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
    peers = np.array([[2.0, 3.0]])
    return ends(ranges, chosen, Pose(1.0, 2.0, 0.5), peers, 0.9).points.tobytes()


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
) -> tuple[NDArray[np.float64], int]:
    points = np.empty((rays.size, 2))
    kept = masked = 0
    c, s = cos_sin(heading)
    for beam in range(rays.size):
        millimetres = ranges_mm[rays[beam]]
        length = 0.001 * millimetres
        if millimetres == _NO_ECHO or length >= reach:
            continue
        forward = mount[0] + length * directions[beam, 0]
        left = mount[1] + length * directions[beam, 1]
        if _near(peers, *placed(x, y, c, s, forward, left), radius):
            masked += 1
        else:
            points[kept, 0], points[kept, 1] = forward, left
            kept += 1
    return points[:kept], masked


@njit(cache=True)  # type: ignore[untyped-decorator]
def _near(points: NDArray[np.float64], x: float, y: float, radius: float) -> bool:
    for i in range(points.shape[0]):  # noqa: SIM110 - numba knows no any() of a generator
        if hypot(points[i, 0] - x, points[i, 1] - y) <= radius:
            return True
    return False
