"""The equations between clocks that frames give, and their solution.

Model: what clock i shows at a stamp is the instant by the reference clock, plus the clock's offset and drift,
plus a lag of that kind of stamp (alike for all robots), plus noise. Offsets, drifts and lags are estimated
together over all clocks and frames, by Huber's M-estimator (P. J. Huber, Robust Statistics, 1981, ch. 7), so
that clocks are tied to one another also over third ones, and late stamps count little. What is expected of
drifts and lags counts as if it had been measured, and matters where there is little data.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observation.field_trial.clocks.frame_stamps import Pairs
from observation.field_trial.clocks.graph import Tree

Floats = NDArray[np.float64]
_HUBER = 1.345
"""A residual of more standard deviations counts less; 95 % efficient with normal noise (Huber 1981)."""
_MAD = 1.4826
"""From the median absolute deviation to the standard deviation of normal noise."""


@dataclass(frozen=True)
class AlignmentParameters:
    """What is taken for granted about clocks and stamps, and how sure the errors are to be."""

    drift_ppm: float = 100.0
    """Standard deviation of the difference of two clocks' rates. Quartz oscillators of computers keep within
    100 ppm; more is believed if frames over a longer time say so."""
    lag_us: tuple[float, float] = (0.0, -8000.0)
    """How much later than heard a frame is stamped as sent and as handed over, before there is data: a frame
    of 100 octets is 3.4 ms on the air, after about as much of CSMA/CA (IEEE 802.15.4-2006, 250 kbit/s)."""
    lag_spread_us: float = 10_000.0
    """Standard deviation of these: about the latency timer of a USB serial port, 16 ms (FTDI AN232B-04)."""
    unlike_us: float = 700.0
    """Standard deviation of how much later one robot's stamps are than another's, which frames do not tell:
    between three robots on one machine with emulated boards 0.4 to 0.9 ms were measured."""
    noise_us: float = 5_000.0
    """Of a stamp where nothing is known yet; n frames reduce it to a n-th."""
    resolution_us: float = 16.0
    """No noise is taken to be less: a symbol of IEEE 802.15.4."""
    block_us: int = 1_000_000
    """Frames within this time may have errors in common."""
    confidence: float = 0.95
    """That no clock's error is above what is stated."""
    most_pairs: int = 100_000
    """Pairs of stamps; of more frames than give so many, some are left out evenly."""


class System:
    """The unknowns: for each clock offset at its origin (µs) and drift (µs/s), then the two lags (µs)."""

    def __init__(
        self,
        pairs: Pairs,
        trees: Sequence[Tree],
        origins: NDArray[np.int64],
        parameters: AlignmentParameters,
    ) -> None:
        self._parameters = parameters
        clocks = len(trees)
        count, size = len(pairs.weight), 2 * clocks + 2
        ahead = np.array([tree.ahead for tree in trees], dtype=np.int64)
        rows = np.arange(count)
        design = np.zeros((count, size))
        shown = []
        for side, sign in ((pairs.first, 1.0), (pairs.second, -1.0)):
            clock, instant, kind = side[:, 0], side[:, 1], side[:, 2]
            design[rows, 2 * clock] += sign
            design[rows, 2 * clock + 1] += sign * (instant - origins[clock]) / 1e6
            told = kind > 0
            design[rows[told], 2 * clocks + kind[told] - 1] += sign
            shown.append(instant - ahead[clock])
        self._design = design
        self._target: Floats = (shown[0] - shown[1]).astype(np.float64)
        self._weight = pairs.weight
        self.blocks: NDArray[np.int64] = shown[1] // parameters.block_us
        fixed = np.repeat([tree.parent is None for tree in trees], 2)
        self._free = np.concatenate((np.flatnonzero(~fixed), [2 * clocks, 2 * clocks + 1]))
        drifts = np.tile([0.0, parameters.drift_ppm**-2], clocks)
        self._prior = np.concatenate((drifts, np.full(2, parameters.lag_spread_us**-2)))
        self._expected = np.concatenate((np.zeros(2 * clocks), parameters.lag_us))

    def solve(self) -> tuple[Floats, float]:
        """The estimate, and the residuals' standard deviation. Stops when nothing moves by 1 ns."""
        estimate = self._expected.copy()
        noise = self._noise(estimate)
        for _ in range(100):
            before = estimate
            estimate = self._step(estimate, noise)
            noise = self._noise(estimate)
            if np.abs(estimate - before).max(initial=0.0) < 1e-3:
                break
        return estimate, noise

    def variance(self, estimate: Floats, noise: float) -> Floats:
        """Covariance of the estimate: the larger one of what noise and what the residuals themselves say."""
        free = self._free
        design = self._design[:, free]
        residual = self._residual(estimate)
        near = np.abs(residual) <= _HUBER * noise
        prior = np.diag(self._prior[free])
        curved = self._weight * near / noise**2
        bread = np.linalg.inv(design.T @ (design * curved[:, None]) + prior)
        slopes = design * (self._weight * self._huber(residual, noise) * residual / noise**2)[:, None]
        _, block = np.unique(self.blocks, return_inverse=True)
        sums = np.zeros((int(block.max(initial=-1)) + 1, len(free)))
        np.add.at(sums, block, slopes)
        filled = bread @ (sums.T @ sums + prior) @ bread
        whole = np.zeros((len(estimate), len(estimate)))
        whole[np.ix_(free, free)] = _larger(filled, bread)
        return whole

    def _step(self, estimate: Floats, noise: float) -> Floats:
        free = self._free
        design, prior = self._design[:, free], self._prior[free]
        weight = self._weight * self._huber(self._residual(estimate), noise) / noise**2
        matrix = design.T @ (design * weight[:, None]) + np.diag(prior)
        side = design.T @ (weight * self._target) + prior * self._expected[free]
        solved = np.zeros_like(estimate)
        solved[free] = np.linalg.solve(matrix, side)
        return solved

    def _residual(self, estimate: Floats) -> Floats:
        residual: Floats = self._target - self._design @ estimate
        return residual

    def _huber(self, residual: Floats, noise: float) -> Floats:
        most = _HUBER * noise
        share: Floats = most / np.maximum(np.abs(residual), most)
        return share

    def _noise(self, estimate: Floats) -> float:
        residual = np.abs(self._residual(estimate))
        if not residual.size:
            return self._parameters.noise_us
        spread = _MAD * float(np.median(residual))
        return max(spread, self._parameters.noise_us / residual.size, self._parameters.resolution_us)


def _larger(one: Floats, other: Floats) -> Floats:
    """A covariance that is less than either in no direction: `other` and what `one` has more."""
    values, vectors = np.linalg.eigh(one - other)
    larger: Floats = other + (vectors * np.maximum(values, 0.0)) @ vectors.T
    return larger
