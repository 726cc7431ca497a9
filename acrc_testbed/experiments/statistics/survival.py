"""Times until something is done, of which some are only known to be longer than the run."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from acrc_testbed.experiments.statistics.paired_tests import Interval, mean_interval

Floats = NDArray[np.float64]


class Completion(NamedTuple):
    """When a run was done, or until when it was watched without being done."""

    at: float
    done: bool


@dataclass(frozen=True)
class SurvivalCurve:
    """The share of runs that are not done yet, as a step function of time."""

    times: Floats
    """(n,): at which it falls, ascending."""
    shares: Floats
    """(n,): from that time on."""
    low: Floats
    high: Floats
    """(n,): 95 % interval, by Greenwood's formula on the log-log scale."""

    def share_at(self, time: float) -> float:
        """The share that is not done at a time."""
        place = int(np.searchsorted(self.times, time, side="right"))
        return 1.0 if place == 0 else float(self.shares[place - 1])


def kaplan_meier(runs: Sequence[Completion]) -> SurvivalCurve:
    """The product-limit estimate of at least one run.

    Kaplan and Meier, "Nonparametric estimation from incomplete observations", JASA 53, 1958.
    """
    found = stats.ecdf(_censored(runs)).sf
    if not any(run.done for run in runs):
        none = np.zeros(0)
        return SurvivalCurve(none, none, none, none)
    with warnings.catch_warnings():  # at a share of 0 there is no such interval, and scipy says so
        warnings.simplefilter("ignore", RuntimeWarning)
        bounds = found.confidence_interval(method="log-log")
    falls = np.flatnonzero(np.diff(np.concatenate([[1.0], found.probabilities])) < 0)
    shares = found.probabilities[falls]
    low, high = (one.probabilities[falls] for one in (bounds.low, bounds.high))
    low, high = (np.where(np.isnan(one), shares, one) for one in (low, high))
    return SurvivalCurve(found.quantiles[falls], shares, low, high)


def restricted_mean(runs: Sequence[Completion], horizon: float) -> Interval:
    """The mean time until done, or the horizon, whichever comes first: the area under the curve.

    Royston and Parmar, "Restricted mean survival time: an alternative to the hazard ratio for the design and
    analysis of randomized trials with a time-to-event outcome", BMC Medical Research Methodology 13, 2013.
    The interval is Student's, of the jackknife's pseudo-values (Andersen, Hansen and Klein, "Regression
    analysis of restricted mean survival time based on pseudo-observations", Lifetime Data Analysis 10, 2004).
    """
    places = np.arange(len(runs))
    value = float(restricted_means(runs, horizon, places))
    if len(runs) < 2:
        return mean_interval([value])
    others = np.array([np.delete(places, place) for place in places])
    pseudo = len(runs) * value - (len(runs) - 1) * restricted_means(runs, horizon, others)
    found = mean_interval(pseudo)
    return Interval(value, value - found.value + found.low, value - found.value + found.high)


def restricted_means(runs: Sequence[Completion], horizon: float, drawn: NDArray[np.integer[Any]]) -> Floats:
    """The same of many samples of the runs at once, given by the runs' places (…, n); gives (…).

    Equal to the area under `kaplan_meier` of each sample.
    """
    times, which = np.unique([run.at for run in runs], return_inverse=True)
    done = np.array([run.done for run in runs])
    flat = drawn.reshape(-1, drawn.shape[-1])
    ended, left = np.zeros((2, len(flat), times.size))
    rows = np.arange(len(flat))[:, None]
    np.add.at(left, (rows, which[flat]), 1.0)
    np.add.at(ended, (rows, which[flat]), done[flat].astype(np.float64))
    at_risk = left[:, ::-1].cumsum(axis=1)[:, ::-1]
    shares = np.cumprod(1.0 - ended / np.maximum(at_risk, 1.0), axis=1)
    heights = np.concatenate([np.ones((len(flat), 1)), shares], axis=1)
    widths = np.diff(np.minimum(np.concatenate([[0.0], times, [horizon]]), horizon))
    means: Floats = (heights * np.maximum(widths, 0.0)).sum(axis=1).reshape(drawn.shape[:-1])
    return means


def _censored(runs: Sequence[Completion]) -> "stats.CensoredData":
    done = [run.at for run in runs if run.done]
    return stats.CensoredData(uncensored=done, right=[run.at for run in runs if not run.done])
