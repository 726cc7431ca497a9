"""Aligns the clocks of several robots from frames that more than one of them has stamped.

Errors come from the residuals, by the sandwich estimator with the frames of a second as one (P. J. Huber,
Robust Statistics, 1981, 6.3), and are stated for all clocks at once.

What no frame can tell: a robot whose stamps are all later than the others' by as much looks like one whose
clock is ahead. So the parameters say how unlike robots are, and only that no frame is heard before it was
handed over bounds that; see Fit.surely_within.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observation.field_trial.clocks.equations import AlignmentParameters, Floats, System
from observation.field_trial.clocks.frame_stamps import Pairs, Stamp, StampedFrame, StampKind, pairs_of
from observation.field_trial.clocks.graph import Tree, spanning_trees
from observation.field_trial.clocks.student_t import quantile


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
    system = System(pairs, trees, origins, parameters)
    estimate, noise = system.solve()
    variance = system.variance(estimate, noise)
    limits = _limits(frames, trees, origins, estimate)
    free = sum(tree.parent is not None for tree in trees)
    tail = (1 - parameters.confidence) / (4 * max(free, 1))  # two sides, two ends of each clock's time
    fits = []
    for clock, tree in enumerate(trees):
        touched = (pairs.first[:, 0] == clock) | (pairs.second[:, 0] == clock)
        blocks = len(np.unique(system.blocks[touched]))
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
