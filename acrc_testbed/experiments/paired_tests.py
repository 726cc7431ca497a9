"""Exact paired tests, effect sizes with intervals, sample sizes, and group-sequential tests."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import beta, norm, rankdata, sem, t

from actors.array_types import Floats, Int64s

CONFIDENCE: Final = 0.95
_HALVINGS: Final = 40
"""Bisections for a bound of A12: accurate to 1e-12."""


class Interval(NamedTuple):
    """An estimate and its 95 % interval."""

    value: float
    low: float
    high: float


def mean_interval(values: ArrayLike) -> Interval:
    """Return the mean with Student's t interval; for a single value the bounds are NaN."""
    known = np.asarray(values, np.float64)
    middle = float(known.mean())
    if known.size < 2:
        return Interval(middle, math.nan, math.nan)
    half = float(t.ppf((1 + CONFIDENCE) / 2, known.size - 1) * sem(known))
    return Interval(middle, middle - half, middle + half)


def a12(one: ArrayLike, other: ArrayLike) -> Floats:
    """Return the probability that a value of `one` exceeds one of `other`, ties counted half.

    Vargha and Delaney, "A critique and improvement of the CL common language effect size statistics of
    McGraw and Wong", Journal of Educational and Behavioral Statistics 25(2), 2000. Samples (…, n) and (…, m)
    with n, m ≥ 1 give (…).
    """
    first, second = np.asarray(one, np.float64), np.asarray(other, np.float64)
    n, m = first.shape[-1], second.shape[-1]
    ranks = rankdata(np.concatenate([first, second], axis=-1), axis=-1)
    share: Floats = (ranks[..., :n].mean(axis=-1) - (n + 1) / 2) / m
    return share


