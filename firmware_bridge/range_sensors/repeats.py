"""Whether a range sensor repeats itself: raw data that are the same twice, to the last bit.

A sensor that measures has noise in its last bits, also where nothing moves. What it sends twice was not
measured the second time, whoever repeats it: the sensor, its driver, or whatever is between.
"""

from collections import deque
from typing import Final

import numpy as np
from numpy.typing import NDArray

_BEAMS: Final = 360
"""Directions that are told apart."""
_TURNS: Final = 4
"""A beam that said the same so often on end after the first time stands still; own choice, a coarse sensor
repeats one in three: one beam in eighty by chance."""
_STILL: Final = 0.3
"""Share of the beams with an echo; own choice, far above what chance does."""
_FEWEST: Final = 30
"""Beams with an echo, below which nothing is said."""


class Repeats:
    """Remembers the last parts of a sensor's data, and says when they come again."""

    def __init__(self, kept: int, window: int, most: int) -> None:
        """`kept`: parts that are remembered; `most` of the last `window` parts repeated are too many."""
        self._order: deque[bytes] = deque(maxlen=kept)
        self._known: set[bytes] = set()
        self._repeated: deque[bool] = deque(maxlen=window)
        self._most = most

    @property
    def found(self) -> bool:
        """True while the sensor repeats itself."""
        return self._repeated.count(True) >= self._most

    def take(self, part: bytes) -> None:
        """Take in a part that is large enough never to be the same by chance."""
        again = part in self._known
        self._repeated.append(again)
        if again:
            return  # it is remembered already
        if len(self._order) == self._order.maxlen:
            self._known.discard(self._order[0])
        self._order.append(part)
        self._known.add(part)

    def forget(self) -> None:
        """Begin anew."""
        self._order.clear()
        self._known.clear()
        self._repeated.clear()


class StillBeams:
    """Remembers what each direction said last, and for how many turns it has said the same."""

    def __init__(self) -> None:
        self._last: NDArray[np.int64] = np.zeros(_BEAMS, np.int64)
        self._same: NDArray[np.int64] = np.zeros(_BEAMS, np.int64)
        self.found = False
        """True while a part of the turn stands still."""

    def take(self, angles: NDArray[np.float64], distances: NDArray[np.int64]) -> None:
        """A turn: (n,) rad, (n,) in the sensor's own unit, 0 = no echo."""
        beams = np.floor(angles % (2 * np.pi) * (_BEAMS / (2 * np.pi)) + 0.5).astype(np.int64) % _BEAMS
        now = np.zeros(_BEAMS, np.int64)
        now[beams] = distances
        echo = now > 0
        self._same = np.where(echo & (now == self._last), self._same + 1, 0)
        self._last = now
        seen = int(np.count_nonzero(echo))
        self.found = seen >= _FEWEST and np.count_nonzero(self._same >= _TURNS) >= _STILL * seen
