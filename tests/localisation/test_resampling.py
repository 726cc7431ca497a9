"""Drawing particles: how many, which, and how many new ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from actors.robot.localisation import resampling
from actors.robot.localisation.histogram import histogram
from actors.robot.localisation.resampling import kld_bound, resample

RNG = np.random.default_rng


def draw(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    injection: float = 0.0,
    least: int = 1,
    error: float = 0.05,
) -> tuple[NDArray[np.float64], int]:
    """What is drawn, and how many of it are new."""
    found = histogram(poses, poses.shape[1])
    drawn = np.full((3, len(uniforms)), np.nan)
    count, new = resample(poses, weights, len(weights), found, uniforms, injection, least, error, 0.99, drawn)
    assert np.isnan(drawn[:, count:]).all() and not np.isnan(drawn[:, :count]).any()
    return drawn[:, :count], new


def twin(
    poses: NDArray[np.float64],
    weights: NDArray[np.float64],
    uniforms: NDArray[np.float64],
    injection: float,
    least: int,
    error: float,
) -> list[int]:
    """Which columns of `poses` are drawn: Fox 2003, figure 3, in plain Python."""
    sums = np.cumsum(weights)
    bin_of = histogram(poses, poses.shape[1]).bin_of
    chosen: list[int] = []
    new = 0
    for uniform in uniforms.tolist():
        bins = len({int(bin_of[one]) for one in chosen})
        if len(chosen) >= max(least, kld_bound(bins, error, 0.99)):
            break
        if uniform < injection:
            chosen.append(len(weights) + new)
            new += 1
        else:
            share = (uniform - injection) / (1 - injection)
            chosen.append(min(int(np.searchsorted(sums, share * sums[-1], side="right")), len(sums) - 1))
    return chosen


@pytest.mark.parametrize("bins", [2, 3, 5, 20, 200, 2000])
@pytest.mark.parametrize(("error", "probability"), [(0.05, 0.99), (0.01, 0.95), (0.05, norm.cdf(0.99))])
def test_bound_is_the_quantile_of_chi_square(bins: int, error: float, probability: float) -> None:
    """Fox 2003, equation 14 with scipy's quantile; the formula is within 3 % of it, from 5 bins on 1 %."""
    exact = chi2.ppf(probability, bins - 1) / (2 * error)
    bound = kld_bound(bins, error, float(norm.ppf(probability)))
    assert bound == pytest.approx(exact, rel=0.03 if bins < 5 else 0.01)


def test_one_bin_asks_for_no_more_than_the_least() -> None:
    assert kld_bound(0, 0.05, 0.99) == kld_bound(1, 0.05, 0.99) == 0.0
    drawn, _ = draw(np.zeros((3, 10)), np.full(10, 0.1), RNG(0).random(100), least=30)
    assert drawn.shape == (3, 30)


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 60),
    injection=st.sampled_from([0.0, 0.2, 0.9]),
    least=st.integers(1, 50),
)
def test_kernel_is_its_twin(seed: int, count: int, injection: float, least: int) -> None:
    rng = RNG(seed)
    poses = rng.uniform(-2, 2, (3, count + 150))
    weights = rng.random(count) * (rng.random(count) < 0.8) + 1e-9
    uniforms = rng.random(150)
    drawn, _ = draw(poses, weights, uniforms, injection, least, 0.2)
    assert np.array_equal(drawn, poses[:, twin(poses, weights, uniforms, injection, least, 0.2)])


def test_particles_are_drawn_by_their_weights() -> None:
    """χ² of 40 000 draws of 50 particles: above its 99.9 % quantile in one of 1000 seeds, and this is one."""
    rng = RNG(5)
    weights = rng.random(50) ** 3
    weights /= weights.sum()
    poses = np.stack((np.arange(50.0), np.zeros(50), np.zeros(50)))
    drawn, new = draw(poses, weights, rng.random(40_000), least=40_000)
    counts = np.bincount(drawn[0].astype(int), minlength=50)
    expected = 40_000 * weights
    big = expected > 5
    assert ((counts - expected)[big] ** 2 / expected[big]).sum() < chi2.ppf(0.999, big.sum() - 1)
    assert new == 0


def test_a_particle_without_weight_is_never_drawn() -> None:
    weights = np.array([0.0, 0.5, 0.0, 0.5, 0.0])
    poses = np.stack((np.arange(5.0), np.zeros(5), np.zeros(5)))
    uniforms = np.array([0.0, np.nextafter(0.5, 0), 0.5, np.nextafter(1.0, 0)])
    drawn, _ = draw(poses, weights, uniforms, least=4)
    assert drawn[0].tolist() == [1.0, 1.0, 3.0, 3.0]


def test_new_poses_come_as_often_as_asked_and_each_once() -> None:
    """4000 draws with a probability of 0.3: 0.03 are four standard errors."""
    rng = RNG(2)
    poses = np.stack((np.arange(4010.0), np.zeros(4010), np.zeros(4010)))
    drawn, new = draw(poses, np.full(10, 0.1), rng.random(4000), 0.3, least=4000)
    fresh = drawn[0][drawn[0] >= 10]
    assert fresh.tolist() == np.arange(10.0, 10.0 + new).tolist()
    assert new / 4000 == pytest.approx(0.3, abs=0.03)


def test_a_cloud_over_many_bins_gets_more_particles() -> None:
    rng = RNG(3)
    narrow = draw(rng.uniform(0, 0.4, (3, 500)), np.full(500, 0.002), rng.random(2000), least=100)
    wide = draw(rng.uniform(-3, 3, (3, 500)), np.full(500, 0.002), rng.random(2000), least=100)
    assert narrow[0].shape[1] < 200 and wide[0].shape[1] > 1000


def test_fingerprint_is_the_same_each_time() -> None:
    assert resampling.fingerprint() == resampling.fingerprint()
