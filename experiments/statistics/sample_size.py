"""How many pairs of runs an effect needs to be seen."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, rankdata

from experiments.statistics.paired_tests import ALPHA, tail

Floats = NDArray[np.float64]
_DRAWS: Final = 4000
_MOST: Final = 1000


@dataclass(frozen=True)
class Effect:
    """What is to be seen, in a model of two normal distributions of which one is shifted."""

    a12: float = 0.71
    """Default: a large effect by Vargha and Delaney's thresholds, 2000."""
    correlation: float = 0.0
    """Of the two runs of a pair, which have the seed in common."""
    power: float = 0.9
    """Probability that it is seen, if it is there."""
    tests: int = 1
    """So many share the 5 % (Holm's first threshold)."""

    @property
    def shift(self) -> float:
        """In standard deviations of one distribution: P(X > Y) = Φ(shift / √2)."""
        return math.sqrt(2.0) * float(norm.ppf(self.a12))


def pairs_needed(effect: Effect, seed: int = 1, most: int = _MOST) -> int:
    """The least number of pairs at which the signed-rank test has the power, by simulation.

    ValueError for an effect that is none, or that needs more than `most` pairs or so.
    """
    if not 0.0 < effect.a12 < 1.0 or effect.a12 == 0.5 or not -1.0 < effect.correlation < 1.0:
        raise ValueError(
            f"{effect}: a12 should lie between 0 and 1 and not be 0.5, the correlation within ±1"
        )
    low, high = 4, 8
    while power(effect, high, seed) < effect.power:
        low, high = high, 2 * high
        if high > most:
            raise ValueError(f"{effect}: needs more than {most} pairs")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if power(effect, middle, seed) >= effect.power else (middle, high)
    return high


def power(effect: Effect, pairs: int, seed: int = 1) -> float:
    """How often the signed-rank test of so many pairs sees the effect, of 4000 drawn experiments."""
    critical = _critical(pairs, ALPHA / effect.tests)
    spread = math.sqrt(2.0 * (1.0 - effect.correlation))
    drawn = np.random.default_rng(seed).normal(abs(effect.shift), spread, (_DRAWS, pairs))
    statistic: Floats = (np.sign(drawn) * rankdata(np.abs(drawn), axis=1)).sum(axis=1)
    return float(np.mean(statistic >= critical))


def _critical(pairs: int, alpha: float) -> float:
    """The least signed sum of ranks without ties whose two-sided p-value is at most alpha."""
    ranks = np.arange(1, pairs + 1)
    total = int(ranks.sum())
    low, high = 0, total // 2 + 1  # the statistic is the total less twice a whole number
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if 2 * tail(ranks, total - 2 * middle) <= alpha else (low, middle)
    return total - 2 * (low - 1) if low else math.inf
