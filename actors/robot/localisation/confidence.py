"""Covariance of the estimate, and fit of a pose to a scan.

The particles' covariance exceeds the error of their mean, since motion and measurement model overestimate
noise to avoid overconfidence. Therefore the scan updates the covariance again, beam by beam, as in a Kalman
filter with realistic noise.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats, Int64s
from actors.geometry import Covariance, Pose
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import cos_sin
from actors.robot.localisation.likelihood_field import LevelGrid, LikelihoodField, example_field
from actors.robot.localisation.measurement import (
    AGREEING,
    BEYOND,
    SHORT,
    classify_beam,
    level_at,
    to_map_frame,
)
from actors.robot_model import RangeSensor

AGREES: Final = 0.3
"""Distance from a wall within which a beam's end agrees with the map, m; own choice."""
_PASSING: Final = 2.0
"""Penalty of a beam that passes through a wall, in beams that end at one; own choice."""


class BeamClasses(NamedTuple):
    """Classification of a scan's beams at one pose."""

    known: Floats
    """(k, 2), m, body's frame: end points of beams that end at known obstacles."""
    strangers: int
    """Number of beams that end in visible open space: at obstacles that are not on the map."""
    agreeing: int
    """Number of beams that end within AGREES of a wall."""
    beyond: int
    """Number of other beams that pass through a wall."""


class PoseFit(NamedTuple):
    """Fit of n poses to a scan."""

    score: Floats
    """(n,), at most 1: mean over the beams of 1 for an end at a wall, decreasing with distance, 0 for one
    that ends before a wall, and -2 for one that passes through a wall."""
    agreeing: Int64s
    beyond: Int64s
    """(n,): numbers of beams as in BeamClasses."""


def beam_scores(field: LikelihoodField, sigma: float) -> Floats:
    """Return the score of a beam's end by its cell's level: (256,); `sigma`: accuracy of the poses, m."""
    return arrays.exp(-0.5 * np.square(field.distances / sigma))


@kernel
def classify_beams(
    grid: LevelGrid, points: Floats, mount: Floats, pose: Pose, stranger_distance: float
) -> BeamClasses:
    """Classify beams with end points (b, 2), m, body's frame, at `pose`; `mount`: (2,), origin of the beams.

    Strangers end before a wall and farther than `stranger_distance`, m, from walls; inf: there are none.
    """
    levels, frame, step = grid
    known = np.empty(points.shape)
    kept = strangers = agreeing = beyond = 0
    x, y, heading = pose
    c, s = cos_sin(heading)
    eye_x, eye_y = to_map_frame(x, y, c, s, mount[0], mount[1])
    for i in range(points.shape[0]):
        end_x, end_y = to_map_frame(x, y, c, s, points[i, 0], points[i, 1])
        apart = step * level_at(levels, frame, end_x, end_y)
        seen = classify_beam(levels, frame, step, min(AGREES, stranger_distance), eye_x, eye_y, end_x, end_y)
        if apart <= AGREES:
            agreeing += 1
        elif seen == BEYOND:
            beyond += 1
        if seen == SHORT and apart > stranger_distance:
            strangers += 1
        else:
            known[kept, 0], known[kept, 1] = points[i, 0], points[i, 1]
            kept += 1
    return BeamClasses(known[:kept], strangers, agreeing, beyond)


@kernel
def explain(grid: LevelGrid, points: Floats, mount: Floats, poses: Floats, score_by_level: Floats) -> PoseFit:
    """Return the fit of each of `poses`, (3, n), to a scan with an end point; see `classify_beams`."""
    levels, frame, step = grid
    count, beams = poses.shape[1], points.shape[0]
    scores = np.empty(count)
    agreeing, beyond = np.zeros(count, np.int64), np.zeros(count, np.int64)
    for i in range(count):
        x, y = poses[0, i], poses[1, i]
        c, s = cos_sin(poses[2, i])
        eye_x, eye_y = to_map_frame(x, y, c, s, mount[0], mount[1])
        total = 0.0
        for k in range(beams):
            end_x, end_y = to_map_frame(x, y, c, s, points[k, 0], points[k, 1])
            seen = classify_beam(levels, frame, step, AGREES, eye_x, eye_y, end_x, end_y)
            if seen == AGREEING:
                agreeing[i] += 1
                total += score_by_level[level_at(levels, frame, end_x, end_y)]
            elif seen == BEYOND:
                beyond[i] += 1
                total -= _PASSING
        scores[i] = total / beams
    return PoseFit(scores, agreeing, beyond)


