"""The measurement model: how well a scan fits the map, seen from each particle.

The likelihood field of Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 6.3, and the two ways
in which ros-planning/navigation, amcl_laser.cpp, makes one weight of the beams' likelihoods, with the
skipping of beams that few particles agree with (its pull request 238).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable import arrays
from actors.portable.compiled import cos, exp, sin
from actors.robot.localisation.likelihood_field import LevelGrid, LikelihoodField, specimen
from actors.robot.localisation.parameters import AmclParameters


class Cloud(NamedTuple):
    """Particles: the first `size` of what there is room for."""

    poses: NDArray[np.float64]
    """(3, capacity): x, y, heading, m and rad, map frame."""
    weights: NDArray[np.float64]
    """(capacity,)."""
    directions: NDArray[np.float64]
    """(2, capacity): cosine and sine of the headings."""
    size: int


class Readings(NamedTuple):
    """Where the beams of a scan end, and what the map makes of that."""

    grid: LevelGrid
    ends: NDArray[np.float64]
    """(b, 2), m, body's frame."""
    worth: NDArray[np.float64]
    """(256,): what a beam counts by the level of its end's cell."""
    agreeing: int
    """A particle agrees with a beam that ends, seen from it, in a level of at most this."""


class Measurement:
    """The model for one map, sensor and set of parameters."""

    def __init__(self, field: LikelihoodField, range_max: float, parameters: AmclParameters) -> None:
        """`range_max`: the sensor's, m: there its random measurements end."""
        self._field = field
        self._parameters = parameters
        p = likelihoods(field, range_max, parameters)
        self._table = p * p * p if parameters.weighting == "cubes" else arrays.log(p)
        self._agreeing = int(np.count_nonzero(field.distances < parameters.beam_skip_distance)) - 1

    def weigh(self, ends: NDArray[np.float64], cloud: Cloud, *, together: bool) -> tuple[float, int]:
        """Weigh the particles by the ends, (b, 2), m, body's frame, of a scan's beams; gives the fit, and how
        many beams were skipped.

        The cloud's weights are multiplied, and their sum becomes 1; its directions are written. `together`:
        whether beams may be skipped.
        """
        parameters, readings = self._parameters, Readings(self._field.grid, ends, self._table, self._agreeing)
        if parameters.weighting == "cubes":
            fit = weigh_by_cubes(readings, cloud)
            return fit, 0
        threshold = parameters.beam_skip_threshold if parameters.beam_skip and together else 0.0
        fit, skipped = weigh_by_product(
            readings, cloud, threshold, parameters.beam_skip_error_threshold, parameters.sharpness
        )
        return fit, skipped


def likelihoods(field: LikelihoodField, range_max: float, parameters: AmclParameters) -> NDArray[np.float64]:
    """p of a beam's end by the level of its cell: (256,). `range_max` is the sensor's, m."""
    exponent = -0.5 * np.square(field.distances / parameters.sigma_hit)
    hit: NDArray[np.float64] = parameters.z_hit * arrays.exp(exponent)
    return hit + parameters.z_rand / range_max


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    field = specimen()
    p = 0.5 * arrays.exp(-np.arange(256.0) / 50) + 0.1
    poses = np.linspace(-1.5, 3.0, 90, dtype=np.float64).reshape(3, 30)
    ends = np.column_stack((arrays.cos(np.arange(12.0)), arrays.sin(np.arange(12.0))))
    cloud = Cloud(poses, np.full(30, 1 / 30, np.float64), np.empty((2, 30)), 30)
    fits = (
        weigh_by_cubes(Readings(field.grid, ends, p * p * p, 60), cloud),
        *weigh_by_product(Readings(field.grid, ends, arrays.log(p), 60), cloud, 0.3, 0.9, 0.5),
    )
    return cloud.weights.tobytes() + np.array(fits).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def weigh_by_cubes(readings: Readings, cloud: Cloud) -> float:
    """Multiply the weights by 1 + Σp³ and make their sum 1; gives the fit. `readings.worth`: p³ by level.

    The fit is the share of the beams, seen from all particles, that they agree with; 0 without beams.
    """
    fit: float
    sums, fit, _ = _sums(readings, _face(readings.grid.frame, cloud), cloud, 0.0)
    for i in range(cloud.size):
        cloud.weights[i] *= 1.0 + sums[i]
    _normalise(cloud)
    return fit


