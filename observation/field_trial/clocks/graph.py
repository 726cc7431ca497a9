"""Which clocks have stamped frames in common, and about how far each is ahead: where an alignment begins."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Tree(NamedTuple):
    """One clock's place among those that frames connect."""

    root: int
    """The first clock of its group, against which the others are measured."""
    parent: int | None
    """The clock by which it is connected; None for a root."""
    ahead: int
    """What it shows more than the root, about, µs: the sum of medians along the way."""


def spanning_trees(clocks: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> tuple[Tree, ...]:
    """Connect all clocks that frames connect, over those pairs of clocks that have most of them (Prim).

    `first` and `second`: (n, 2), clock and instant in µs, of the same n frames.
    """
    medians, counts = _medians(clocks, first, second)
    trees: dict[int, Tree] = {}
    for root in range(clocks):
        if root in trees:
            continue
        trees[root] = Tree(root, None, 0)
        group = [root]
        while (edge := _best(group, trees, counts)) is not None:
            parent, clock = edge
            trees[clock] = Tree(root, parent, trees[parent].ahead + medians[clock, parent])
            group.append(clock)
    return tuple(trees[clock] for clock in range(clocks))


def _medians(
    clocks: int, first: NDArray[np.int64], second: NDArray[np.int64]
) -> tuple[dict[tuple[int, int], int], NDArray[np.int64]]:
    """By two clocks, the median of what the one shows more than the other; and how many frames they share."""
    medians: dict[tuple[int, int], int] = {}
    counts = np.zeros((clocks, clocks), dtype=np.int64)
    for one in range(clocks):
        for other in range(one):
            forth = (first[:, 0] == one) & (second[:, 0] == other)
            back = (first[:, 0] == other) & (second[:, 0] == one)
            more = np.concatenate((first[forth, 1] - second[forth, 1], second[back, 1] - first[back, 1]))
            if more.size:
                median = int(np.sort(more)[more.size // 2])
                medians[one, other], medians[other, one] = median, -median
                counts[one, other] = counts[other, one] = more.size
    return medians, counts


def _best(group: list[int], trees: dict[int, Tree], counts: NDArray[np.int64]) -> tuple[int, int] | None:
    """The pair with most frames of one clock in the group and one that is in none yet."""
    edges = [
        (int(counts[parent, clock]), parent, clock)
        for parent in group
        for clock in range(len(counts))
        if clock not in trees and counts[parent, clock]
    ]
    if not edges:
        return None
    _, parent, clock = max(edges, key=lambda edge: (edge[0], -edge[1], -edge[2]))
    return parent, clock
