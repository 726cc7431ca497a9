"""Survival analysis, and mixed models with random effects of cells and seeds."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from scipy.optimize import minimize
from scipy.stats import t

from acrc_testbed.experiments.paired_tests import CONFIDENCE, Interval, mean_interval
from actors.array_types import Flags, Floats, Indices

MIN_CELLS: Final = 3
_MIN_SEEDS: Final = 3
"""Fewest seeds for estimating the variance between seeds."""
_MAX_RATIO: Final = 1e3
"""Upper bound of a relative standard deviation (in residual standard deviations)."""
_NEGLIGIBLE_RATIO: Final = 1e-3
"""Relative standard deviation that counts as 0."""


@dataclass(frozen=True)
class RandomEffectsFit:
    """Fit of value = mean + cell + seed + residual, all normal; standard deviations in the values' unit."""

    mean: Interval
    """Population mean with its 95 % interval."""
    new_cell: Interval
    """95 % prediction interval of the observed mean of a new cell with as many values."""
    between_cells: float
    between_seeds: float | None
    """Standard deviation between seeds; None with fewer than three seeds."""
    rest: float | None
    """Residual standard deviation; None if every cell has one value."""
    cells: int
    values: int


def fit(values: ArrayLike, cells: ArrayLike, seeds: ArrayLike) -> RandomEffectsFit:
    """Fit values (n,) with crossed random effects of cells and seeds by restricted maximum likelihood (REML).

    As Bates et al., "Fitting linear mixed-effects models using lme4", Journal of Statistical Software 67(1),
    2015; Woodbury's identity limits matrices to cells plus seeds. The mean's interval is Student's with
    cells - 1 degrees of freedom, or seeds - 1 if these are fewer and differ. The prediction interval adds the
    variance of a cell's observed mean; exact for equally many values per cell. Raises ValueError below
    FEWEST_CELLS.
    """
    known = np.asarray(values, np.float64)
    names, of_cell = np.unique(cells, return_inverse=True)
    count = len(names)
    if count < MIN_CELLS:
        raise ValueError(f"{count} cells are too few; at least {MIN_CELLS} are needed")
    seed_names, of_seed = np.unique(seeds, return_inverse=True)
    groups = [of_cell, of_seed] if len(seed_names) >= _MIN_SEEDS else [of_cell]
    spread, free = float(known.std(ddof=1)), count - 1
    rest = None
    between_seeds = None
    if len(known) == count or spread == 0.0:
        mean, error, between_cells = float(known.mean()), spread / math.sqrt(len(known)), spread
        if spread == 0.0:
            rest = None if len(known) == count else 0.0
            between_seeds = 0.0 if len(groups) > 1 else None
    else:
        likelihood = _Likelihood(known, groups)
        found = minimize(
            likelihood,
            [1.0] * len(groups),
            method="Nelder-Mead",
            bounds=[(0.0, _MAX_RATIO)] * len(groups),
            options={"xatol": 1e-7, "fatol": 1e-10, "maxiter": 2000},
        )
        sizes = np.where(found.x < _NEGLIGIBLE_RATIO, 0.0, found.x)
        mean, variance, weight, _ = likelihood.at(sizes)
        rest = math.sqrt(variance)
        error, between_cells = rest / math.sqrt(weight), rest * float(sizes[0])
        if len(groups) > 1:
            between_seeds = rest * float(sizes[1])
            free = count - 1 if sizes[1] == 0.0 else min(count, len(seed_names)) - 1
    quantile = (1 + CONFIDENCE) / 2
    half = float(t.ppf(quantile, free)) * error
    of_one = 0.0 if rest is None else rest / math.sqrt(len(known) / count)
    wide = float(t.ppf(quantile, count - 1)) * math.hypot(between_cells, of_one, error)
    return RandomEffectsFit(
        Interval(mean, mean - half, mean + half),
        Interval(mean, mean - wide, mean + wide),
        between_cells, between_seeds, rest, count, len(known),
    )  # fmt: skip


