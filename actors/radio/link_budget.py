"""How far a frame gets, and how many pairs of robots can hear each other directly."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from actors.ieee802154 import PSDU_LIMIT
from actors.radio.medium.channel import Propagation
from actors.radio.medium.error_rate import frame_error_rate
from actors.radio.presets import RadioParameters
from actors.radio.propagation.path_loss import line_of_sight

_EVERY_US: Final = 1_000_000


def needed_dbm(parameters: RadioParameters, share: float = 0.5, octets: int = PSDU_LIMIT) -> float:
    """The received power, dBm, at which that share of frames of so many octets arrives undisturbed.

    By default of the longest frames, which get least far.
    """
    low, high = -30.0, 30.0
    for _ in range(60):
        middle = (low + high) / 2
        lost = float(frame_error_rate(np.array([middle]), octets)[0])
        low, high = (middle, high) if lost > 1.0 - share else (low, middle)
    phy = parameters.phy
    return max(phy.noise_dbm + max(high, phy.lock_sinr_db), parameters.transceiver.sensitivity_dbm)


def reach(parameters: RadioParameters, share: float = 0.5, octets: int = PSDU_LIMIT) -> float:
    """The distance, m, in line of sight and without shadowing, over which that share of frames arrives."""
    budget_db = parameters.transceiver.tx_power_dbm - needed_dbm(parameters, share, octets)
    return line_of_sight(budget_db, parameters.propagation.path_loss)


class DirectReach:
    """Counts, once a second, the pairs of robots that hear at least half of each other's longest frames."""

    def __init__(self, parameters: RadioParameters, propagation: Propagation) -> None:
        self._greatest_loss_db = parameters.transceiver.tx_power_dbm - needed_dbm(parameters)
        self._propagation = propagation
        self._next = 0
        self._pairs = self._in_reach = 0

    def due(self, instant_us: int) -> bool:
        """True once for each second that has begun."""
        return instant_us >= self._next

    def see(self, instant_us: int, places: NDArray[np.float64]) -> None:
        """Count the pairs of robots at these places, (n, 2) m; only of robots whose transceivers are on."""
        self._next = (instant_us // _EVERY_US + 1) * _EVERY_US
        loss = self._propagation.loss_db(places, places, self._greatest_loss_db)
        one, other = np.triu_indices(len(places), 1)
        self._pairs += one.size
        self._in_reach += int(np.count_nonzero(loss[one, other] <= self._greatest_loss_db))

    def counters(self) -> dict[str, int]:
        """`pairs`: all pairs seen, one a second each; `pairs_in_reach`: those that can hear each other."""
        return {"pairs": self._pairs, "pairs_in_reach": self._in_reach}


def share(counters: dict[str, int]) -> float | None:
    """The share of pairs in direct reach, by `DirectReach.counters`; None if there was never a pair."""
    pairs = counters["pairs"]
    return round(counters["pairs_in_reach"] / pairs, 4) if pairs else None
