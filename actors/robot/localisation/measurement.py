"""The measurement model: how well a scan fits the map, seen from each particle.

The likelihood field of Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 6.3, and the two ways
in which ros-planning/navigation, amcl_laser.cpp, makes one weight of the beams' likelihoods, with the
skipping of beams that few particles agree with (its pull request 238).
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from actors.portable import arrays
from actors.portable.compiled import cos, exp, sin
from actors.robot.localisation.likelihood_field import LikelihoodField
from actors.robot.localisation.parameters import AmclParameters


class Measurement:
    """The model for one map, sensor and set of parameters."""

    def __init__(self, field: LikelihoodField, range_max: float, parameters: AmclParameters) -> None:
        """`range_max`: the sensor's, m: there its random measurements end."""
        self._field = field
        self._parameters = parameters
        p = likelihoods(field, range_max, parameters)
        self._table = p * p * p if parameters.weighting == "cubes" else arrays.log(p)
        self._agreeing = int(np.count_nonzero(field.distances < parameters.beam_skip_distance)) - 1

    def weigh(
        self,
        ends: NDArray[np.float64],
        poses: NDArray[np.float64],
        weights: NDArray[np.float64],
        directions: NDArray[np.float64],
        count: int,
        *,
        together: bool,
    ) -> tuple[float, int]:
        """Weigh the first `count` particles by the ends of a scan's beams; gives fit and skipped beams.

        `together`: whether beams may be skipped. All else as for the kernels below.
        """
        parameters = self._parameters
        if parameters.weighting == "cubes":
            fit = weigh_by_cubes(
                self._field, ends, self._table, self._agreeing, poses, weights, directions, count
            )
            return fit, 0
        return weigh_by_product(
            self._field,
            ends,
            self._table,
            self._agreeing,
            parameters.beam_skip_threshold if parameters.beam_skip and together else 0.0,
            parameters.beam_skip_error_threshold,
            parameters.sharpness,
            poses,
            weights,
            directions,
            count,
        )


def likelihoods(field: LikelihoodField, range_max: float, parameters: AmclParameters) -> NDArray[np.float64]:
    """p of a beam's end by the level of its cell: (256,). `range_max` is the sensor's, m."""
    exponent = -0.5 * np.square(field.distances / parameters.sigma_hit)
    hit: NDArray[np.float64] = parameters.z_hit * arrays.exp(exponent)
    return hit + parameters.z_rand / range_max


def weigh_by_cubes(
    field: LikelihoodField,
    ends: NDArray[np.float64],
    cubes: NDArray[np.float64],
    agreeing: int,
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    directions: NDArray[np.float64],
    count: int,
) -> float:
    """Multiply the first `count` weights by 1 + Σp³ and make their sum 1; gives the fit.

    That is the share of the beams, seen from all particles, that end in a level of at most `agreeing`; 0
    without beams. `ends`: (b, 2), m, body's frame. `cubes`: (256,), p³ by level. `poses`: (3, capacity).
    `directions`, (2, capacity), becomes the cosine and sine of the headings.
    """
    fit: float = _weigh_by_cubes(
        field.levels, field.frame, ends, cubes, agreeing, poses, weights, directions, count
    )
    return fit


