"""Clock synchronisation of several robots from radio frames timestamped by more than one of them.

Model: timestamp by clock i = reference time + offset and drift of the clock + latency of that kind of stamp
(equal for all robots) + noise. Offsets, drifts and latencies are estimated together over all clocks and
frames by Huber's M-estimator (P. J. Huber, Robust Statistics, 1981, ch. 7), with priors for drifts and
latencies. Errors are simultaneous for all clocks and follow from the residuals by the sandwich estimator
(6.3), with the frames of one second as a cluster.

A constant latency of all stamps of one robot cannot be distinguished from a clock offset. Its spread between
robots is therefore a parameter; only causality (a frame is received after it was handed over) bounds it; see
ClockFit.causal_bound.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from actors.array_types import Floats, Int64s


class StampKind(IntEnum):
    """Event of a frame that a stamp dates."""

    HEARD = 0
    SENT = 1
    """Transmission confirmed by the sender's transceiver."""
    HANDED = 2
    """Handed to the sender's transceiver, before transmission."""


class Stamp(NamedTuple):
    """Timestamp of a frame by one clock."""

    clock: int
    instant: int
    """µs, by that clock."""
    kind: StampKind


class StampedFrame(NamedTuple):
    """A frame and its stamps by at least two clocks."""

    stamps: tuple[Stamp, ...]
    handed: Stamp | None
    """Hand-over to the transceiver, even if not among the stamps; None: unknown."""


class StampPairs(NamedTuple):
    """Pairs of stamps of one frame, as arrays."""

    first: Int64s
    """(n, 4): clock, instant in µs, kind, frame number."""
    second: Int64s
    weight: Floats
    """2 / number of the frame's stamps: n stamps have n - 1 independent pairs."""


