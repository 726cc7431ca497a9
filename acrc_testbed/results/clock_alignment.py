"""Alignment of the clocks of several robots by radio frames that more than one of them has stamped.

Model: what clock i shows at a stamp is the instant by the reference clock, plus the clock's offset and drift,
plus a lag of that kind of stamp (equal for all robots), plus noise. Offsets, drifts and lags are estimated
together over all clocks and frames by Huber's M-estimator (P. J. Huber, Robust Statistics, 1981, ch. 7), with
priors for drifts and lags. Errors come from the residuals by the sandwich estimator (6.3), frames of one
second as one cluster, and hold for all clocks at once.

A robot whose stamps are all late by the same amount looks like one whose clock is ahead. So the parameters
state how unequal robots are; only causality (no frame is heard before it was handed over) bounds that; see
Fit.surely_within.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class StampKind(IntEnum):
    """What a stamp says of its frame."""

    HEARD = 0
    SENT = 1
    """Confirmed by the sender's transceiver."""
    HANDED = 2
    """Given to the sender's transceiver, before it has left."""


class Stamp(NamedTuple):
    """One clock's word on one frame."""

    clock: int
    instant: int
    """µs, by that clock."""
    kind: StampKind


class StampedFrame(NamedTuple):
    """One frame and its stamps, by at least two clocks."""

    stamps: tuple[Stamp, ...]
    handed: Stamp | None
    """When it was handed over, whether or not that is among the stamps."""


class Pairs(NamedTuple):
    """Two stamps of one frame each, as arrays."""

    first: NDArray[np.int64]
    """(n, 4): clock, instant, kind, number of the frame."""
    second: NDArray[np.int64]
    weight: NDArray[np.float64]
    """2 / number of the frame's stamps: all pairs of n stamps know as much as n - 1 of them."""


def pairs_of(frames: Sequence[StampedFrame], most: int) -> Pairs:
    """All pairs of stamps of each frame; if there are more than `most`, those of every n-th frame only."""
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
    return Pairs(
        np.array(first, dtype=np.int64).reshape(-1, 4),
        np.array(second, dtype=np.int64).reshape(-1, 4),
        np.array(weight, dtype=np.float64),
    )


def quantile(probability: float, freedom: float) -> float:
    """Return the quantile of Student's t distribution; of the normal one for infinite `freedom`."""
    from scipy.special import ndtri, stdtrit  # an extra that only alignment needs

    return float(ndtri(probability) if math.isinf(freedom) else stdtrit(freedom, probability))


class Tree(NamedTuple):
    """One clock's place among those that frames connect."""

    root: int
    """The first clock of its group, against which the others are measured."""
    parent: int | None
    """The clock by which it is connected; None for a root."""
    ahead: int
    """What it shows more than the root, about, µs: the sum of medians along the way."""


