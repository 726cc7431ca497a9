"""Whether every message of a run arrived: what its senders count against what its receivers count."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from actors.messages import ROSTER
from actors.runtime.errors import AcrcError
from actors.runtime.process import FinalNote

PARENT = "its parent"


class UndeliveredError(AcrcError):
    """Messages that were lost on the way, or that somebody is wrong about."""


class Gap(NamedTuple):
    """A key on which not as many messages arrived as were sent."""

    key: str
    sent: int
    senders: tuple[str, ...]
    arrived: int
    receivers: tuple[str, ...]

    def __str__(self) -> str:
        senders = " and ".join(self.senders) or "nobody"
        receivers = " and ".join(self.receivers) or "nobody"
        return f"{self.key}: {senders} counted {self.sent} sent, and {receivers} {self.arrived} that arrived"


def gaps(finals: Sequence[tuple[str, FinalNote]], rosters: int) -> tuple[Gap, ...]:
    """The keys whose counts do not agree, in their order.

    `finals`: each process's actor, and its last note. `rosters`: how many of the world's orders to start
    robots their parent has received. Raises UndeliveredError if a process counts what is not its own.
    """
    sent, arrived = Counter[str](), Counter({ROSTER.pattern: rosters})
    senders, receivers = defaultdict[str, dict[str, None]](dict), defaultdict[str, dict[str, None]](dict)
    receivers[ROSTER.pattern][PARENT] = None
    for actor, final in finals:
        _check_own(actor, final)
        sent.update(final.sent)
        arrived.update(final.arrived)
        for keys, actors in ((final.sent, senders), (final.arrived, receivers)):
            for key in keys:
                actors[key][actor] = None
    return tuple(
        Gap(key, sent[key], tuple(senders[key]), arrived[key], tuple(receivers[key]))
        for key in sorted(sent.keys() | arrived.keys())
        if sent[key] != arrived[key]
    )


def demand_all(undelivered: int, sentences: Sequence[str]) -> None:
    """UndeliveredError if there are messages that were not delivered."""
    if undelivered:
        raise UndeliveredError(f"{undelivered} messages were not delivered: {'; '.join(sentences)}")


def _check_own(actor: str, final: FinalNote) -> None:
    """A robot sends on its own keys only, and the router sees to it; so must its word."""
    if actor in ("world", "radio"):
        return
    for key in _foreign({f"swarm/up/{actor}/": final.sent, f"swarm/down/{actor}/": final.arrived}):
        raise UndeliveredError(f"{actor} counts messages on {key[:80]!r}, which is not its own")


def _foreign(counts: Mapping[str, Mapping[str, int]]) -> Iterator[str]:
    for prefix, keys in counts.items():
        yield from (key for key in keys if not key.startswith(prefix))
