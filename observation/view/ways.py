"""Where robots were, as far as it is known by now: grows with a run, and can be asked between its steps."""

from typing import Final

import numpy as np

from observation.view.story import Floats

_FIRST: Final = 64
"""Points that there is room for at first; then twice as many, and so on."""


class Way:
    """One robot's way."""

    def __init__(self) -> None:
        self._points: Floats = np.zeros((_FIRST, 3))
        self._count = 0

    def extend(self, seconds: Floats, poses: Floats) -> None:
        """Go on: (n,) s, later than all before, and (n, 2 or more): x and y, m; what is NaN is left out."""
        known = np.isfinite(poses[:, 0])
        new = np.column_stack((seconds[known], poses[known, :2]))
        while self._count + len(new) > len(self._points):
            self._points = np.concatenate((self._points, np.zeros_like(self._points)))
        self._points[self._count : self._count + len(new)] = new
        self._count += len(new)

    def at(self, seconds: Floats) -> Floats:
        """(n, 2) m, between two known points in proportion; NaN where none is known."""
        known = self._points[: self._count]
        if not self._count:
            return np.full((len(seconds), 2), np.nan)
        return np.column_stack([np.interp(seconds, known[:, 0], known[:, axis]) for axis in (1, 2)])
