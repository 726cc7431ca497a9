"""Tests of "no difference" between two strategies, and what many of them together may claim."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Floats = NDArray[np.float64]


class Significance(NamedTuple):
    """What one test says."""

    name: str
    p: float


def signed_rank(one: Sequence[float] | Floats, other: Sequence[float] | Floats) -> Significance:
    """Wilcoxon's signed-rank test of pairs; two-sided.

    Pairs without difference keep their ranks and count for neither side (Pratt, "Remarks on zeros and ties
    in the Wilcoxon signed rank procedures", JASA 54, 1959). All pairs equal: p = 1.
    """
    difference = np.asarray(one, float) - np.asarray(other, float)
    if not difference.any():
        return Significance("signed-rank", 1.0)
    method = "exact" if difference.size <= 50 and _distinct(difference) else "asymptotic"
    found = stats.wilcoxon(difference, zero_method="pratt", correction=method == "asymptotic", method=method)
    return Significance("signed-rank", float(found.pvalue))


def _distinct(difference: Floats) -> bool:
    """Without ties and zeros, for which the exact distribution holds."""
    return bool(difference.all()) and np.unique(np.abs(difference)).size == difference.size


def rank_sum(one: Sequence[float] | Floats, other: Sequence[float] | Floats) -> Significance:
    """The test of Mann and Whitney for independent samples; two-sided."""
    found = stats.mannwhitneyu(np.asarray(one, float), np.asarray(other, float), alternative="two-sided")
    return Significance("Mann-Whitney", float(found.pvalue))


def holm(p_values: Sequence[float]) -> list[float]:
    """The p-values, adjusted for all of them being looked at: each below α keeps the family's error below α.

    Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6,
    1979.
    """
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for place, index in enumerate(sorted(range(len(p_values)), key=lambda index: p_values[index])):
        largest = max(largest, min(1.0, (len(p_values) - place) * p_values[index]))
        adjusted[index] = largest
    return adjusted