@njit(cache=True)  # type: ignore[untyped-decorator]
def weigh_by_product(
    readings: Readings, cloud: Cloud, threshold: float, most: float, sharpness: float
) -> tuple[float, int]:
    """Multiply the weights by (Πp)^`sharpness` and make their sum 1; gives the fit, and how many beams were
    skipped. `readings.worth`: ln p by level.

    A beam is skipped if less than a share `threshold` of the particles agrees with it, unless at least a
    share `most` of the beams would be. The fit is that of the others.
    """
    cells = _face(readings.grid.frame, cloud)
    sums, fit, skipped = _sums(readings, cells, cloud, threshold)
    if skipped >= most * readings.ends.shape[0]:  # the particles are wrong, and not the beams
        sums, fit, skipped = _sums(readings, cells, cloud, 0.0)
    weights, highest = cloud.weights, -math.inf
    for i in range(cloud.size):
        if weights[i] > 0.0:
            highest = max(highest, sums[i])
    for i in range(cloud.size):
        if weights[i] > 0.0:  # or 0 times infinity
            weights[i] *= exp(sharpness * (sums[i] - highest))
    _normalise(cloud)
    return fit, skipped


@njit(cache=True)  # type: ignore[untyped-decorator]
def _face(frame: NDArray[np.float64], cloud: Cloud) -> NDArray[np.float64]:
    """The particles' positions in cells, (2, size); fills the cloud's directions."""
    poses, directions = cloud.poses, cloud.directions
    cells = np.empty((2, cloud.size))
    for i in range(cloud.size):
        cells[0, i] = (poses[0, i] - frame[0]) / frame[2]
        cells[1, i] = (poses[1, i] - frame[1]) / frame[2]
        directions[0, i] = cos(poses[2, i])
        directions[1, i] = sin(poses[2, i])
    return cells


@njit(cache=True)  # type: ignore[untyped-decorator]
def _look_up(
    levels: NDArray[np.uint8],
    cells: NDArray[np.float64],
    directions: NDArray[np.float64],
    forward: float,
    left: float,
    seen: NDArray[np.uint8],
) -> None:
    """The level where one beam ends, seen from each particle; all in cells."""
    last_row, last_column = levels.shape[0] - 1.0, levels.shape[1] - 1.0
    for i in range(seen.size):
        c, s = directions[0, i], directions[1, i]
        column = min(max(cells[0, i] + c * forward - s * left, 0.0), last_column)
        row = min(max(cells[1, i] + s * forward + c * left, 0.0), last_row)
        seen[i] = levels[int(row), int(column)]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _sums(
    readings: Readings, cells: NDArray[np.float64], cloud: Cloud, threshold: float
) -> tuple[NDArray[np.float64], float, int]:
    """Each particle's sum of what the beams that are not skipped count, the fit, and how many are skipped."""
    count, ends, side = cloud.size, readings.ends, readings.grid.frame[2]
    sums = np.zeros(count)
    seen = np.empty(count, np.uint8)
    skipped = 0
    agreements = 0
    for beam in range(ends.shape[0]):
        _look_up(
            readings.grid.levels, cells, cloud.directions, ends[beam, 0] / side, ends[beam, 1] / side, seen
        )
        agree = 0
        for i in range(count):
            agree += seen[i] <= readings.agreeing
        if agree < threshold * count:
            skipped += 1
            continue
        agreements += agree
        for i in range(count):
            sums[i] += readings.worth[seen[i]]
    return sums, agreements / max((ends.shape[0] - skipped) * count, 1), skipped


@njit(cache=True)  # type: ignore[untyped-decorator]
def _normalise(cloud: Cloud) -> None:
    """Make the sum of the weights 1."""
    total = 0.0
    for i in range(cloud.size):
        total += cloud.weights[i]
    for i in range(cloud.size):
        cloud.weights[i] /= total