class _Likelihood:
    """REML criterion (lower is better) of the groups' relative standard deviations."""

    def __init__(self, values: Floats, groups: Sequence[Indices]) -> None:
        columns = [np.eye(int(group.max()) + 1)[group] for group in groups]
        self._middle = float(values.mean())  # centred for numerical accuracy
        self._values = values - self._middle
        self._widths = [column.shape[1] for column in columns]
        design = np.concatenate(columns, axis=1)
        self._crossed = design.T @ design
        self._ones = design.sum(axis=0)
        self._sums = design.T @ self._values
        self._least = 1e-12 * float(self._values @ self._values)

    def __call__(self, sizes: Floats) -> float:
        _, variance, weight, logarithm = self.at(sizes)
        return (len(self._values) - 1) * math.log(variance) + logarithm + math.log(weight)

    def at(self, sizes: Floats) -> tuple[float, float, float, float]:
        """Return mean, residual variance, weight of the mean, and log |I + Z D Z'|."""
        scale = np.repeat(sizes, self._widths)
        inner = np.eye(len(scale)) + scale[:, None] * self._crossed * scale
        ones, sums = scale * self._ones, scale * self._sums
        by_ones, by_sums = np.linalg.solve(inner, np.stack([ones, sums], axis=1)).T
        weight = len(self._values) - float(ones @ by_ones)
        product = float(self._values.sum()) - float(ones @ by_sums)
        squares = float(self._values @ self._values) - float(sums @ by_sums)
        mean = product / weight
        variance = max(squares - mean * product, self._least) / (len(self._values) - 1)
        return self._middle + mean, variance, weight, float(np.linalg.slogdet(inner)[1])


class Completion(NamedTuple):
    """Completion time of a run, or its censoring time."""

    at: float
    done: bool


@dataclass(frozen=True)
class SurvivalCurve:
    """Share of runs not yet complete, as a step function of time."""

    times: Floats
    """(n,): times of the steps, ascending."""
    shares: Floats
    """(n,): share from each time on."""
    low: Floats
    high: Floats
    """(n,): 95 % interval, by Greenwood's formula on the log-log scale."""

    def share_at(self, time: float) -> float:
        """Return the share not complete at a time."""
        index = int(np.searchsorted(self.times, time, side="right"))
        return 1.0 if index == 0 else float(self.shares[index - 1])


def kaplan_meier(runs: Sequence[Completion]) -> SurvivalCurve:
    """Return the product-limit estimate of the survival curve; at least one run.

    Kaplan and Meier, "Nonparametric estimation from incomplete observations", JASA 53, 1958.
    """
    done = [run.at for run in runs if run.done]
    if not done:
        return SurvivalCurve(*np.zeros((4, 0)))
    censored = [run.at for run in runs if not run.done]
    found = stats.ecdf(stats.CensoredData(uncensored=done, right=censored)).sf
    with warnings.catch_warnings():  # scipy warns at a share of 0, which has no interval
        warnings.simplefilter("ignore", RuntimeWarning)
        bounds = found.confidence_interval(method="log-log")
    falls = np.flatnonzero(np.diff(np.concatenate([[1.0], found.probabilities])) < 0)
    shares = found.probabilities[falls]
    low, high = (one.probabilities[falls] for one in (bounds.low, bounds.high))
    low, high = (np.where(np.isnan(one), shares, one) for one in (low, high))
    return SurvivalCurve(found.quantiles[falls], shares, low, high)


def restricted_mean(runs: Sequence[Completion], horizon: float) -> Interval:
    """Return the restricted mean completion time: the area under the survival curve up to the horizon.

    Royston and Parmar, "Restricted mean survival time: an alternative to the hazard ratio for the design and
    analysis of randomized trials with a time-to-event outcome", BMC Medical Research Methodology 13, 2013.
    The interval is Student's, of the jackknife's pseudo-values (Andersen, Hansen and Klein, "Regression
    analysis of restricted mean survival time based on pseudo-observations", Lifetime Data Analysis 10, 2004),
    limited to the possible values, from 0 to the horizon.
    """
    at, done = np.array([run.at for run in runs]), np.array([run.done for run in runs])
    value = _area(at, done, horizon)
    count = len(runs)
    if count < 2:
        return mean_interval([value])
    others = [_area(np.delete(at, index), np.delete(done, index), horizon) for index in range(count)]
    found = mean_interval(count * value - (count - 1) * np.array(others))
    half = found.high - found.value
    return Interval(value, max(value - half, 0.0), min(value + half, horizon))


def _area(at: Floats, done: Flags, horizon: float) -> float:
    """Return the area under the Kaplan-Meier curve up to the horizon."""
    times, which = np.unique(at, return_inverse=True)
    ended, left = np.bincount(which, done), np.bincount(which)
    shares = np.cumprod(1.0 - ended / left[::-1].cumsum()[::-1])
    widths = np.diff(np.minimum(np.concatenate([[0.0], times, [horizon]]), horizon))
    return float((np.concatenate([[1.0], shares]) * np.maximum(widths, 0.0)).sum())
