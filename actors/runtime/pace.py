"""Holds simulated time back to a multiple of real time."""

import time

from actors.instant import Instant, in_seconds


class Pace:
    """Simulated time passes at most `speed` times as fast as real time; a run that is late does not wait."""

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
