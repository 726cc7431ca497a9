"""Measurement model: likelihood of a scan for each particle.

Likelihood field of Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 6.3, with the two
combinations of beams in ros-planning/navigation, amcl_laser.cpp, and its skipping of beams with which few
particles agree (pull request 238).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats, Int64s, Octets, UInt16s
from actors.geometry import Pose
from actors.kernels import kernel
from actors.messages import NO_ECHO_MM
from actors.portable import arrays
from actors.portable.compiled import cos, cos_sin, exp, hypot, sin
from actors.robot.localisation.likelihood_field import LevelGrid, LikelihoodField, example_field
from actors.robot.localisation.parameters import AmclParameters
from actors.robot_model import RangeSensor, scan_angles


class ParticleSet(NamedTuple):
    """Particles: the first `size` entries of the arrays."""

    poses: Floats
    """(3, capacity): x, y, heading, m and rad, map frame."""
    weights: Floats
    """(capacity,)."""
    directions: Floats
    """(2, capacity): cosine and sine of the headings."""
    size: int


class BeamScores(NamedTuple):
    """A scan and the scores of its beams on a map."""

    grid: LevelGrid
    ends: Floats
    """(b, 2): end points of beams, m, body's frame."""
    scores: Floats
    """(256,): score of a beam by the level of its end's cell."""
    agreeing: int
    """Highest level of an end with which a particle agrees."""


class Measurement:
    """Measurement model for one map, sensor and set of parameters."""

    def __init__(self, field: LikelihoodField, range_max: float, parameters: AmclParameters) -> None:
        """Create a model; `range_max`: of the sensor, m, the upper bound of random measurements."""
        self._field = field
        self._parameters = parameters
        p = likelihoods(field, range_max, parameters)
        self._table = p * p * p if parameters.weighting == "cubes" else arrays.log(p)
        self._agreeing = int(np.count_nonzero(field.distances < parameters.beam_skip_distance)) - 1

    def weigh(self, ends: Floats, cloud: ParticleSet, *, together: bool) -> tuple[float, int]:
        """Weigh the particles by a scan; return the fit and the number of skipped beams.

        `ends`: (b, 2), m, body's frame. Multiplies the cloud's weights, normalises them to sum 1, and writes
        its directions. `together`: True if the filter has converged and beams may be skipped.
        """
        parameters, scan = self._parameters, BeamScores(self._field.grid, ends, self._table, self._agreeing)
        if parameters.weighting == "cubes":
            return weigh_by_cubes(scan, cloud), 0
        threshold = parameters.beam_skip_threshold if parameters.beam_skip and together else 0.0
        return weigh_by_product(
            scan, cloud, threshold, parameters.beam_skip_error_threshold, parameters.sharpness
        )


def likelihoods(field: LikelihoodField, range_max: float, parameters: AmclParameters) -> Floats:
    """Return p of a beam's end by the level of its cell: (256,). `range_max`: of the sensor, m."""
    exponent = -0.5 * np.square(field.distances / parameters.sigma_hit)
    hit = parameters.z_hit * arrays.exp(exponent)
    return hit + parameters.z_rand / range_max


@kernel
def weigh_by_cubes(scan: BeamScores, cloud: ParticleSet) -> float:
    """Multiply the weights by 1 + Σp³ and normalise them; return the fit. `scan.scores`: p³ by level.

    The fit is the share of agreements over all beams and particles; 0 without beams.
    """
    sums, fit, _ = _sums(scan, _face(scan.grid.frame, cloud), cloud, 0.0)
    for i in range(cloud.size):
        cloud.weights[i] *= 1.0 + sums[i]
    _normalise(cloud)
    return fit


@kernel
def weigh_by_product(
    scan: BeamScores, cloud: ParticleSet, threshold: float, most: float, sharpness: float
) -> tuple[float, int]:
    """Multiply the weights by (Πp)^`sharpness` and normalise them; return fit and number of skipped beams.

    `scan.scores`: ln p by level. A beam is skipped if less than a share `threshold` of the particles
    agrees with it, unless this applies to at least a share `most` of the beams. The fit excludes skipped
    beams.
    """
    cells = _face(scan.grid.frame, cloud)
    sums, fit, skipped = _sums(scan, cells, cloud, threshold)
    if skipped >= most * scan.ends.shape[0]:  # the particles are wrong, not the beams
        sums, fit, skipped = _sums(scan, cells, cloud, 0.0)
    weights, highest = cloud.weights, -math.inf
    for i in range(cloud.size):
        if weights[i] > 0.0:
            highest = max(highest, sums[i])
    for i in range(cloud.size):
        if weights[i] > 0.0:  # avoids 0 times infinity
            weights[i] *= exp(sharpness * (sums[i] - highest))
    _normalise(cloud)
    return fit, skipped


