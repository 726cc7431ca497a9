"""How likely it is that the robot is not where its estimate says."""

import math
from typing import Final, NamedTuple


class _Shares(NamedTuple):
    """A beta distribution of the share of the beams that pass a wall, of those that agree or pass one."""

    passing: float
    agreeing: float


_TRACKING: Final = _Shares(0.05, 8.0)
"""From the right pose: a beam that grazes a corner, now and then. Own fit, as is the next: courses of
`acrc verify localisation` with 0 to 10 others, at 58° and 360°, on three maps."""
_LOST: Final = _Shares(0.5, 1.2)
"""From a wrong pose: anything, but in the mean a third."""
_HAZARD: Final = 1e-4
"""Per scan: that a robot which was not lost is now; own choice, as all below."""
_RETURN: Final = 2e-3
"""Per scan: that one which was lost is not any more."""
_LEAST: Final = 1e-6
_MOST: Final = 0.999
"""No number of scans makes either certain."""


def odds_of_lost(agreeing: int, beyond: int) -> float:
    """By what a scan with so many beams changes the odds: the likelihoods' ratio, beta-binomial each.

    The root of it, as a scan says much the same as the one before.
    """
    ratio = 1.0
    for i in range(beyond):
        ratio *= (_LOST.passing + i) / (_TRACKING.passing + i)
    for i in range(agreeing):
        ratio *= (_LOST.agreeing + i) / (_TRACKING.agreeing + i)
    for i in range(beyond + agreeing):
        ratio *= (_TRACKING.passing + _TRACKING.agreeing + i) / (_LOST.passing + _LOST.agreeing + i)
    return math.sqrt(ratio)


class LostProbability:
    """The probability, scan by scan, by a hidden Markov model (Rabiner, Proc. IEEE 77(2), 1989)."""

    def __init__(self, probability: float = _LEAST) -> None:
        self.probability = min(max(probability, _LEAST), _MOST)

    def take(self, agreeing: int, beyond: int) -> None:
        """One more scan, seen from where the robot would be: beams that agree, and that pass a wall."""
        before = self.probability * (1 - _RETURN) + (1 - self.probability) * _HAZARD
        odds = before / (1 - before) * odds_of_lost(agreeing, beyond)
        self.probability = min(max(odds / (1 + odds), _LEAST), _MOST)
