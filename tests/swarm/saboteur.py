"""Behaviours that go wrong on purpose, by entry string."""

import time

from actors.instant import Instant, seconds
from actors.robot.ports import Behaviour, Decision, Start, View
from cleaning.baseline import behaviour as baseline

WHEN = seconds(2)


class Raises:
    """Follows the baseline for two seconds, then has a bug, if it is r2."""

    def __init__(self, start: Start) -> None:
        self._guilty = start.robot == "r2"
        self._inner = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline, for a while."""
        if self._guilty and view.instant >= WHEN:
            raise ZeroDivisionError("my strategy divides by the number of its friends")
        return self._inner.advance(view, until)


class Hangs(Raises):
    """The same, but it never answers."""

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline, for a while."""
        while self._guilty and view.instant >= WHEN:
            time.sleep(1)
        return self._inner.advance(view, until)


def raises(start: Start) -> Behaviour:
    """Entry `tests.swarm.saboteur:raises`."""
    return Raises(start)


def hangs(start: Start) -> Behaviour:
    """Entry `tests.swarm.saboteur:hangs`."""
    return Hangs(start)
