"""What a robot seems to be about, seen from outside, at once: a run that goes on has no later steps to ask.

Of a finished run `observation.evidence.spells` judges better, as it looks at what came before and after.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from actors.observer.drawing.words import Spell
from observation.evidence.said_places import Route
from observation.view.story import Track

_STANDS: Final = 0.02
"""A robot that is slower stands, m/s."""


class Seen:
    """One robot, piece by piece."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._state = ""
        self._holds = True
        """There are places that it means to visit."""
        self._last: tuple[float, float, float] | None = None
        """When, s, and where, m, it was seen last, if it acted then."""
        self._acts = True
        """False: it is frozen or off, which others tell."""

    def of(self, track: Track, routes: Iterable[Route]) -> Iterator[Spell]:
        """What it seems to be about, wherever that becomes another thing."""
        for route in routes:
            if route.robot == self._robot:
                self._holds = bool(route.places)
        acts = deque(track.acts)
        for second, (x, y, _) in zip(track.seconds.tolist(), track.poses.tolist(), strict=True):
            while acts and acts[0][0] <= second:
                self._acts = not acts.popleft()[1]
            before, self._last = self._last, (second, x, y) if self._acts else None
            if before is None or self._last is None or second <= before[0]:
                continue
            speed = np.hypot(x - before[1], y - before[2]) / (second - before[0])
            state = "driving" if speed > _STANDS else "standing" if self._holds else "idle"
            if state != self._state:
                self._state = state
                yield Spell(before[0], state)
