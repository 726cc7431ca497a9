"""Something to be looked at every so often while the main thread waits or works."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


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
