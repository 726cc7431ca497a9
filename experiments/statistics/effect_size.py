"""How much one sample is above another: the mean of paired differences, and A12, each with an interval."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import beta, norm, rankdata, sem, t

Floats = NDArray[np.float64]
CONFIDENCE: Final = 0.95
_HALVINGS: Final = 40
"""Of the range in which a bound of A12 lies: to 1e-12."""


class Interval(NamedTuple):
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float


def mean_interval(values: ArrayLike) -> Interval:
    """The mean of at least one value, with Student's t interval; of one value the bounds are NaN."""
    known = np.asarray(values, np.float64)
    middle = float(known.mean())
    if known.size < 2:
        return Interval(middle, math.nan, math.nan)
    half = float(t.ppf((1 + CONFIDENCE) / 2, known.size - 1) * sem(known))
    return Interval(middle, middle - half, middle + half)


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


def a12_bounds(share: ArrayLike, n: int) -> tuple[Floats, Floats]:
    """The 95 % interval of shares (…) that A12 came to in two samples of n each, also of 0 and 1.

    Newcombe, "Confidence intervals for an effect size measure based on the Mann-Whitney statistic. Part 2:
    asymptotic methods and evaluation", Statistics in Medicine 25, 2006, method 5: all values whose own
    standard error, by Hanley and McNeil's formula, puts the share within its range. For independent samples;
    of pairs that correlate it holds more than 95 %.
    """
    found = np.asarray(share, np.float64)
    z = float(norm.ppf((1 + CONFIDENCE) / 2))

    def outermost(end: float) -> Floats:
        inside, outside = found.copy(), np.full_like(found, end)
        for _ in range(_HALVINGS):
            middle = (inside + outside) / 2
            spread = 1 + (n - 1) * ((1 - middle) / (2 - middle) + middle / (1 + middle))
            holds = np.abs(found - middle) <= z * np.sqrt(middle * (1 - middle) * spread) / n
            inside, outside = np.where(holds, middle, inside), np.where(holds, outside, middle)
        return np.asarray((inside + outside) / 2, np.float64)

    return outermost(0.0), outermost(1.0)


def a12_interval(one: ArrayLike, other: ArrayLike) -> Interval:
    """A12 of two samples (n,), with its interval."""
    share = a12(one, other)
    low, high = a12_bounds(share, np.size(one))
    return Interval(float(share), float(low), float(high))


def most(found: int, of: int) -> float:
    """The upper 95 % bound of a share that was found so many times of at least one.

    Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of the binomial",
    Biometrika 26, 1934; one-sided.
    """
    return 1.0 if found == of else float(beta.ppf(CONFIDENCE, found + 1, of - found))