@kernel
def _face(frame: Floats, cloud: ParticleSet) -> Floats:
    """Return the particles' positions in cells, (2, size); fills the cloud's directions."""
    poses, directions = cloud.poses, cloud.directions
    cells = np.empty((2, cloud.size))
    for i in range(cloud.size):
        cells[0, i] = (poses[0, i] - frame[0]) / frame[2]
        cells[1, i] = (poses[1, i] - frame[1]) / frame[2]
        directions[0, i] = cos(poses[2, i])
        directions[1, i] = sin(poses[2, i])
    return cells


@kernel
def _look_up(
    levels: Octets, cells: Floats, directions: Floats, forward: float, left: float, seen: Octets
) -> None:
    """Write the level of one beam's end for each particle into `seen`; lengths in cells."""
    last_row, last_column = levels.shape[0] - 1.0, levels.shape[1] - 1.0
    places, width, level_of = np.empty(seen.size, np.int32), np.int32(levels.shape[1]), levels.ravel()
    for i in range(seen.size):  # without look-ups, so that the processor computes several at once
        c, s = directions[0, i], directions[1, i]
        column = min(max(cells[0, i] + c * forward - s * left, 0.0), last_column)
        row = min(max(cells[1, i] + s * forward + c * left, 0.0), last_row)
        places[i] = np.int32(row) * width + np.int32(column)
    for i in range(seen.size):
        seen[i] = level_of[np.uint32(places[i])]


@kernel
def _sums(scan: BeamScores, cells: Floats, cloud: ParticleSet, threshold: float) -> tuple[Floats, float, int]:
    """Return each particle's sum of scores of used beams, the fit, and the number of skipped beams."""
    count, ends, side = cloud.size, scan.ends, scan.grid.frame[2]
    sums = np.zeros(count)
    seen = np.empty(count, np.uint8)
    skipped = 0
    agreements = 0
    for beam in range(ends.shape[0]):
        _look_up(scan.grid.levels, cells, cloud.directions, ends[beam, 0] / side, ends[beam, 1] / side, seen)
        agree = 0
        for i in range(count):
            agree += seen[i] <= scan.agreeing
        if agree < threshold * count:
            skipped += 1
            continue
        agreements += agree
        for i in range(count):
            sums[i] += scan.scores[seen[i]]
    return sums, agreements / max((ends.shape[0] - skipped) * count, 1), skipped


@kernel
def _normalise(cloud: ParticleSet) -> None:
    """Normalise the weights to sum 1."""
    total = 0.0
    for i in range(cloud.size):
        total += cloud.weights[i]
    for i in range(cloud.size):
        cloud.weights[i] /= total


AGREEING: Final = 0
"""The beam ends at a wall of the map."""
SHORT: Final = 1
"""The beam ends in visible open space: at an obstacle that is not on the map."""
BEYOND: Final = 2
"""The beam passes through a wall of the map; no obstacle can cause this."""


@kernel
def to_map_frame(x: float, y: float, c: float, s: float, forward: float, left: float) -> tuple[float, float]:
    """Transform a point from the body's frame to the map frame, m.

    (x, y): position of the body; c, s: cosine and sine of its heading.
    """
    return x + c * forward - s * left, y + s * forward + c * left


@kernel
def level_at(levels: Octets, frame: Floats, x: float, y: float) -> int:
    """Return the level of a point's cell, m; outside the map that of the ring."""
    column = min(max((x - frame[0]) / frame[2], 0.0), levels.shape[1] - 1.0)
    row = min(max((y - frame[1]) / frame[2], 0.0), levels.shape[0] - 1.0)
    return int(levels[int(row), int(column)])


