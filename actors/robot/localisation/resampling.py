"""Resampling of particles with adaptive sample size.

KLD-sampling: Fox, "Adapting the Sample Size in Particle Filters Through KLD-Sampling", International Journal
of Robotics Research 22(12), 2003; Thrun, Burgard and Fox, "Probabilistic Robotics", 2005, table 8.4.
Particles are drawn one by one until the bound is reached. As in ros-planning/navigation, pf.c, occupied bins
are counted before the next motion update; unlike there, a single bin requires the least number of particles,
not the highest.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from actors.array_types import Floats, Int64s
from actors.geometry import Covariance, Pose
from actors.kernels import kernel
from actors.portable import arrays
from actors.portable.compiled import atan2

SIDE: Final = 0.5
"""Side of a bin, m."""
HEADINGS: Final = 36
"""Number of heading bins."""
_EMPTY: Final = -1
_COORDINATE: Final = 1 << 24
"""Range of a bin's column and row, centred at 0: 4000 km."""


class Histogram(NamedTuple):
    """Occupied bins of particles, numbered in the order of their first particles."""

    bin_of: Int64s
    """(n,): bin of each particle."""
    keys: Int64s
    """(k,): column, row and heading of each bin as one number."""
    table: Int64s
    """(power of 2 ≥ 2k,): hash table of bins by key, or -1."""


class Cluster(NamedTuple):
    """Connected bins with the highest total weight of particles."""

    pose: Pose
    """Mean pose, with the circular mean of headings."""
    covariance: Covariance
    weight: float
    """Sum of the particles' weights, 0 to 1."""


def heaviest_cluster(found: Histogram, poses: Floats, directions: Floats, weights: Floats) -> Cluster:
    """Return the cluster with the highest weight; of equal ones, the one with the first particle.

    As pf_cluster_stats in pf.c. `directions`: (2, capacity), cosine and sine of the headings; `weights`:
    (capacity,), with sum 1 over the particles.
    """
    x, y, heading, weight, xx, xy, xh, yy, yh, hh = _heaviest(*found, poses, directions, weights)
    return Cluster(Pose(x, y, heading), (xx, xy, xh, xy, yy, yh, xh, yh, hh), weight)


@kernel
def key(x: float, y: float, heading: float) -> int:
    """Return the key of a pose's bin; the heading is in [−π, π]."""
    turn = math.floor((heading + math.pi) * (HEADINGS / (2 * math.pi))) % HEADINGS
    return _join(math.floor(x / SIDE), math.floor(y / SIDE), turn)


@kernel
def _join(column: int, row: int, turn: int) -> int:
    half = _COORDINATE // 2
    return ((column + half) % _COORDINATE * _COORDINATE + (row + half) % _COORDINATE) * HEADINGS + turn


@kernel
def slot(table: Int64s, keys: Int64s, wanted: int) -> int:
    """Return the slot of a bin in the hash table, or the empty slot for it."""
    place = ((wanted * 0x9E3779B97F4A7C1) >> 20) & (table.size - 1)
    while table[place] != _EMPTY and keys[table[place]] != wanted:
        place = (place + 1) & (table.size - 1)
    return place


@kernel
def histogram(poses: Floats, count: int) -> Histogram:
    """Return the histogram of the first `count` of `poses`, (3, capacity), headings in [−π, π]."""
    size = 2
    while size < 2 * count:
        size *= 2
    table = np.full(size, _EMPTY)
    keys = np.empty(count, np.int64)
    bin_of = np.empty(count, np.int64)
    bins = 0
    for i in range(count):
        own = key(poses[0, i], poses[1, i], poses[2, i])
        place = slot(table, keys, own)
        if table[place] == _EMPTY:
            keys[bins] = own
            table[place] = bins
            bins += 1
        bin_of[i] = table[place]
    return Histogram(bin_of, keys[:bins], table)


@kernel
def _connect(keys: Int64s, table: Int64s) -> Int64s:
    """Return the cluster of each bin, numbered by its first bin."""
    cluster = np.full(keys.size, _EMPTY)
    waiting = np.empty(keys.size, np.int64)
    for first in range(keys.size):
        if cluster[first] != _EMPTY:
            continue
        cluster[first] = first
        waiting[0] = first
        left = 1
        while left > 0:
            left -= 1
            turn = keys[waiting[left]] % HEADINGS
            row = keys[waiting[left]] // HEADINGS % _COORDINATE - _COORDINATE // 2
            column = keys[waiting[left]] // HEADINGS // _COORDINATE - _COORDINATE // 2
            for side in range(27):
                near = _join(
                    column + side // 9 - 1, row + side // 3 % 3 - 1, (turn + side % 3 - 1) % HEADINGS
                )
                found = table[slot(table, keys, near)]
                if found != _EMPTY and cluster[found] == _EMPTY:
                    cluster[found] = first
                    waiting[left] = found
                    left += 1
    return cluster


