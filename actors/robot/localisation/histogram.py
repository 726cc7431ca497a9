"""The particles by bins of 0.5 m x 0.5 m x 10°: which are occupied, and which are connected.

As ros-planning/navigation, pf_kdtree.c, has them; there in a tree, here in a table with open addressing. Bins
are connected if they touch, at a corner too; those of the headings −π and π do.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from actors.geometry import Covariance, Pose
from actors.kernels import njit
from actors.portable import arrays
from actors.portable.compiled import atan2

SIDE: Final = 0.5
"""m."""
HEADINGS: Final = 36
"""Bins round the circle."""
_EMPTY: Final = -1
_COORDINATE: Final = 1 << 24
"""A bin's column and row lie within ± half of this: 4000 km."""


class Histogram(NamedTuple):
    """Which bins some particles are in; the bins are numbered in the order of their first particles."""

    bin_of: NDArray[np.int64]
    """(n,): each particle's bin."""
    keys: NDArray[np.int64]
    """(k,): each bin's column, row and heading in one number."""
    table: NDArray[np.int64]
    """(power of 2 ≥ 2k,): bins by the hash of their keys, or -1."""


class Cluster(NamedTuple):
    """The connected bins whose particles have the highest weight, in sum."""

    pose: Pose
    """Mean; the heading's is that on the circle."""
    covariance: Covariance
    weight: float
    """Sum of the particles' weights, in 0 to 1."""


def histogram(poses: NDArray[np.float64], count: int) -> Histogram:
    """Of the first `count` particles of `poses`, (3, capacity), headings in [−π, π]."""
    return Histogram(*_histogram(poses, count))


def heaviest_cluster(
    found: Histogram,
    poses: NDArray[np.float64],
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> Cluster:
    """The one with the highest weight, of equals the one with the first particle.

    As pf_cluster_stats in pf.c. `directions`: (2, capacity), cosine and sine of the headings; `weights`:
    (capacity,), their sum over the particles is 1.
    """
    x, y, heading, weight, xx, xy, xh, yy, yh, hh = _heaviest(*found, poses, directions, weights)
    return Cluster(Pose(x, y, heading), (xx, xy, xh, xy, yy, yh, xh, yh, hh), weight)


def fingerprint() -> bytes:
    """What the kernels give for fixed inputs: differs where a processor or compiler computes differently."""
    index = np.arange(80.0)
    poses = np.stack((0.1 * (index % 9), np.sqrt(index), 3.14 * arrays.sin(index)))
    directions = np.stack((arrays.cos(poses[2]), arrays.sin(poses[2])))
    found = histogram(poses, 79)
    pose, covariance, weight = heaviest_cluster(found, poses, directions, np.full(80, 1 / 79))
    return found.bin_of.tobytes() + np.array((*pose, *covariance, weight)).tobytes()


@njit(cache=True)  # type: ignore[untyped-decorator]
def key(x: float, y: float, heading: float) -> int:
    """The bin of a pose as one number; the heading lies in [−π, π]."""
    turn = math.floor((heading + math.pi) * (HEADINGS / (2 * math.pi))) % HEADINGS
    joined: int = _join(math.floor(x / SIDE), math.floor(y / SIDE), turn)
    return joined


@njit(cache=True)  # type: ignore[untyped-decorator]
def _join(column: int, row: int, turn: int) -> int:
    half = _COORDINATE // 2
    return ((column + half) % _COORDINATE * _COORDINATE + (row + half) % _COORDINATE) * HEADINGS + turn


@njit(cache=True)  # type: ignore[untyped-decorator]
def slot(table: NDArray[np.int64], keys: NDArray[np.int64], wanted: int) -> int:
    """Where a bin stands in the table, or the empty slot where it would."""
    place = ((wanted * 0x9E3779B97F4A7C1) >> 20) & (table.size - 1)
    while table[place] != _EMPTY and keys[table[place]] != wanted:
        place = (place + 1) & (table.size - 1)
    return place


@njit(cache=True)  # type: ignore[untyped-decorator]
def _histogram(
    poses: NDArray[np.float64], count: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
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
    return bin_of, keys[:bins], table


@njit(cache=True)  # type: ignore[untyped-decorator]
def _connect(keys: NDArray[np.int64], table: NDArray[np.int64]) -> NDArray[np.int64]:
    """Each bin's cluster, numbered in the order of their first bins."""
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


@njit(cache=True)  # type: ignore[untyped-decorator]
def _heaviest(
    bin_of: NDArray[np.int64],
    keys: NDArray[np.int64],
    table: NDArray[np.int64],
    poses: NDArray[np.float64],
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Mean x, y, heading; weight; xx, xy, xh, yy, yh, hh of the covariance."""
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