def stamp_pairs(frames: Sequence[StampedFrame], most: int) -> StampPairs:
    """Return all pairs of stamps of each frame; above `most` pairs, only those of every n-th frame."""
    sizes = [len(frame.stamps) * (len(frame.stamps) - 1) // 2 for frame in frames]
    stride = -(-sum(sizes) // most) or 1
    first, second, weight = [], [], []
    for number, frame in enumerate(frames):
        if number % stride:
            continue
        for later, one in enumerate(frame.stamps):
            for other in frame.stamps[:later]:
                first.append((*one, number))
                second.append((*other, number))
                weight.append(2 / len(frame.stamps))
    return StampPairs(
        np.array(first, dtype=np.int64).reshape(-1, 4),
        np.array(second, dtype=np.int64).reshape(-1, 4),
        np.array(weight, dtype=np.float64),
    )


def t_quantile(probability: float, freedom: float) -> float:
    """Return a quantile of Student's t distribution; of the normal one for infinite `freedom`."""
    from scipy.special import ndtri, stdtrit  # optional dependency

    return float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


class ClockNode(NamedTuple):
    """Node of a clock in the spanning tree of clocks with common frames."""

    root: int
    """First clock of the group, the reference of the others."""
    parent: int | None
    """Neighbour in the direction of the root; None for the root."""
    ahead: int
    """Approximate offset against the root, µs: sum of medians along the path."""


def spanning_trees(clocks: int, first: Int64s, second: Int64s) -> tuple[ClockNode, ...]:
    """Connect all clocks that share frames by a maximum spanning tree (Prim's algorithm).

    `first` and `second`: (n, 2), clock and instant in µs, of the same n frames.
    """
    pairs = np.concatenate((np.hstack((first, second)), np.hstack((second, first))))
    counts = np.zeros((clocks, clocks), dtype=np.int64)
    np.add.at(counts, (pairs[:, 0], pairs[:, 2]), 1)
    trees: dict[int, ClockNode] = {}
    for root in range(clocks):
        if root in trees:
            continue
        trees[root] = ClockNode(root, None, 0)
        group, remaining = [root], [clock for clock in range(clocks) if clock not in trees]
        while remaining:
            edges = counts[np.ix_(group, remaining)]
            if not edges.any():
                break
            row, column = np.unravel_index(np.argmax(edges), edges.shape)
            parent, clock = group[int(row)], remaining.pop(int(column))
            both = pairs[(pairs[:, 0] == clock) & (pairs[:, 2] == parent)]
            trees[clock] = ClockNode(
                root, parent, trees[parent].ahead + int(np.sort(both[:, 1] - both[:, 3])[len(both) // 2])
            )
            group.append(clock)
    return tuple(trees[clock] for clock in range(clocks))


_HUBER = 1.345
"""Standard deviations above which a residual has less weight; 95 % efficient (Huber 1981)."""
_MAD = 1.4826
"""Ratio of standard deviation to median absolute deviation, for normal noise."""


@dataclass(frozen=True)
class AlignmentParameters:
    """Assumptions about clocks and stamps, and the confidence level."""

    drift_ppm: float = 100.0
    """Prior standard deviation of the difference of two clock rates; quartz keeps within 100 ppm."""
    lag_us: tuple[float, float] = (0.0, -8000.0)
    """Prior latency of the stamps SENT and HANDED relative to HEARD: a frame of 100 octets takes 3.4 ms on
    the air, after about as much of CSMA/CA (IEEE 802.15.4-2006, 250 kbit/s)."""
    lag_spread_us: float = 10_000.0
    """Standard deviation of `lag_us`; a USB serial port's latency timer is 16 ms (FTDI AN232B-04)."""
    latency_spread_us: float = 700.0
    """Standard deviation of the latency difference between robots, which frames cannot show; measured: 0.4 to
    0.9 ms between three robots on one machine with emulated boards."""
    noise_us: float = 5_000.0
    """Prior noise of a stamp; n frames reduce it to 1/n."""
    resolution_us: float = 16.0
    """Lower limit of the noise: one symbol of IEEE 802.15.4."""
    block_us: int = 1_000_000
    """Duration of a cluster of frames with common errors."""
    confidence: float = 0.95
    """Probability that no clock exceeds its error bound."""
    most_pairs: int = 100_000
    """Upper limit of stamp pairs; above it, frames are skipped evenly."""


class Solution(NamedTuple):
    """Estimated offset at the origin (µs) and drift (µs/s) of each clock, then the two latencies (µs)."""

    estimate: Floats
    variance: Floats
    """Covariance of the estimate: the larger of the noise-based and the sandwich estimate."""
    noise: float
    """Standard deviation of the residuals."""
    blocks: Int64s
    """Cluster of each pair."""


def solve(pairs: StampPairs, trees: Sequence[ClockNode], origins: Int64s, p: AlignmentParameters) -> Solution:
    """Estimate all unknowns together; stops when no estimate changes by 1 ns."""
    clocks, count = len(trees), len(pairs.weight)
    ahead = np.array([tree.ahead for tree in trees], dtype=np.int64)
    rows, full_design, coarse = np.arange(count), np.zeros((count, 2 * clocks + 2)), []
    for side, sign in ((pairs.first, 1.0), (pairs.second, -1.0)):
        clock, instant, kind = side[:, 0], side[:, 1], side[:, 2]
        full_design[rows, 2 * clock] += sign
        full_design[rows, 2 * clock + 1] += sign * (instant - origins[clock]) / 1e6
        lagging = kind > 0
        full_design[rows[lagging], 2 * clocks + kind[lagging] - 1] += sign
        coarse.append(instant - ahead[clock])
    target: Floats = (coarse[0] - coarse[1]).astype(np.float64)
    blocks: Int64s = coarse[1] // p.block_us
    fixed = np.repeat([tree.parent is None for tree in trees], 2)
    free = np.concatenate((np.flatnonzero(~fixed), [2 * clocks, 2 * clocks + 1]))
    design = full_design[:, free]
    drifts = np.tile([0.0, p.drift_ppm**-2], clocks)
    prior = np.concatenate((drifts, np.full(2, p.lag_spread_us**-2)))[free]
    expected = np.concatenate((np.zeros(2 * clocks), p.lag_us))[free]

    estimate = expected.copy()
    residual, noise = _residual(design, target, estimate, p)
    for _ in range(100):
        before, weight = estimate, pairs.weight * _huber(residual, noise) / noise**2
        matrix = design.T @ (design * weight[:, None]) + np.diag(prior)
        estimate = np.linalg.solve(matrix, design.T @ (weight * target) + prior * expected)
        residual, noise = _residual(design, target, estimate, p)
        if np.abs(estimate - before).max(initial=0.0) < 1e-3:
            break

    curved = pairs.weight * (np.abs(residual) <= _HUBER * noise) / noise**2
    bread = np.linalg.inv(design.T @ (design * curved[:, None]) + np.diag(prior))
    slopes = design * (pairs.weight * _huber(residual, noise) * residual / noise**2)[:, None]
    _, block = np.unique(blocks, return_inverse=True)
    sums = np.zeros((int(block.max(initial=-1)) + 1, len(free)))
    np.add.at(sums, block, slopes)
    variance = np.zeros((full_design.shape[1], full_design.shape[1]))
    variance[np.ix_(free, free)] = _upper_covariance(bread @ (sums.T @ sums + np.diag(prior)) @ bread, bread)
    full_estimate = np.zeros(full_design.shape[1])
    full_estimate[free] = estimate
    return Solution(full_estimate, variance, noise, blocks)


def _residual(
    design: Floats, target: Floats, estimate: Floats, p: AlignmentParameters
) -> tuple[Floats, float]:
    """Return the residuals and their standard deviation."""
    residual = target - design @ estimate
    if not residual.size:
        return residual, p.noise_us
    spread = _MAD * float(np.median(np.abs(residual)))
    return residual, max(spread, p.noise_us / residual.size, p.resolution_us)


def _huber(residual: Floats, noise: float) -> Floats:
    most = _HUBER * noise
    share: Floats = most / np.maximum(np.abs(residual), most)
    return share


def _upper_covariance(one: Floats, other: Floats) -> Floats:
    """Return a covariance that is at least `one` and `other` in every direction."""
    values, vectors = np.linalg.eigh(one - other)
    larger: Floats = other + (vectors * np.maximum(values, 0.0)) @ vectors.T
    return larger


class ClockFit(NamedTuple):
    """Offset and drift of one clock against the reference of its group; instants in µs."""

    group: int
    """Reference clock of the group; common frames connect the clocks of a group."""
    origin: int
    """Middle of its stamps, by this clock."""
    ahead: int
    """Coarse offset against the reference at `origin`, whole µs."""
    offset: float
    """Remainder of the offset, µs."""
    drift_ppm: float
    frames: int
    """Frames stamped by this clock and another one."""
    variance: tuple[float, float, float]
    """Variance of the offset, covariance, variance of the drift; in µs and µs/s."""
    factor: float
    """Quantile of Student's t distribution for the error bound."""
    limit: float
    """Largest shift at which every frame is still received after it was handed over, µs; inf: no frames limit
    it. Assumes that no event is stamped before it happens."""
    normal_factor: float
    """Quantile of the normal distribution, as `factor`."""
    latency_spread: float
    """Standard deviation of the latency difference between robots, µs."""

    def reference(self, instant: int) -> int:
        """Convert an instant of this clock to the reference clock."""
        moved = self.offset + self.drift_ppm * (instant - self.origin) / 1e6
        return instant - self.ahead - round(moved)

    def error(self, instant: int) -> float:
        """Return the error bound of `reference`, µs, at the confidence level for all clocks together."""
        statistical = math.hypot(self.scatter(instant), self.normal_factor * self.latency_spread)
        return min(statistical, self.causal_bound(instant))

    def scatter(self, instant: int) -> float:
        """Return the part of the error bound that follows from the residuals, µs."""
        elapsed_s = (instant - self.origin) / 1e6
        offset, covariance, drift = self.variance
        return self.factor * math.sqrt(max(0.0, offset + 2 * elapsed_s * covariance + elapsed_s**2 * drift))

    def causal_bound(self, instant: int) -> float:
        """Return the error bound by causality, valid for any latencies, µs; inf: none."""
        elapsed_s = abs(instant - self.origin) / 1e6
        return self.limit + self.normal_factor * elapsed_s * math.sqrt(self.variance[2])


class Alignment(NamedTuple):
    """Fits of all clocks, and the residual noise."""

    fits: tuple[ClockFit, ...]
    noise_us: float
    """Standard deviation of the residuals of stamp pairs, µs."""


def align(frames: Sequence[StampedFrame], clocks: int, parameters: AlignmentParameters) -> Alignment:
    """Fit `clocks` clocks to the stamps. A clock without common frames forms its own group."""
    pairs = stamp_pairs(frames, parameters.most_pairs)
    trees = spanning_trees(clocks, pairs.first[:, :2], pairs.second[:, :2])
    origins = _origins(clocks, pairs)
    estimate, variance, noise, parts = solve(pairs, trees, origins, parameters)
    limits = _limits(frames, trees, origins, estimate)
    free = sum(tree.parent is not None for tree in trees)
    tail = (1 - parameters.confidence) / (4 * max(free, 1))  # two-sided, at both ends of each clock's time
    fits = []
    for clock, tree in enumerate(trees):
        touched = (pairs.first[:, 0] == clock) | (pairs.second[:, 0] == clock)
        blocks = len(np.unique(parts[touched]))
        at = slice(2 * clock, 2 * clock + 2)
        part = variance[at, at]
        fits.append(
            ClockFit(
                group=tree.root,
                origin=int(origins[clock]),
                ahead=tree.ahead,
                offset=float(estimate[2 * clock]),
                drift_ppm=float(estimate[2 * clock + 1]),
                frames=len(np.unique(pairs.first[touched, 3])),
                variance=(float(part[0, 0]), float(part[0, 1]), float(part[1, 1])),
                factor=t_quantile(1 - tail, max(1, blocks - 2)),
                limit=limits[clock],
                normal_factor=t_quantile(1 - tail, math.inf),
                latency_spread=parameters.latency_spread_us,
            )
        )
    return Alignment(tuple(fits), noise)


def _origins(clocks: int, pairs: StampPairs) -> Int64s:
    """Return the middle of each clock's stamps, by that clock."""
    both = np.concatenate((pairs.first, pairs.second))
    origins = np.zeros(clocks, dtype=np.int64)
    for clock in range(clocks):
        instants = both[both[:, 0] == clock, 1]
        if instants.size:
            origins[clock] = (int(instants.min()) + int(instants.max())) // 2
    return origins


def _limits(
    frames: Sequence[StampedFrame], trees: Sequence[ClockNode], origins: Int64s, estimate: Floats
) -> list[float]:
    """Return the causal limit of each clock's shift, µs: shortest paths over the least frame delays."""
    clocks = len(trees)
    slack = np.full((clocks, clocks), math.inf)
    np.fill_diagonal(slack, 0.0)

    def reference(stamp: Stamp) -> float:
        at = 2 * stamp.clock
        moved = estimate[at] + estimate[at + 1] * (stamp.instant - int(origins[stamp.clock])) / 1e6
        return stamp.instant - trees[stamp.clock].ahead - float(moved)

    for frame in frames:
        if frame.handed is None:
            continue
        handed_at = reference(frame.handed)
        for stamp in frame.stamps:
            if stamp.kind is StampKind.HEARD:
                link = frame.handed.clock, stamp.clock
                slack[link] = min(slack[link], reference(stamp) - handed_at)
    for middle in range(clocks):
        slack = np.minimum(slack, slack[:, middle, None] + slack[None, middle, :])
    return [float(max(slack[tree.root, clock], slack[clock, tree.root])) for clock, tree in enumerate(trees)]
