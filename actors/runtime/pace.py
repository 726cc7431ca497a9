"""Holds simulated time back to a multiple of real time; and looks at something every so often."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

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


@contextmanager
def ticking(period_s: float, tick: Callable[[FrameType | None], None]) -> Iterator[None]:
    """Call `tick` in the main thread every `period_s`, between two instructions of whatever runs there.

    It is given the frame that it comes between, and may raise. Uses the interval timer, so there can
    be one of these at a time; a process that was stopped meanwhile gets one call, however long that lasted.
    """

    def ring(number: int, frame: FrameType | None) -> None:
        tick(frame)

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, period_s, period_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
