"""What the medium asks of the channel: how much power arrives, and which other sources disturb.

The medium knows frames, transceivers and instants; walls, distances and shadowing belong to a `Propagation`,
Wi-Fi and jammers to an `Interferer`. Positions are (…, 2) arrays, m, map frame. Everything here is a function
of its arguments and of a seed given at construction, never of how often or in which order it is asked.
"""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Trajectory = Callable[[int], NDArray[np.float64]]
"""Positions of all transceivers, (n, 2), m, at an instant, ns; each depends on the instant alone."""


class Propagation(Protocol):
    """How much weaker a signal arrives than it was sent."""

    def loss_db(
        self, senders: NDArray[np.float64], receivers: NDArray[np.float64], most_db: float = math.inf
    ) -> NDArray[np.float64]:
        """Loss from each sender to each receiver, dB ≥ 0, `inf` = nothing arrives: (senders, receivers).

        Where it is above `most_db` any value above will do, so that far ones need not be computed.

        `senders` (s, 2), `receivers` (r, 2). Asked once per frame, with one sender, for the positions at its
        first symbol, or once per sender while all stand still: entry (i, j) must depend on these two points
        only, to the last bit. Where a sender is its own receiver any value will do.
        """
        ...


class Interferer(Protocol):
    """A source that is no 802.15.4 transceiver: it disturbs while it is on and is never decoded."""

    def bursts(self, since_ns: int, until_ns: int) -> NDArray[np.int64]:
        """The bursts that begin in [since, until): (bursts, 2), begin and end, ns; in order, without overlap.

        An end may lie beyond `until`. How the time is cut into such windows must not change the bursts.
        """
        ...

    def power_dbm(self, receivers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Power within the receiver's band while the source is on, dBm: `receivers` (…, 2) → (…).

        `-inf` = nothing arrives. Evaluated at a burst's first instant, and again every 20 ms of a longer one.
        """
        ...

    def over(self, now_ns: int) -> bool:
        """True if no burst begins or goes on at `now_ns` or later."""
        ...
