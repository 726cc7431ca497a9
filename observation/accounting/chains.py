"""Chains of robots that wait for one another, followed to their roots."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observation.accounting.waiting import NOBODY


class Roots(NamedTuple):
    """Where the chains of all robots end."""

    root: NDArray[np.int32]
    """(steps, robots): where its chain ends, itself if it waits for nobody; NOBODY: in a ring."""
    ring: NDArray[np.bool_]
    """(steps, robots): it is in a ring itself."""
    at_door: NDArray[np.bool_]
    """(steps, robots): its chain leads through a door, or up to one."""


def roots(before: NDArray[np.int32], at_door: NDArray[np.bool_]) -> Roots:
    """Both (steps, robots): `before`: for whom each waits, NOBODY: for none; `at_door`: it does so at one."""
    root = np.where(before == NOBODY, np.arange(before.shape[1], dtype=np.int32), np.int32(NOBODY))
    doors = at_door & (before != NOBODY)
    while True:
        rows, robots = np.nonzero(root == NOBODY)
        fronts = before[rows, robots]
        joined = root[rows, fronts] != NOBODY
        if not joined.any():
            break
        rows, robots, fronts = rows[joined], robots[joined], fronts[joined]
        root[rows, robots] = root[rows, fronts]
        doors[rows, robots] |= doors[rows, fronts]
    return Roots(root, _rings(root == NOBODY, before), doors)


def behind(marked: NDArray[np.bool_], before: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(steps, robots): those that are marked, and all whose chain leads to one of them."""
    whole = marked.copy()
    while True:
        rows, robots = np.nonzero(~whole & (before != NOBODY))
        joins = whole[rows, before[rows, robots]]
        if not joins.any():
            return whole
        whole[rows[joins], robots[joins]] = True


def _rings(left: NDArray[np.bool_], before: NDArray[np.int32]) -> NDArray[np.bool_]:
    """What is left once nobody waits for nobody: of chains into a ring the ring alone."""
    ring = left.copy()
    while True:
        rows, robots = np.nonzero(ring)
        awaited = np.zeros_like(ring)
        awaited[rows, before[rows, robots]] = True
        if (ring == (ring & awaited)).all():
            return ring
        ring &= awaited
