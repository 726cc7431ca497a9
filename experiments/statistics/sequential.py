"""Looking at results while they come in, and stopping early, without claiming more than at the end."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

Floats = NDArray[np.float64]
_GRID: Final = np.linspace(-8.0, 8.0, 3201)
"""Values of the Brownian motion that is watched, whose variance at the end is 1."""


@dataclass(frozen=True)
class SequentialPlan:
    """When pairs are looked at, and what p-value is enough then; made by `plan`."""

    looks: tuple[int, ...]
    """Numbers of pairs, ascending; the last is the cap."""
    thresholds: tuple[float, ...]
    """The two-sided p-value that decides at each look."""


def plan(looks: Sequence[int], alpha: float = 0.05) -> SequentialPlan:
    """A plan whose error over all looks together is `alpha`.

    The error is spent as Lan and DeMets have it ("Discrete sequential boundaries for clinical trials",
    Biometrika 70, 1983), by their function close to O'Brien and Fleming's bounds: hardly any early on. The
    probabilities are those of a Brownian motion, by the recursion of Armitage, McPherson and Rowe ("Repeated
    significance tests on accumulating data", JRSS A 132, 1969). ValueError for looks that do not grow.
    """
    if not looks or looks[0] < 1 or any(a >= b for a, b in pairwise(looks)):
        raise ValueError(f"the looks {tuple(looks)} should be numbers of pairs that grow")
    thresholds, spent, before = [], 0.0, 0.0
    density: Floats | None = None
    step = float(_GRID[1] - _GRID[0])
    for look in looks:
        part = look / looks[-1]
        due = 4.0 * float(norm.sf(norm.isf(alpha / 4.0) / math.sqrt(part)))  # on both sides together
        here = _after(density, part - before, step)
        bound = _bound(here, max(due - spent, 0.0), step)
        thresholds.append(2.0 * float(norm.sf(bound / math.sqrt(part))))
        here[np.abs(_GRID) >= bound] = 0.0  # there the watching has ended
        density = here
        spent, before = due, part
    return SequentialPlan(tuple(looks), tuple(thresholds))


def _after(density: Floats | None, elapsed: float, step: float) -> Floats:
    """The density after another stretch of time; None: that of a motion which begins at 0."""
    spread: Floats = norm.pdf(_GRID, scale=math.sqrt(elapsed))
    if density is None:
        return spread
    convolved: Floats = np.asarray(np.convolve(density, spread, mode="same") * step, np.float64)
    return convolved


def _bound(density: Floats, probability: float, step: float) -> float:
    """Beyond which, on both sides, the density has this probability."""
    if probability <= 0.0:
        return float(_GRID[-1])
    outside = 2.0 * np.cumsum(density[::-1])[: _GRID.size // 2] * step  # from the far end inwards, both tails
    place = int(np.searchsorted(outside, probability))
    if place == 0:
        return float(_GRID[-1])
    share = (probability - outside[place - 1]) / (outside[place] - outside[place - 1])
    return float(_GRID[::-1][place - 1] - (share + 0.5) * step)
