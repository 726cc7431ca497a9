"""When something periodic is due."""

from actors.instant import Duration, Instant


class Rhythm:
    """The instants `phase` + whole multiples of `period`, µs, given out once each as time goes on."""

    def __init__(self, period: Duration, phase: int = 0) -> None:
        self._period = period
        self._phase = phase
        self._next: int | None = None

    def due(self, begin: Instant, end: Instant) -> list[Instant]:
        """The instants before `end`; one that was missed by less than a period comes at `begin`.

        Older ones are left out: a robot that was frozen does not catch up.
        """
        if self._next is None or begin - self._next >= self._period:
            self._next = begin + (self._phase - begin) % self._period
        instants = []
        while self._next < end:
            instants.append(Instant(max(begin, self._next)))
            self._next += self._period
        return instants
