"""Tests of pairs, exact for any ties and any number of pairs, and what several of them together may claim."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import rankdata

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
ALPHA: Final = 0.05
_STEPS_A_PAIR: Final = 50
"""A difference counts in whole steps: so many, on average over the pairs."""


class PairedTest(NamedTuple):
    """What a test of pairs says: of differences, of which each sign would be as likely without an effect."""

    differing: int
    """Pairs that differ."""
    direction: int
    """1: the test's statistic speaks for positive differences; -1: for negative ones; 0: for neither."""
    p: float
    """Two-sided."""


def signed_rank(differences: ArrayLike) -> PairedTest:
    """Wilcoxon's signed-rank test.

    Pairs without difference keep their ranks and count for neither side (Pratt, "Remarks on zeros and ties
    in the Wilcoxon signed rank procedures", JASA 54, 1959).
    """
    found = np.asarray(differences, np.float64)
    return _two_sided(found, np.rint(2 * rankdata(np.abs(found))).astype(np.int64))


def mean_test(differences: ArrayLike) -> PairedTest:
    """Fisher's randomisation test of the mean ("The Design of Experiments", 1935, section 21)."""
    found = np.asarray(differences, np.float64)
    return _two_sided(found, _whole_steps(found))


def equivalence_p(differences: ArrayLike, margin: float) -> float:
    """The p-value for the mean difference being within ±margin: the greater of two one-sided tests of means.

    Schuirmann, "A comparison of the two one-sided tests procedure and the power approach for assessing the
    equivalence of average bioavailability", Journal of Pharmacokinetics and Biopharmaceutics 15, 1987.
    """
    found = np.asarray(differences, np.float64)
    return max(_one_sided(found + margin), _one_sided(margin - found))


def _whole_steps(differences: Floats) -> Integers:
    """The sizes of the differences as whole numbers, none of which becomes 0 that is not."""
    sizes = np.abs(differences)
    if not sizes.any():
        return np.zeros(sizes.shape, np.int64)
    steps = np.rint(sizes * (_STEPS_A_PAIR * sizes.size / sizes.sum()))
    return np.where(sizes > 0, np.maximum(steps, 1), 0).astype(np.int64)


def _two_sided(differences: Floats, scores: Integers) -> PairedTest:
    scores = np.where(differences == 0, 0, scores)
    statistic = int((np.sign(differences).astype(np.int64) * scores).sum())
    p = min(1.0, 2 * tail(scores, abs(statistic)))
    return PairedTest(int(np.count_nonzero(scores)), int(np.sign(statistic)), p)


def _one_sided(differences: Floats) -> float:
    scores = _whole_steps(differences)
    return tail(scores, int((np.sign(differences).astype(np.int64) * scores).sum()))


def tail(scores: Integers, statistic: int) -> float:
    """How likely the sum of scores (n,), with signs by fair coins, is at least the statistic, exactly."""
    total = int(scores.sum())
    chances = np.zeros(total + 1)  # of the sum of the positive scores
    chances[0], reached = 1.0, 0
    for score in scores[scores > 0].tolist():
        chances[: reached + 1] *= 0.5
        chances[score : reached + score + 1] += chances[: reached + 1].copy()
        reached += score
    return float(min(1.0, chances[(total + statistic) // 2 :].sum()))


def fewest_differing(tests: int, alpha: float = ALPHA) -> int:
    """Pairs that must differ before one of so many tests can reach `alpha`, all others considered.

    With n differing pairs that all speak for one side, p is 2/2^n.
    """
    return math.ceil(math.log2(2 * tests / alpha))


LEAST_PAIRS: Final = fewest_differing(1)
"""With fewer pairs no exact two-sided test reaches ALPHA, whatever the runs show. Further tests of the family
do not raise it: those whose pairs do not differ take no part (see `decidable`)."""


def decidable(differing: Sequence[int], alpha: float = ALPHA) -> list[bool]:
    """Which of several tests, by their numbers of differing pairs, could reach `alpha`; only these count.

    Tarone, "A modified Bonferroni method for discrete data", Biometrics 46, 1990. How many pairs differ says
    nothing of the side that they speak for, so leaving a test out for it costs no error.
    """
    able = [False] * len(differing)
    for tests in range(1, len(differing) + 1):
        able = [one >= fewest_differing(tests, alpha) for one in differing]
        if sum(able) <= tests:
            break
    return able


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
