"""95 % intervals of what is measured over many independent runs."""

import math
from collections.abc import Sequence
from statistics import NormalDist, mean, stdev
from typing import Final, NamedTuple

from observation.field_trial.clocks.student_t import quantile

_PROBABILITY: Final = 0.975


class Interval(NamedTuple):
    """An estimate and how far it may be off."""

    value: float
    low: float
    high: float


def proportion(successes: int, trials: int) -> Interval:
    """The share of successes in `trials` > 0 independent trials.

    Wilson's score interval (Wilson, "Probable inference, the law of succession, and statistical inference",
    JASA 22, 1927), which holds for few trials and for shares of 0 and 1, too.
    """
    z = NormalDist().inv_cdf(_PROBABILITY)
    share = successes / trials
    scale = 1 + z * z / trials
    centre = (share + z * z / (2 * trials)) / scale
    half = z / scale * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    return Interval(share, max(centre - half, 0.0), min(centre + half, 1.0))


def average(values: Sequence[float]) -> Interval:
    """The mean of independent values, at least one; Student's t interval, infinite for one value."""
    middle = mean(values)
    if len(values) < 2:
        return Interval(middle, -math.inf, math.inf)
    half = quantile(_PROBABILITY, len(values) - 1) * stdev(values) / math.sqrt(len(values))
    return Interval(middle, middle - half, middle + half)