def a12_bounds(share: ArrayLike, n: int) -> tuple[Floats, Floats]:
    """Return the 95 % interval of observed A12 (…) of two samples of n each, also for 0 and 1.

    Newcombe, "Confidence intervals for an effect size measure based on the Mann-Whitney statistic. Part 2:
    asymptotic methods and evaluation", Statistics in Medicine 25, 2006, method 5: score interval with Hanley
    and McNeil's standard error. For independent samples; conservative for positively correlated pairs.
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
    """Return A12 of two samples (n,) with its interval."""
    share = a12(one, other)
    low, high = a12_bounds(share, np.size(one))
    return Interval(float(share), float(low), float(high))


def share_upper_bound(found: int, of: int) -> float:
    """Return the upper 95 % bound of a share that was observed `found` times in `of` trials.

    Clopper and Pearson, "The use of confidence or fiducial limits illustrated in the case of the binomial",
    Biometrika 26, 1934; one-sided.
    """
    return 1.0 if found == of else float(beta.ppf(CONFIDENCE, found + 1, of - found))


ALPHA: Final = 0.05
_STEPS_PER_PAIR: Final = 50
"""Resolution of differences: mean number of integer steps per pair."""


class PairedTest(NamedTuple):
    """Result of a sign-flip test of paired differences."""

    differing: int
    """Pairs that differ."""
    direction: int
    """Sign of the test statistic: 1, -1 or 0."""
    p: float
    """Two-sided."""


NO_TEST: Final = PairedTest(0, 0, 1.0)


def signed_rank(differences: ArrayLike) -> PairedTest:
    """Return the result of Wilcoxon's signed-rank test.

    Zero differences are ranked, then dropped (Pratt, "Remarks on zeros and ties in the Wilcoxon signed rank
    procedures", JASA 54, 1959).
    """
    found = np.asarray(differences, np.float64)
    return _two_sided(found, np.rint(2 * rankdata(np.abs(found))).astype(np.int64))


def mean_test(differences: ArrayLike) -> PairedTest:
    """Return the result of Fisher's randomisation test of the mean.

    "The Design of Experiments", 1935, section 21.
    """
    found = np.asarray(differences, np.float64)
    return _two_sided(found, _whole_steps(found))


def equivalence_p(differences: ArrayLike, margin: float) -> float:
    """Return the p-value of equivalence within ±margin: the larger of two one-sided tests of the mean (TOST).

    Schuirmann, "A comparison of the two one-sided tests procedure and the power approach for assessing the
    equivalence of average bioavailability", Journal of Pharmacokinetics and Biopharmaceutics 15, 1987.
    """
    found = np.asarray(differences, np.float64)
    return max(_one_sided(found + margin), _one_sided(margin - found))


def _whole_steps(differences: Floats) -> Int64s:
    """Return absolute differences as integers; only zero differences become 0."""
    sizes = np.abs(differences)
    if not sizes.any():
        return np.zeros(sizes.shape, np.int64)
    steps = np.rint(sizes * (_STEPS_PER_PAIR * sizes.size / sizes.sum()))
    return np.where(sizes > 0, np.maximum(steps, 1), 0).astype(np.int64)


def _two_sided(differences: Floats, scores: Int64s) -> PairedTest:
    scores = np.where(differences == 0, 0, scores)
    statistic = int((np.sign(differences).astype(np.int64) * scores).sum())
    p = min(1.0, 2 * tail_probability(scores, abs(statistic)))
    return PairedTest(int(np.count_nonzero(scores)), int(np.sign(statistic)), p)


def _one_sided(differences: Floats) -> float:
    scores = _whole_steps(differences)
    return tail_probability(scores, int((np.sign(differences).astype(np.int64) * scores).sum()))


def tail_probability(scores: Int64s, statistic: int) -> float:
    """Return the exact probability that scores (n,) with random signs sum to at least the statistic."""
    total = int(scores.sum())
    chances = np.zeros(total + 1)  # distribution of the sum of positive scores
    chances[0], reached = 1.0, 0
    for score in scores[scores > 0].tolist():
        chances[: reached + 1] *= 0.5
        chances[score : reached + score + 1] += chances[: reached + 1].copy()
        reached += score
    return float(min(1.0, chances[(total + statistic) // 2 :].sum()))


def fewest_differing(tests: int, alpha: float = ALPHA) -> int:
    """Return the number of differing pairs at which one of several tests can reach `alpha` (Bonferroni).

    With n differing pairs, the least p is 2/2^n.
    """
    return math.ceil(math.log2(2 * tests / alpha))


MIN_PAIRS: Final = fewest_differing(1)
"""With fewer pairs no exact two-sided test reaches ALPHA. Further tests do not raise the number, as tests
without differing pairs are excluded (see `decidable`)."""


def decidable(differing: Sequence[int]) -> list[bool]:
    """Return which tests could reach ALPHA, from their numbers of differing pairs; only these count.

    Tarone, "A modified Bonferroni method for discrete data", Biometrics 46, 1990. The number of differing
    pairs is independent of their signs, so the exclusion keeps the error rate.
    """
    able = [False] * len(differing)
    for tests in range(1, len(differing) + 1):
        able = [one >= fewest_differing(tests) for one in differing]
        if sum(able) <= tests:
            break
    return able


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values adjusted for multiplicity by Holm's method.

    Holm, "A simple sequentially rejective multiple test procedure", Scandinavian Journal of Statistics 6,
    1979.
    """
    adjusted = [1.0] * len(p_values)
    largest = 0.0
    for rank, index in enumerate(sorted(range(len(p_values)), key=lambda index: p_values[index])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[index]))
        adjusted[index] = largest
    return adjusted


_DRAWS: Final = 4000
_MAX_PAIRS: Final = 1000
_MAX_EXACT: Final = 100


@dataclass(frozen=True)
class AssumedEffect:
    """Effect to detect, for two normal distributions with a shift."""

    a12: float = 0.71
    """Default: a large effect by Vargha and Delaney's thresholds, 2000."""
    correlation: float = 0.0
    """Correlation of the two runs of a pair, which share the seed."""
    power: float = 0.9
    """Probability of detecting the effect."""
    tests: int = 1
    """Tests that share the error rate of 5 % (Holm's first threshold)."""

    @property
    def shift(self) -> float:
        """Shift in standard deviations: P(X > Y) = Φ(shift / √2)."""
        return math.sqrt(2.0) * float(norm.ppf(self.a12))


