"""What a robot seems to be about, seen from outside, while its run goes on."""

from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from actors.observer.drawing.words import Occupation
from observation.accounting.episodes import STANDARD
from observation.evidence.recorded import Route
from observation.view.story import Track


class Seen:
    """One robot, piece by piece. It stands as the accounting has it, which is known only `pause_s` later."""

    def __init__(self, robot: str) -> None:
        self._robot = robot
        self._state = ""
        self._holds = True
        """There are places that it means to visit."""
        self._lately: deque[tuple[float, float, float]] = deque()
        """When, s, and where, m, it was seen in the last `pause_s`, while it acted."""
        self._acts = True
        """False: it is frozen or off, which others tell."""

    def of(self, track: Track, routes: Iterable[Route]) -> Iterator[Occupation]:
        """What it seems to be about, wherever that becomes another thing."""
        for route in routes:
            if route.robot == self._robot:
                self._holds = bool(route.places)
        acts = deque(track.acts)
        for second, (x, y, _) in zip(track.seconds.tolist(), track.poses.tolist(), strict=True):
            while acts and acts[0][0] <= second:
                self._acts, self._state = not acts.popleft()[1], ""
                self._lately.clear()
            if not self._acts:
                continue
            begin, stays = self._stays(second, x, y)
            state = "driving" if not stays else "standing" if self._holds else "idle"
            if state != self._state:
                self._state = state
                yield Occupation(begin if stays else second, state)

    def _stays(self, second: float, x: float, y: float) -> tuple[float, bool]:
        """Since when it is looked at, s, and whether it has stayed where it was then, for `pause_s`."""
        lately = self._lately
        lately.append((second, x, y))
        while len(lately) > 1 and second - lately[1][0] >= STANDARD.pause_s:
            lately.popleft()
        begin, *there = lately[0]
        near = all(np.hypot(one - there[0], other - there[1]) <= STANDARD.still for _, one, other in lately)
        return begin, near and second - begin >= STANDARD.pause_s
