"""The runs of one cell together, with what chance may have done to them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.localisation.course import STEP_US
from benchmarks.localisation.metrics import BEYOND, NEES_BOUNDS, Run, finite
from benchmarks.statistics.confidence import proportion

_RESAMPLES: Final = 2000


@dataclass(frozen=True)
class Share:
    """How many of all, with the 95 % interval of the share (Wilson, JASA 22(158), 1927)."""

    count: int
    of: int
    low: float
    high: float


@dataclass(frozen=True)
class Summary:
    """All runs of a cell, every seed counted."""

    runs: int
    rmse: float
    """Over all poses of all runs, m."""
    rmse_low: float
    rmse_high: float
    """Its 95 % interval: percentiles of a bootstrap over the runs (Efron and Tibshirani 1993, chapter 13)."""
    rmse_median_run: float
    """Of the runs' own values, m."""
    median: float
    """Error over all poses, m."""
    max: float
    share_beyond: float
    """Of the time with an error above BEYOND."""
    lost: Share
    nees_median: float | None
    """Over the steps with an error up to BEYOND."""
    nees_below: float
    nees_above: float
    """Shares of the time outside NEES_BOUNDS; 2.5 % each where the covariance is right."""
    spells: Share
    """Of the spells of being lost those that were announced."""
    false_alarms: int
    hours: float
    """Of robots under way."""
    cpu_us_mean: float | None
    """CPU time per call that weighed a scan, µs; the minimum over all runs beside it."""
    cpu_us_min: float | None


def summary(runs: Sequence[Run]) -> Summary:
    """What the runs of a cell, at least one, come to."""
    squares = np.array([run.mean_square for run in runs])
    errors = np.concatenate([run.errors for run in runs])
    consistency = np.concatenate([run.tracking for run in runs])
    spells = [announced for run in runs for announced in run.spells]
    costs = np.concatenate([run.costs for run in runs])
    low, high = interval(squares)
    return Summary(
        len(runs),
        math.sqrt(squares.mean()),
        low,
        high,
        float(np.median(np.sqrt(squares))),
        float(np.median(errors)),
        float(errors.max()),
        float(np.mean(errors > BEYOND)),
        share(sum(run.lost for run in runs), len(runs)),
        finite(np.median(consistency)) if consistency.size else None,
        float(np.mean(consistency < NEES_BOUNDS[0])) if consistency.size else 0.0,
        float(np.mean(consistency > NEES_BOUNDS[1])) if consistency.size else 0.0,
        share(sum(spells), len(spells)),
        sum(run.false_alarms for run in runs),
        errors.size * STEP_US / 3.6e9,
        float(costs.mean() * 1e6) if costs.size else None,
        float(costs.min() * 1e6) if costs.size else None,
    )


def interval(squares: "np.typing.NDArray[np.float64]") -> tuple[float, float]:
    """The bootstrap's 95 % interval of the root of the mean of (runs,) mean squares."""
    low, high = np.percentile(np.sqrt(resampled(squares)), (2.5, 97.5)).tolist()
    return low, high


def resampled(values: "np.typing.NDArray[np.float64]") -> "np.typing.NDArray[np.float64]":
    """(_RESAMPLES,): means of as many values, drawn with replacement."""
    draws = np.random.default_rng(0).integers(len(values), size=(_RESAMPLES, len(values)))
    means: np.typing.NDArray[np.float64] = values[draws].mean(axis=1)
    return means


def share(count: int, of: int) -> Share:
    """With Wilson's interval, which holds for 0 and all as well."""
    if not of:
        return Share(0, 0, 0.0, 1.0)
    return Share(count, of, *proportion(count, of)[1:])