def spanning_trees(clocks: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> tuple[Tree, ...]:
    """Connect all clocks that share frames, over the pairs of clocks that share most (Prim).

    `first` and `second`: (n, 2), clock and instant in µs, of the same n frames.
    """
    pairs = np.concatenate((np.hstack((first, second)), np.hstack((second, first))))
    counts = np.zeros((clocks, clocks), dtype=np.int64)
    np.add.at(counts, (pairs[:, 0], pairs[:, 2]), 1)
    trees: dict[int, Tree] = {}
    for root in range(clocks):
        if root in trees:
            continue
        trees[root] = Tree(root, None, 0)
        group, left = [root], [clock for clock in range(clocks) if clock not in trees]
        while left:
            edges = counts[np.ix_(group, left)]
            if not edges.any():
                break
            row, column = np.unravel_index(np.argmax(edges), edges.shape)
            parent, clock = group[int(row)], left.pop(int(column))
            both = pairs[(pairs[:, 0] == clock) & (pairs[:, 2] == parent)]
            more = np.sort(both[:, 1] - both[:, 3])
            trees[clock] = Tree(root, parent, trees[parent].ahead + int(more[more.size // 2]))
            group.append(clock)
    return tuple(trees[clock] for clock in range(clocks))


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


class Solution(NamedTuple):
    """The unknowns: for each clock offset at its origin (µs) and drift (µs/s), then the two lags (µs)."""

    estimate: Floats
    variance: Floats
    """Covariance of the estimate: the larger one of what noise and what the residuals themselves say."""
    noise: float
    """Standard deviation of the residuals."""
    blocks: NDArray[np.int64]
    """Block of each pair, in which errors may be common."""


def solve(
    pairs: Pairs, trees: Sequence[Tree], origins: NDArray[np.int64], p: AlignmentParameters
) -> Solution:
    """Estimate all unknowns together; stops when nothing moves by 1 ns."""
    clocks, count = len(trees), len(pairs.weight)
    ahead = np.array([tree.ahead for tree in trees], dtype=np.int64)
    rows, whole, shown = np.arange(count), np.zeros((count, 2 * clocks + 2)), []
    for side, sign in ((pairs.first, 1.0), (pairs.second, -1.0)):
        clock, instant, kind = side[:, 0], side[:, 1], side[:, 2]
        whole[rows, 2 * clock] += sign
        whole[rows, 2 * clock + 1] += sign * (instant - origins[clock]) / 1e6
        told = kind > 0
        whole[rows[told], 2 * clocks + kind[told] - 1] += sign
        shown.append(instant - ahead[clock])
    target: Floats = (shown[0] - shown[1]).astype(np.float64)
    blocks: NDArray[np.int64] = shown[1] // p.block_us
    fixed = np.repeat([tree.parent is None for tree in trees], 2)
    free = np.concatenate((np.flatnonzero(~fixed), [2 * clocks, 2 * clocks + 1]))
    design = whole[:, free]
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
    variance = np.zeros((whole.shape[1], whole.shape[1]))
    variance[np.ix_(free, free)] = _larger(bread @ (sums.T @ sums + np.diag(prior)) @ bread, bread)
    every = np.zeros(whole.shape[1])
    every[free] = estimate
    return Solution(every, variance, noise, blocks)


def _residual(
    design: Floats, target: Floats, estimate: Floats, p: AlignmentParameters
) -> tuple[Floats, float]:
    """Return the residuals and their standard deviation."""
    residual: Floats = target - design @ estimate
    if not residual.size:
        return residual, p.noise_us
    spread = _MAD * float(np.median(np.abs(residual)))
    return residual, max(spread, p.noise_us / residual.size, p.resolution_us)


def _huber(residual: Floats, noise: float) -> Floats:
    most = _HUBER * noise
    share: Floats = most / np.maximum(np.abs(residual), most)
    return share


def _larger(one: Floats, other: Floats) -> Floats:
    """A covariance that is less than either in no direction: `other` and what `one` has more."""
    values, vectors = np.linalg.eigh(one - other)
    larger: Floats = other + (vectors * np.maximum(values, 0.0)) @ vectors.T
    return larger


class Fit(NamedTuple):
    """One clock against the reference of its group; instants in µs."""

    group: int
    """Clocks of one group are connected by frames; the number of its reference clock."""
    origin: int
    """By this clock; in the middle of its stamps."""
    ahead: int
    """What the clock shows more than the reference at `origin`, whole µs."""
    offset: float
    """What remains of it, µs."""
    drift_ppm: float
    frames: int
    """Frames that this clock and another one have stamped."""
    variance: tuple[float, float, float]
    """Of offset, of both, of drift; µs² and powers of µs/s."""
    factor: float
    """Standard deviations to the stated error."""
    limit: float
    """How far the clock could be moved at most before some frame is heard before it was handed over, µs; inf:
    no frames say so. Takes for granted that nothing is stamped before it happens."""
    normal_factor: float
    """As `factor`, for what is normally distributed."""
    unlike: float
    """Standard deviation of how much later one robot's stamps are than another's, µs."""

    def reference(self, instant: int) -> int:
        """What the reference shows when this clock shows `instant`."""
        moved = self.offset + self.drift_ppm * (instant - self.origin) / 1e6
        return instant - self.ahead - round(moved)

    def error(self, instant: int) -> float:
        """Bound of the error of `reference`, µs, with the confidence of the parameters for all clocks."""
        likely = math.hypot(self.scatter(instant), self.normal_factor * self.unlike)
        return min(likely, self.surely_within(instant))

    def scatter(self, instant: int) -> float:
        """The share of it that the residuals tell: all, if the stamps of all robots lag alike; µs."""
        since = (instant - self.origin) / 1e6
        offset, both, drift = self.variance
        return self.factor * math.sqrt(max(0.0, offset + 2 * since * both + since**2 * drift))

    def surely_within(self, instant: int) -> float:
        """What cause and effect say, whatever the lags, µs; inf = nothing."""
        since = abs(instant - self.origin) / 1e6
        return self.limit + self.normal_factor * since * math.sqrt(self.variance[2])


class Alignment(NamedTuple):
    """All clocks, and how well they fit."""

    fits: tuple[Fit, ...]
    noise_us: float
    """Standard deviation of the difference of two stamps of a frame from what the fit says."""


def align(frames: Sequence[StampedFrame], clocks: int, parameters: AlignmentParameters) -> Alignment:
    """Fit `clocks` clocks to the stamps. A clock without a frame in common is a group of its own."""
    pairs = pairs_of(frames, parameters.most_pairs)
    trees = spanning_trees(clocks, pairs.first[:, :2], pairs.second[:, :2])
    origins = _origins(clocks, pairs)
    estimate, variance, noise, parts = solve(pairs, trees, origins, parameters)
    limits = _limits(frames, trees, origins, estimate)
    free = sum(tree.parent is not None for tree in trees)
    tail = (1 - parameters.confidence) / (4 * max(free, 1))  # two sides, two ends of each clock's time
    fits = []
    for clock, tree in enumerate(trees):
        touched = (pairs.first[:, 0] == clock) | (pairs.second[:, 0] == clock)
        blocks = len(np.unique(parts[touched]))
        at = slice(2 * clock, 2 * clock + 2)
        part = variance[at, at]
        fits.append(
            Fit(
                group=tree.root,
                origin=int(origins[clock]),
                ahead=tree.ahead,
                offset=float(estimate[2 * clock]),
                drift_ppm=float(estimate[2 * clock + 1]),
                frames=len(np.unique(pairs.first[touched, 3])),
                variance=(float(part[0, 0]), float(part[0, 1]), float(part[1, 1])),
                factor=quantile(1 - tail, max(1, blocks - 2)),
                limit=limits[clock],
                normal_factor=quantile(1 - tail, math.inf),
                unlike=parameters.unlike_us,
            )
        )
    return Alignment(tuple(fits), noise)


def _origins(clocks: int, pairs: Pairs) -> NDArray[np.int64]:
    """The middle of each clock's stamps, by the clock."""
    both = np.concatenate((pairs.first, pairs.second))
    origins = np.zeros(clocks, dtype=np.int64)
    for clock in range(clocks):
        instants = both[both[:, 0] == clock, 1]
        if instants.size:
            origins[clock] = (int(instants.min()) + int(instants.max())) // 2
    return origins


def _limits(
    frames: Sequence[StampedFrame], trees: Sequence[Tree], origins: NDArray[np.int64], estimate: Floats
) -> list[float]:
    """How far each clock could be moved, µs: shortest paths over the shortest ways from hand to ear."""
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
        begun = reference(frame.handed)
        for stamp in frame.stamps:
            if stamp.kind is StampKind.HEARD:
                way = frame.handed.clock, stamp.clock
                slack[way] = min(slack[way], reference(stamp) - begun)
    for middle in range(clocks):
        slack = np.minimum(slack, slack[:, middle, None] + slack[None, middle, :])
    return [float(max(slack[tree.root, clock], slack[clock, tree.root])) for clock, tree in enumerate(trees)]
