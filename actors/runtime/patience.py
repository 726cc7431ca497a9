"""Ends a process that waits in vain: 30 s without an advance, and the wait is named."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from actors.runtime.errors import AcrcError
from actors.runtime.shell import Shell


class SilenceError(AcrcError):
    """Nothing arrived for so long that something must be wrong."""


@contextmanager
def patience(
    shell: Shell, limit_s: float, describe: Callable[[], str], excused: Callable[[], bool]
) -> Iterator[None]:
    """Raise SilenceError with `describe()` in the main thread once `shell` has not advanced for `limit_s`.

    Uses the process's interval timer, so there can be one of these at a time. `excused` is true while waiting
    without limit is right, as in a pause.
    """
    ticks_allowed = max(1, round(limit_s))
    tick_s = limit_s / ticks_allowed
    state = {"advances": -1, "ticks": 0}

    def tick(number: int, frame: FrameType | None) -> None:
        if excused() or shell.advances != state["advances"]:
            state.update(advances=shell.advances, ticks=0)
            return
        state["ticks"] += 1
        if state["ticks"] >= ticks_allowed:
            raise SilenceError(f"{describe()} for {limit_s:g} s")

    before = signal.signal(signal.SIGALRM, tick)
    signal.setitimer(signal.ITIMER_REAL, tick_s, tick_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
