"""Drawing particles anew, as many as the bins they fall into ask for.

KLD-sampling: Fox, "Adapting the Sample Size in Particle Filters Through KLD-Sampling", International Journal
of Robotics Research 22(12), 2003; Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 8.4.
Particles are drawn one by one, for what has been drawn so far says when to stop. As in
ros-planning/navigation, pf.c, they are counted where they are drawn, before the next step moves them; unlike
there, a single bin asks for the least number of particles and not for the highest.
"""

import math

import numpy as np
from numpy.typing import NDArray

from actors.kernels import njit
from actors.portable import arrays
from actors.robot.localisation.histogram import Histogram, histogram


def resample(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    count: int,
    found: Histogram,
    uniforms: NDArray[np.float64],
    injection: float,
    least: int,
    error: float,
    quantile: float,
    drawn: NDArray[np.float64],
) -> tuple[int, int]:
    """Fill `drawn`, (3, capacity), with particles; gives how many, and how many of them are new poses.

    The first `count` of `poses`, (3, ·), are particles with `weights`; behind them stand new poses. Each draw
    takes with a probability of `injection` the next new pose, else a particle by the weights. `found` has the
    bins of all. `uniforms`: (most,) in [0, 1), one per draw. Drawing ends once there are `least` and
    `kld_bound` of the bins that they are in.
    """
    n, new = _resample(
        poses,
        weights,
        count,
        found.bin_of,
        found.keys.size,
        uniforms,
        injection,
        least,
        error,
        quantile,
        drawn,
    )
    return n, new


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    index = np.arange(60.0)
    poses = np.stack((np.sqrt(index), 0.1 * (index % 7), 3 * arrays.sin(index)))
    weights: NDArray[np.float64] = (1 + index % 5) / 180
    uniforms = np.modf(index * 0.618)[0]
    drawn = np.zeros((3, 60))
    found = histogram(poses, 60)
    resample(poses, weights, 60, found, uniforms, 0.0, 20, 0.5, 1.0, drawn)
    first = drawn.tobytes()
    resample(poses, weights, 40, found, uniforms, 0.3, 20, 0.5, 1.0, drawn)
    return first + drawn.tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def kld_bound(bins: int, error: float, quantile: float) -> float:
    """So many particles keep the Kullback-Leibler distance below `error` (Fox 2003, equation 15).

    `bins`: how many are occupied. `quantile`: upper one of the standard normal distribution for the
    probability that the distance is kept; it stands for that of χ² by the formula of Wilson and Hilferty.
    """
    if bins <= 1:
        return 0.0
    spread = 2 / (9 * (bins - 1))
    root = 1 - spread + math.sqrt(spread) * quantile
    return (bins - 1) / (2 * error) * (root * root * root)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _guide(weights: NDArray[np.float64], sums: NDArray[np.float64]) -> NDArray[np.int64]:
    """Where to begin to look for the particle of a draw; fills `sums` with those of the weights.

    Entry j is the first particle whose sum exceeds a share of j/n of the total (Chen and Asau 1974, "On
    generating random variates from an empirical distribution").
    """
    count = sums.size
    total = 0.0
    for i in range(count):
        total += weights[i]
        sums[i] = total
    guide = np.empty(count, np.int64)
    particle = 0
    for j in range(count):
        while particle < count - 1 and sums[particle] <= j * total / count:
            particle += 1
        guide[j] = particle
    return guide


@njit(cache=True)  # type: ignore[untyped-decorator]
def _resample(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    count: int,
    bin_of: NDArray[np.int64],
    bins: int,
    uniforms: NDArray[np.float64],
    injection: float,
    least: int,
    error: float,
    quantile: float,
    drawn: NDArray[np.float64],
) -> tuple[int, int]:
    sums = np.empty(count)
    guide = _guide(weights, sums)
    hit = np.zeros(bins, np.bool_)
    hits = n = new = 0
    enough = 0.0
    while n < uniforms.size and (n < least or n < enough):
        draw = uniforms[n]
        if draw < injection:
            source = count + new
            new += 1
        else:
            share = (draw - injection) / (1.0 - injection)
            source = guide[min(int(share * count), count - 1)]
            while source < count - 1 and sums[source] <= share * sums[-1]:
                source += 1
        for part in range(3):
            drawn[part, n] = poses[part, source]
        n += 1
        if not hit[bin_of[source]]:
            hit[bin_of[source]] = True
            hits += 1
            enough = kld_bound(hits, error, quantile)
    return n, new
