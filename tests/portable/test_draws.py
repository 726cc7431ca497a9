"""Normal, exponential and even draws: distributed as they should be, and each from one uniform draw."""

import math

import numpy as np
from scipy import stats

from actors.portable.draws import exponentials, normals, normals_of_each, uniforms
from actors.portable.quantiles import normal_quantile
from actors.randomness import generator


def test_normal_draws_are_normal() -> None:
    draws = normals(generator(1, "test", "r1"), 100_000)
    assert stats.kstest(draws, "norm").pvalue > 0.01
    assert stats.kstest(draws[np.abs(draws) > 2.5], stats.norm.cdf).pvalue < 1e-6  # the test can fail
    for beyond in (2.0, 3.0, 3.7):  # also where numpy's own would ask the C library
        share, exact = np.mean(np.abs(draws) > beyond), 2 * stats.norm.sf(beyond)
        assert abs(share - exact) < 4 * math.sqrt(exact / draws.size)


def test_normal_draws_come_from_the_uniform_ones_in_their_order() -> None:
    uniform = generator(1, "test", "r1").random((3, 4))
    draws = normals(generator(1, "test", "r1"), (3, 4))
    assert draws.tolist() == [[normal_quantile(u) for u in row] for row in uniform.tolist()]


def test_normal_draws_of_several_generators_are_those_of_each() -> None:
    names, counts = ("r1", "r2", "r3"), (5, 0, 3)
    draws = normals_of_each([generator(1, "test", name) for name in names], counts)
    alone = [normals(generator(1, "test", name), count) for name, count in zip(names, counts, strict=True)]
    assert draws.tolist() == np.concatenate(alone).tolist()


def test_exponential_draws_are_exponential() -> None:
    draws = exponentials(generator(1, "test", "r1"), 3.0, 100_000)
    assert stats.kstest(draws, "expon", args=(0, 3.0)).pvalue > 0.01
    assert draws.min() >= 0 and math.isfinite(draws.max())


def test_even_draws_are_even() -> None:
    draws = uniforms(generator(1, "test", "r1"), -2.0, 5.0, 100_000)
    assert stats.kstest(draws, "uniform", args=(-2.0, 7.0)).pvalue > 0.01
