"""What a node counts while it runs."""

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from deeco.instant import Duration, Instant, milliseconds

_BIN: Final = milliseconds(50)


@dataclass
class NodeCounters:
    """Everything that a node has done, dropped or refused."""

    activations: int = 0
    """Runs of a process."""
    commits: int = 0
    """Of these, runs that changed the knowledge."""
    skipped: int = 0
    """Runs left out while the node did not step."""
    memberships: int = 0
    """Evaluations of a membership condition."""
    published: int = 0
    """Packets with the own components' knowledge."""
    frames: int = 0
    """Frames handed to the link."""
    packets: int = 0
    """Packets heard whole."""
    packets_junk: int = 0
    """Packets heard whole that do not hold knowledge."""
    packets_own: int = 0
    """Own knowledge that came back."""
    packets_old: int = 0
    """Knowledge no newer than what was known."""
    roles_unknown: int = 0
    """Roles in packets that nobody here asks for, or that have another form here."""
    relayed: int = 0
    relays_cancelled: int = 0
    """Not relayed, because another node did or newer knowledge came."""
    relays_refused: int = 0
    """Not relayed, because the queue was full."""
    replicas_forgotten: int = 0
    """Too old."""
    replicas_evicted: int = 0
    """Too many."""


@dataclass
class Statistics:
    """Counters of a node, of its ensembles, and the ages of what it knew."""

    counters: NodeCounters = field(default_factory=NodeCounters)
    exchanges: Counter[str] = field(default_factory=Counter)
    """By ensemble: exchanges that changed a local component."""
    ages: Counter[int] = field(default_factory=Counter)
    """How long ago each replica had been heard at each own publication: count by the bin's upper end, ms."""

    def sample_age(self, heard: Instant, now: Instant) -> None:
        """Count the age of one replica."""
        age: Duration = Duration(now - heard)
        self.ages[(age // _BIN + 1) * _BIN // 1000] += 1

    def outcome(self) -> dict[str, dict[Any, int]]:
        """Return all counts in a fixed order: `counters`, `exchanges`, `replica_age_ms`."""
        return {
            "counters": asdict(self.counters),
            "exchanges": dict(sorted(self.exchanges.items())),
            "replica_age_ms": dict(sorted(self.ages.items())),
        }
