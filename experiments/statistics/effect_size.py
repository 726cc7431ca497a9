"""How much larger one sample is than another, in a measure that needs no scale: A12."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata

Floats = NDArray[np.float64]
CONFIDENCE: Final = 0.95
_RESAMPLES: Final = 4000


class Interval(NamedTuple):
    """An estimate and its bootstrap interval."""

    value: float
    low: float
    high: float


def a12(one: ArrayLike, other: ArrayLike) -> Floats:
    """The probability that a value of `one` is greater than one of `other`, ties counted half.

    Vargha and Delaney, "A critique and improvement of the CL common language effect size statistics of
    McGraw and Wong", Journal of Educational and Behavioral Statistics 25(2), 2000. Samples are along the last
    axis, (…, n) and (…, m) with n, m ≥ 1, and give (…).
    """
    first, second = np.asarray(one, np.float64), np.asarray(other, np.float64)
    n, m = first.shape[-1], second.shape[-1]
    ranks = rankdata(np.concatenate([first, second], axis=-1), axis=-1)
    share: Floats = (ranks[..., :n].mean(axis=-1) - (n + 1) / 2) / m
    return share


def interval(
    one: ArrayLike,
    other: ArrayLike,
    statistic: Callable[[Floats, Floats], Floats],
    *,
    paired: bool,
    seed: int = 0,
    resamples: int = _RESAMPLES,
    confidence: float = CONFIDENCE,
) -> Interval:
    """A statistic of two samples, (n,) and (m,), with its percentile bootstrap interval.

    Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter 13. `paired`: the samples are of
    equal length and drawn pair by pair. `statistic` takes samples along the last axis. The same seed gives
    the same interval.
    """
    first, second = np.asarray(one, np.float64), np.asarray(other, np.float64)
    rng = np.random.default_rng(seed)
    mine = rng.integers(first.size, size=(resamples, first.size))
    theirs = mine if paired else rng.integers(second.size, size=(resamples, second.size))
    drawn = statistic(first[mine], second[theirs])
    low, high = np.quantile(drawn, [(1 - confidence) / 2, (1 + confidence) / 2])
    return Interval(float(statistic(first, second)), float(low), float(high))


def difference_of(summary: Callable[[Floats], Floats]) -> Callable[[Floats, Floats], Floats]:
    """The statistic summary(one) - summary(other), such as of means, medians or quantiles, by last axes."""
    return lambda one, other: summary(one) - summary(other)
