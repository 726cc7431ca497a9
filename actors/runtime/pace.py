"""Holds simulated time back to a multiple of real time."""

import time

from actors.instant import Instant, in_seconds


class Pace:
    """Since the origin simulated time has never passed more than `speed` times as fast as real time.

    A run that is late does not wait, and so goes faster than that until it has caught up.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._origin: float | None = None

    def hold(self, instant: Instant) -> None:
        """Return when `instant` is due; the first call sets the origin."""
        now = time.monotonic()
        due = in_seconds(instant) / self._speed
        if self._origin is None:
            self._origin = now - due
        elif self._origin + due > now:
            time.sleep(self._origin + due - now)

    def restart(self) -> None:
        """After a pause: the next instant sets the origin anew."""
        self._origin = None