@kernel
def classify_beam(
    levels: Octets,
    frame: Floats,
    step: float,
    margin: float,
    eye_x: float,
    eye_y: float,
    end_x: float,
    end_y: float,
) -> int:
    """Classify a beam: AGREEING with an end within `margin` of a wall, BEYOND behind a wall, otherwise SHORT.

    `step`: metres per level. The line is traced in steps of the distance to the nearest wall (Hart, "Sphere
    tracing", The Visual Computer 12, 1996), which uses only the levels, already in the cache; the steps of
    `actors.floor.raster` would need distances for four quadrants.
    """
    if step * level_at(levels, frame, end_x, end_y) <= margin:
        return AGREEING
    length = hypot(end_x - eye_x, end_y - eye_y)
    gone = 0.0
    while gone < length:
        share = gone / length
        level = level_at(levels, frame, eye_x + share * (end_x - eye_x), eye_y + share * (end_y - eye_y))
        if level == 0:
            return BEYOND
        gone += max(step * level - frame[2], 0.5 * frame[2])
    return SHORT


class Beams(NamedTuple):
    """Selected rays of a sensor."""

    rays: Int64s
    """(b,): indices in the scan."""
    directions: Floats
    """(b, 2): unit vectors in the body's frame."""
    mount: Floats
    """(2,): origin in the body's frame, m."""
    reach: float
    """The sensor's range_max, m; longer ranges count as no echo."""


class EndPoints(NamedTuple):
    """End points of a scan's beams."""

    points: Floats
    """(k, 2): end points of beams with an echo that are not masked, m, body's frame."""
    masked: int
    """Number of beams that end at a masked peer."""


def beams(sensor: RangeSensor, count: int) -> Beams:
    """Return `count` rays at equal angles over the field of view; all if the sensor has fewer."""
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


@kernel
def end_points(ranges_mm: UInt16s, beams: Beams, pose: Pose, peers: Floats, radius: float) -> EndPoints:
    """Return the end points of beams with an echo, except those within `radius`, m, of a peer.

    `ranges_mm`: (rays,). `peers`: (p, 2), m, map frame; `pose`: estimate of the robot's pose, map frame.
    """
    rays, directions, mount, reach = beams
    x, y, heading = pose
    points = np.empty((rays.size, 2))
    kept = masked = 0
    c, s = cos_sin(heading)
    for beam in range(rays.size):
        millimetres = ranges_mm[rays[beam]]
        length = 0.001 * millimetres
        if millimetres == NO_ECHO_MM or length >= reach:
            continue
        forward = mount[0] + length * directions[beam, 0]
        left = mount[1] + length * directions[beam, 1]
        if _is_near_peer(peers, *to_map_frame(x, y, c, s, forward, left), radius):
            masked += 1
        else:
            points[kept, 0], points[kept, 1] = forward, left
            kept += 1
    return EndPoints(points[:kept], masked)


@kernel
def _is_near_peer(points: Floats, x: float, y: float, radius: float) -> bool:
    for i in range(points.shape[0]):  # noqa: SIM110 - numba does not support any() of a generator
        if hypot(points[i, 0] - x, points[i, 1] - y) <= radius:
            return True
    return False


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    grid, p = example_field().grid, 0.5 * arrays.exp(-np.arange(256.0) / 50) + 0.1
    poses = np.linspace(-1.5, 3.0, 90, dtype=np.float64).reshape(3, 30)
    points = np.column_stack((arrays.cos(np.arange(12.0)), arrays.sin(np.arange(12.0))))
    cloud = ParticleSet(poses, np.full(30, 1 / 30, np.float64), np.empty((2, 30)), 30)
    fits = (
        weigh_by_cubes(BeamScores(grid, points, p * p * p, 60), cloud),
        *weigh_by_product(BeamScores(grid, points, arrays.log(p), 60), cloud, 0.3, 0.9, 0.5),
    )
    angles = np.linspace(-3.0, 3.0, 30)
    ranges = np.frombuffer((2000 + 900 * arrays.sin(5 * angles)).astype("<u2").tobytes(), "<u2")  # read-only
    directions = np.column_stack((arrays.cos(angles[::3]), arrays.sin(angles[::3])))
    chosen = Beams(np.arange(0, 30, 3), directions, np.array([-0.1, 0.0]), 2.7)
    believed = end_points(ranges, chosen, Pose(1.0, 2.0, 0.5), np.array([[2.0, 3.0]]), 0.9).points
    return b"".join(part.tobytes() for part in (cloud.weights, np.array(fits), believed))
