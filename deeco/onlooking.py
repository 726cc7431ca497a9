"""Looking on: telling somebody outside what nodes do, for debugging; no node depends on whether one does."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, Protocol

from deeco.instant import Instant
from deeco.knowledge import Knowledge
from deeco.local import Commit
from deeco.replication.replicas import Replica


class Onlooker(Protocol):
    """Who is told; what it is given are values, and it must change nothing."""

    def deployed(self, component: Knowledge, now: Instant) -> None:
        """A component begins with this knowledge; also if its node is made anew."""

    def committed(self, commit: Commit, replica: Replica | None) -> None:
        """A component has other knowledge now. `replica`: of the peer that an ensemble used; None for a
        process, and for a peer on the same node."""

    def heard(self, component: str, replica: Replica, now: Instant) -> None:
        """From `now` on the node of this component has a newer replica of another one."""


_PRESENT: Final[ContextVar[Onlooker | None]] = ContextVar("onlooker", default=None)


def onlooker() -> Onlooker | None:
    """Who looks on at nodes that are made now; None, as in every run: nobody."""
    return _PRESENT.get()


@contextmanager
def looking_on(who: Onlooker) -> Iterator[None]:
    """Nodes that are made meanwhile, in this thread, tell `who` what they do."""
    token = _PRESENT.set(who)
    try:
        yield
    finally:
        _PRESENT.reset(token)
