"""Bins, clusters of connected bins, and the heaviest one's mean and covariance."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from actors.robot.localisation import histogram as module
from actors.robot.localisation.histogram import Cluster, heaviest_cluster, histogram

Bin = tuple[int, int, int]


def bins(poses: NDArray[np.float64]) -> list[Bin]:
    """Each pose's bin of 0.5 m by 0.5 m by 10°."""
    turns = np.floor((poses[2] + math.pi) / math.radians(10)).astype(int) % 36
    x, y = np.floor(poses[:2] / 0.5).astype(int)
    return list(zip(x.tolist(), y.tolist(), turns.tolist(), strict=True))


def touch(a: Bin, b: Bin) -> bool:
    turn = abs(a[2] - b[2])
    return max(abs(a[0] - b[0]), abs(a[1] - b[1]), min(turn, 36 - turn)) <= 1


def clusters(occupied: list[Bin]) -> dict[Bin, Bin]:
    """The first bin of each bin's cluster, by merging sets."""
    sets: list[list[Bin]] = []
    for one in dict.fromkeys(occupied):
        near = [group for group in sets if any(touch(one, other) for other in group)]
        merged = [bin_ for group in near for bin_ in group] + [one]
        at = sets.index(near[0]) if near else len(sets)
        sets = [group for group in sets if group not in near]
        sets.insert(at, merged)
    return {bin_: group[0] for group in sets for bin_ in group}


def heaviest(poses: NDArray[np.float64], weights: NDArray[np.float64]) -> Cluster:
    directions = np.stack((np.cos(poses[2]), np.sin(poses[2])))
    return heaviest_cluster(histogram(poses, poses.shape[1]), poses, directions, weights)


def even(count: int) -> NDArray[np.float64]:
    return np.full(count, 1 / count, np.float64)


cloud = st.tuples(st.integers(0, 10**6), st.integers(1, 60), st.floats(0.2, 4)).map(
    lambda s: np.random.default_rng(s[0]).uniform(-1, 1, (3, s[1])) * [[s[2]], [s[2]], [math.pi]]
)


@settings(deadline=None, max_examples=150)
@given(poses=cloud)
def test_two_particles_share_a_bin_if_they_do_so_by_hand(poses: NDArray[np.float64]) -> None:
    found, by_hand = histogram(poses, poses.shape[1]), bins(poses)
    numbers: dict[Bin, int] = {}
    expected = [numbers.setdefault(one, len(numbers)) for one in by_hand]
    assert found.bin_of.tolist() == expected
    assert len(found.keys) == len(numbers)


@settings(deadline=None, max_examples=150)
@given(poses=cloud, seed=st.integers(0, 10**6))
def test_heaviest_cluster_is_that_of_merged_sets(poses: NDArray[np.float64], seed: int) -> None:
    weights = np.random.default_rng(seed).random(poses.shape[1])
    weights /= weights.sum()
    by_hand = bins(poses)
    first = clusters(by_hand)
    masses: Counter[Bin] = Counter()
    for one, weight in zip(by_hand, weights.tolist(), strict=True):
        masses[first[one]] += weight
    best = max(masses, key=lambda one: masses[one])
    inside = np.array([first[one] == best for one in by_hand])
    share = weights[inside] / weights[inside].sum()
    x, y, h = poses[:, inside]
    heading = math.atan2((share * np.sin(h)).sum(), (share * np.cos(h)).sum())
    mean = np.array([share @ x, share @ y, heading])
    off = poses[:, inside] - mean[:, np.newaxis]
    off[2] = np.arctan2(np.sin(off[2]), np.cos(off[2]))
    found = heaviest(poses, weights)
    assert found.weight == pytest.approx(masses[best])
    assert found.pose == pytest.approx(tuple(mean))
    assert found.covariance == pytest.approx(tuple(((share * off) @ off.T).ravel()), abs=1e-12)


def test_headings_either_side_of_backward_are_one_cluster() -> None:
    headings = np.array([math.pi - 0.05, math.pi, -math.pi, 0.05 - math.pi])
    found = heaviest(np.stack((np.zeros(4), np.zeros(4), headings)), even(4))
    assert found.weight == 1.0
    assert abs(found.pose.heading) == pytest.approx(math.pi)
    assert found.covariance[8] == pytest.approx(0.05**2 / 2)


def test_particles_elsewhere_do_not_shift_the_estimate() -> None:
    poses = np.zeros((3, 10))
    poses[0, :4] = 5.0
    found = heaviest(poses, even(10))
    assert found.weight == pytest.approx(0.6) and found.pose == (0.0, 0.0, 0.0)


def test_of_two_as_heavy_the_first_is_taken() -> None:
    poses = np.array([[5.2, 0.2], [0.2, 5.2], [0.1, 0.1]])
    assert heaviest(poses, even(2)).pose == pytest.approx((5.2, 0.2, 0.1))


def test_fingerprint_is_the_same_each_time() -> None:
    assert module.fingerprint() == module.fingerprint()