_SIGMA: Final = 0.025
"""Standard deviation of a beam's end from the map's wall, m: half a cell of 5 cm. Fitted, as are the values
below, to courses of `acrc verify localisation` with 0 to 10 other robots, at 58° and 360°, on three maps."""
_TOGETHER: Final = math.radians(10.0)
"""Angle within which beams meet the same wall and have correlated errors."""
_OF_CLOUD: Final = 0.03
"""Share of the particles' covariance that is kept, since their mean is random."""
_HARDLY_LOST: Final = 0.05
"""Probability of being lost below which it is ignored; otherwise it would dominate the covariance."""


class CovarianceModel:
    """Covariances of one robot's estimates."""

    def __init__(self, field: LikelihoodField, sensor: RangeSensor, beams: int) -> None:
        """Create the model; `beams`: number of beams used per scan."""
        self._field = field
        angle = math.radians(sensor.field_of_view_deg) / beams
        self._variance = _SIGMA * _SIGMA * max(1.0, _TOGETHER / angle)
        self._anywhere = field.anywhere

    def covariance(self, points: Floats, pose: Pose, cloud: Covariance, lost: float) -> Covariance:
        """Return the covariance of an estimate `pose` from particles with the covariance `cloud`.

        `points`: (b, 2), m, body's frame, end points of the scan's beams. `lost`: probability of being lost,
        which is mixed into the covariance.
        """
        sharp = updated_covariance(self._field, points, pose, cloud, self._variance)
        honest = [
            _OF_CLOUD * wide + (1 - _OF_CLOUD) * narrow for wide, narrow in zip(cloud, sharp, strict=True)
        ]
        if lost > _HARDLY_LOST:
            honest = [(1 - lost) * a + lost * b for a, b in zip(honest, self._anywhere, strict=True)]
        return (
            honest[0], honest[1], honest[2], honest[3], honest[4], honest[5], honest[6], honest[7], honest[8],
        )  # fmt: skip


def updated_covariance(
    field: LikelihoodField, points: Floats, pose: Pose, prior: Covariance, variance: float
) -> Covariance:
    """Return the covariance updated by beams that end near a wall, each with `variance`, m².

    The variance is divided by the square of the share of such beams, since the others bias the estimate.
    """
    before = np.array(prior).reshape(3, 3)
    after = _updated_covariance(field.grid, points, *pose, before, variance)
    xx, xy, xh, _, yy, yh, _, _, hh = after.ravel().tolist()
    return (xx, xy, xh, xy, yy, yh, xh, yh, hh)


@kernel
def _updated_covariance(
    grid: LevelGrid, points: Floats, x: float, y: float, heading: float, prior: Floats, variance: float
) -> Floats:
    levels, frame, step = grid
    after = prior.copy()
    slope, gain = np.empty(3), np.empty(3)
    c, s = cos_sin(heading)
    side = frame[2]
    near = np.empty(points.shape)
    count = 0
    for i in range(points.shape[0]):
        east, north = c * points[i, 0] - s * points[i, 1], s * points[i, 0] + c * points[i, 1]
        if step * level_at(levels, frame, x + east, y + north) <= AGREES:
            near[count, 0], near[count, 1] = east, north
            count += 1
    crowding = points.shape[0] / max(count, 1)
    for i in range(count):
        east, north = near[i, 0], near[i, 1]
        end_x, end_y = x + east, y + north
        for axis in range(2):  # as floats, since levels are unsigned
            over = (side, 0.0) if axis == 0 else (0.0, side)
            after_it = float(level_at(levels, frame, end_x + over[0], end_y + over[1]))
            before_it = float(level_at(levels, frame, end_x - over[0], end_y - over[1]))
            slope[axis] = step * (after_it - before_it) / (2 * side)
        slope[2] = slope[1] * east - slope[0] * north
        spread = variance * crowding * crowding
        for row in range(3):
            gain[row] = 0.0
            for column in range(3):
                gain[row] += after[row, column] * slope[column]
            spread += slope[row] * gain[row]
        for row in range(3):
            for column in range(3):
                after[row, column] -= gain[row] * gain[column] / spread
    return after


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    field, angles, mount = example_field(), np.arange(40.0), np.array([-0.1, 0.0])
    rays = np.column_stack((arrays.cos(angles), arrays.sin(angles)))
    judged = classify_beams(field.grid, 2.1 * rays, mount, Pose(1.0, 2.0, 0.5), 0.12)
    poses = np.linspace(-1.5, 3.0, 60, dtype=np.float64).reshape(3, 20)
    explained = explain(field.grid, 2.1 * rays, mount, poses, beam_scores(field, 0.1))
    prior = (0.3, 0.1, 0.0, 0.1, 0.2, 0.05, 0.0, 0.05, 0.4)
    sharp = np.array(updated_covariance(field, 1.4 * rays, Pose(1.0, 1.2, 0.5), prior, 0.01))
    return b"".join(part.tobytes() for part in (judged.known, np.array(judged[1:]), *explained, sharp))