def pairs_needed(effect: AssumedEffect) -> int:
    """Return the least number of pairs at which the signed-rank test has the power, by simulation.

    Raises ValueError for an invalid effect, or one that needs more than 1000 pairs.
    """
    if not 0.0 < effect.a12 < 1.0 or effect.a12 == 0.5 or not -1.0 < effect.correlation < 1.0:
        raise ValueError("a12 must be between 0 and 1 and not 0.5, correlation between -1 and 1")
    low, high = 4, 8
    while power(effect, high) < effect.power:
        if high == _MAX_PAIRS:
            raise ValueError(f"so small an effect needs more than {_MAX_PAIRS} pairs of runs")
        low, high = high, min(2 * high, _MAX_PAIRS)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(effect, middle) >= effect.power else (middle, high)
    return high


def power(effect: AssumedEffect, pairs: int) -> float:
    """Return the power of the signed-rank test, from 4000 simulated experiments."""
    critical = _critical(pairs, ALPHA / effect.tests)
    spread = math.sqrt(2.0 * (1.0 - effect.correlation))
    drawn = np.random.default_rng(1).normal(abs(effect.shift), spread, (_DRAWS, pairs))
    statistic: Floats = (np.sign(drawn) * rankdata(np.abs(drawn), axis=1)).sum(axis=1)
    return float(np.mean(statistic >= critical))


def _critical(pairs: int, alpha: float) -> float:
    """Return the least signed rank sum, without ties, whose two-sided p-value is at most alpha.

    Above 100 pairs by the normal approximation; the exact distribution takes seconds there.
    """
    if pairs > _MAX_EXACT:
        return float(norm.isf(alpha / 2)) * math.sqrt(pairs * (pairs + 1) * (2 * pairs + 1) / 6)
    ranks = np.arange(1, pairs + 1)
    total = int(ranks.sum())
    statistics = range(total, -1, -2)
    found = bisect_right(statistics, alpha, key=lambda statistic: 2 * tail_probability(ranks, statistic))
    return statistics[found - 1] if found else math.inf


_GRID: Final = np.linspace(-8.0, 8.0, 3201)
"""Values of the monitored Brownian motion, whose variance at the end is 1."""


@dataclass(frozen=True)
class SequentialPlan:
    """Interim looks and their p-value thresholds, from `sequential_plan`."""

    looks: tuple[int, ...]
    """Numbers of pairs at the looks, ascending; the last is the maximum."""
    thresholds: tuple[float, ...]
    """Two-sided threshold of p at each look."""


def sequential_plan(looks: Sequence[int], alpha: float = 0.05) -> SequentialPlan:
    """Return a group-sequential plan with total error rate `alpha`.

    Error spending of Lan and DeMets ("Discrete sequential boundaries for clinical trials", Biometrika 70,
    1983), close to O'Brien and Fleming's bounds. Probabilities of a Brownian motion by the recursion of
    Armitage, McPherson and Rowe ("Repeated significance tests on accumulating data", JRSS A 132, 1969).
    Raises ValueError for looks that are not ascending.
    """
    if not looks or looks[0] < 1 or any(a >= b for a, b in pairwise(looks)):
        raise ValueError(f"looks {tuple(looks)} must be ascending numbers of pairs")
    thresholds, spent, before = [], 0.0, 0.0
    density = None
    step = float(_GRID[1] - _GRID[0])
    for look in looks:
        part = look / looks[-1]
        due = 4.0 * float(norm.sf(norm.isf(alpha / 4.0) / math.sqrt(part)))  # both tails
        here: Floats = norm.pdf(_GRID, scale=math.sqrt(part - before))
        if density is not None:
            here = np.asarray(np.convolve(density, here, mode="same") * step, np.float64)
        bound = _two_sided_bound(here, max(due - spent, 0.0), step)
        thresholds.append(2.0 * float(norm.sf(bound / math.sqrt(part))))
        here[np.abs(_GRID) >= bound] = 0.0  # stopped at this look
        density = here
        spent, before = due, part
    return SequentialPlan(tuple(looks), tuple(thresholds))


def _two_sided_bound(density: Floats, probability: float, step: float) -> float:
    """Return the bound beyond which both tails of the density have this probability."""
    if probability <= 0.0:
        return float(_GRID[-1])
    outside = 2.0 * np.cumsum(density[::-1])[: _GRID.size // 2] * step  # both tails, from the outside
    index = int(np.searchsorted(outside, probability))
    if index == 0:
        return float(_GRID[-1])
    share = (probability - outside[index - 1]) / (outside[index] - outside[index - 1])
    return float(_GRID[::-1][index - 1] - (share + 0.5) * step)
