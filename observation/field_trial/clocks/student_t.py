"""Quantiles of Student's t distribution."""

import math
from statistics import NormalDist


def quantile(probability: float, freedom: float) -> float:
    """What a t variable of `freedom` degrees exceeds with 1 - `probability`, which is above 0.5.

    Exact for 1, 2 and infinitely many degrees; in between the expansion of Abramowitz and Stegun, Handbook of
    Mathematical Functions, 26.7.5, within 4 % up to the quantile of 0.999.
    """
    if freedom == 1:
        return math.tan(math.pi * (probability - 0.5))
    if freedom == 2:
        return (2 * probability - 1) / math.sqrt(2 * probability * (1 - probability))
    x = NormalDist().inv_cdf(probability)
    terms = (
        x,
        (x**3 + x) / 4,
        (5 * x**5 + 16 * x**3 + 3 * x) / 96,
        (3 * x**7 + 19 * x**5 + 17 * x**3 - 15 * x) / 384,
        (79 * x**9 + 776 * x**7 + 1482 * x**5 - 1920 * x**3 - 945 * x) / 92160,
    )
    return sum(term / freedom**power for power, term in enumerate(terms))
