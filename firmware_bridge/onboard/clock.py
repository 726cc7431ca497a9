"""The time of an actor on hardware: the wall clock's at the start, and monotonic from then on."""

import time

from actors.instant import Instant


class Clock:
    """Microseconds since the Unix epoch that never go back, whatever becomes of the machine's clock."""

    def __init__(self) -> None:
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> Instant:
        """The instant that it is."""
        return Instant((time.monotonic_ns() + self._ahead_ns) // 1000)

    def seconds_until(self, instant: Instant | None) -> float:
        """How long it is until then, s, at least 0; a second if there is no instant."""
        return 1.0 if instant is None else max(0.0, (instant - self.now()) / 1e6)