def weigh_by_product(
    field: LikelihoodField,
    ends: NDArray[np.float64],
    logarithms: NDArray[np.float64],
    agreeing: int,
    threshold: float,
    most: float,
    sharpness: float,
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    directions: NDArray[np.float64],
    count: int,
) -> tuple[float, int]:
    """Multiply weights by (Πp)^`sharpness`; gives the fit, and how many beams were skipped.

    A beam is skipped if its end's level is at most `agreeing` for less than a share `threshold` of the
    particles, unless at least a share `most` of the beams would be. The fit is that of the others.
    `logarithms`: ln p by level; all else as for `weigh_by_cubes`.
    """
    fit, skipped = _weigh_by_product(
        field.levels,
        field.frame,
        ends,
        logarithms,
        agreeing,
        threshold,
        most,
        sharpness,
        poses,
        weights,
        directions,
        count,
    )
    return fit, skipped


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    row, column = np.indices((40, 50))
    levels = ((row * 7 + column * column) % 256).astype(np.uint8)
    frame = np.array([-0.5, -0.5, 0.1])
    for shared in (levels, frame):
        shared.setflags(write=False)  # as in the robot: this compiles the very variants that it calls
    field = LikelihoodField(levels, frame, 2.0, np.empty((0, 2)))
    p = 0.5 * arrays.exp(-np.arange(256.0) / 50) + 0.1
    poses = np.linspace(-1.5, 3.0, 90, dtype=np.float64).reshape(3, 30)
    ends = np.column_stack((arrays.cos(np.arange(12.0)), arrays.sin(np.arange(12.0))))
    weights, directions = np.full(30, 1 / 30, np.float64), np.empty((2, 30))
    fits = (
        weigh_by_cubes(field, ends, p * p * p, 60, poses, weights, directions, 30),
        *weigh_by_product(field, ends, arrays.log(p), 60, 0.3, 0.9, 0.5, poses, weights, directions, 30),
    )
    return weights.tobytes() + np.array(fits).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _face(
    frame: NDArray[np.float64], poses: NDArray[np.float64], directions: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """The particles' positions in cells, (2, count); fills `directions`."""
    cells = np.empty((2, count))
    for i in range(count):
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
def _weigh_by_cubes(
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    ends: NDArray[np.float64],
    cubes: NDArray[np.float64],
    agreeing: int,
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    directions: NDArray[np.float64],
    count: int,
) -> float:
    cells = _face(frame, poses, directions, count)
    sums = np.zeros(count)
    seen = np.empty(count, np.uint8)
    agreements = 0
    for beam in range(ends.shape[0]):
        _look_up(levels, cells, directions, ends[beam, 0] / frame[2], ends[beam, 1] / frame[2], seen)
        for i in range(count):
            sums[i] += cubes[seen[i]]
            agreements += seen[i] <= agreeing
    total = 0.0
    for i in range(count):
        weights[i] *= 1.0 + sums[i]
        total += weights[i]
    for i in range(count):
        weights[i] /= total
    return agreements / max(ends.shape[0] * count, 1)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _weigh_by_product(
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    ends: NDArray[np.float64],
    logarithms: NDArray[np.float64],
    agreeing: int,
    threshold: float,
    most: float,
    sharpness: float,
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    directions: NDArray[np.float64],
    count: int,
) -> tuple[float, int]:
    beams = ends.shape[0]
    cells = _face(frame, poses, directions, count)
    sums, fit, skipped = _sums(levels, frame, ends, logarithms, agreeing, threshold, cells, directions)
    if skipped >= most * beams:  # the particles are wrong, and not the beams
        sums, fit, skipped = _sums(levels, frame, ends, logarithms, agreeing, 0.0, cells, directions)
    highest = -math.inf
    for i in range(count):
        if weights[i] > 0.0:
            highest = max(highest, sums[i])
    total = 0.0
    for i in range(count):
        if weights[i] > 0.0:  # or 0 times infinity
            weights[i] *= exp(sharpness * (sums[i] - highest))
        total += weights[i]
    for i in range(count):
        weights[i] /= total
    return fit, skipped


@njit(cache=True)  # type: ignore[untyped-decorator]
def _sums(
    levels: NDArray[np.uint8],
    frame: NDArray[np.float64],
    ends: NDArray[np.float64],
    logarithms: NDArray[np.float64],
    agreeing: int,
    threshold: float,
    cells: NDArray[np.float64],
    directions: NDArray[np.float64],
) -> tuple[NDArray[np.float64], float, int]:
    """Each particle's Σ ln p over the beams that are not skipped, the fit, and how many are skipped."""
    count = cells.shape[1]
    sums = np.zeros(count)
    seen = np.empty(count, np.uint8)
    skipped = 0
    agreements = 0
    for beam in range(ends.shape[0]):
        _look_up(levels, cells, directions, ends[beam, 0] / frame[2], ends[beam, 1] / frame[2], seen)
        agree = 0
        for i in range(count):
            agree += seen[i] <= agreeing
        if agree < threshold * count:
            skipped += 1
            continue
        agreements += agree
        for i in range(count):
            sums[i] += logarithms[seen[i]]
    return sums, agreements / max((ends.shape[0] - skipped) * count, 1), skipped