@kernel
def _heaviest(
    bin_of: Int64s, keys: Int64s, table: Int64s, poses: Floats, directions: Floats, weights: Floats
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Return mean x, y, heading; weight; xx, xy, xh, yy, yh, hh of the covariance."""
    cluster = _connect(keys, table)
    masses = np.zeros(keys.size)
    for i in range(bin_of.size):
        masses[cluster[bin_of[i]]] += weights[i]
    heaviest = masses.argmax()
    weight = masses[heaviest]
    x = y = c = s = 0.0
    for i in range(bin_of.size):
        if cluster[bin_of[i]] == heaviest:
            x += weights[i] * poses[0, i]
            y += weights[i] * poses[1, i]
            c += weights[i] * directions[0, i]
            s += weights[i] * directions[1, i]
    x, y, heading = x / weight, y / weight, atan2(s, c)
    xx = xy = xh = yy = yh = hh = 0.0
    for i in range(bin_of.size):
        if cluster[bin_of[i]] == heaviest:
            dx, dy, dh = poses[0, i] - x, poses[1, i] - y, poses[2, i] - heading
            dh -= 2 * math.pi * np.rint(dh / (2 * math.pi))
            share = weights[i] / weight
            xx += share * dx * dx
            xy += share * dx * dy
            xh += share * dx * dh
            yy += share * dy * dy
            yh += share * dy * dh
            hh += share * dh * dh
    return x, y, heading, weight, xx, xy, xh, yy, yh, hh


@kernel
def kld_bound(bins: int, error: float, quantile: float) -> float:
    """Return the number of particles for a Kullback-Leibler distance below `error` (Fox 2003, equation 15).

    `bins`: number of occupied bins. `quantile`: upper standard normal quantile of the required probability,
    converted to χ² by the Wilson-Hilferty approximation.
    """
    if bins <= 1:
        return 0.0
    spread = 2 / (9 * (bins - 1))
    root = 1 - spread + math.sqrt(spread) * quantile
    return (bins - 1) / (2 * error) * (root * root * root)


@kernel
def _guide(weights: Floats, sums: Floats) -> Int64s:
    """Return the guide table for drawing particles; fills `sums` with cumulative weights.

    Entry j is the first particle whose cumulative weight exceeds j/n of the total (Chen and Asau 1974, "On
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


@kernel
def resample(
    poses: Floats,
    weights: Floats,
    count: int,
    found: Histogram,
    uniforms: Floats,
    injection: float,
    least: int,
    error: float,
    quantile: float,
    drawn: Floats,
) -> tuple[int, int]:
    """Fill `drawn`, (3, capacity), with particles; return their number and the number of injected poses.

    The first `count` of `poses`, (3, ·), are particles with `weights`, followed by random poses. Each draw
    takes the next random pose with probability `injection`, otherwise a particle by weight. `found`:
    histogram of all poses. `uniforms`: (most,) in [0, 1), one per draw. Drawing ends when `least` and
    `kld_bound` of the occupied bins are reached.
    """
    sums = np.empty(count)
    guide = _guide(weights, sums)
    bin_of = found.bin_of
    hit = np.zeros(found.keys.size, np.bool_)
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


def fingerprint() -> bytes:
    """Return the results of all kernels for fixed inputs; another processor may give others."""
    index = np.arange(80.0)
    poses = np.stack((0.1 * (index % 9), np.sqrt(index), 3.14 * arrays.sin(index)))
    directions = np.stack((arrays.cos(poses[2]), arrays.sin(poses[2])))
    found = histogram(poses, 79)
    pose, covariance, weight = heaviest_cluster(found, poses, directions, np.full(80, 1 / 79))
    weights, drawn = np.asarray((1 + index % 5) / 240), np.zeros((3, 80))
    resample(poses, weights, 40, found, np.modf(index * 0.618)[0], 0.3, 20, 0.5, 1.0, drawn)
    return found.bin_of.tobytes() + np.array((*pose, *covariance, weight)).tobytes() + drawn.tobytes()
