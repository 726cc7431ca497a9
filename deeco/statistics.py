"""Counters of a node."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from deeco.instant import Instant, milliseconds

_BIN: Final = milliseconds(50)


@dataclass
class NodeCounters:
    """Counts of activations, packets, replicas and relays."""

    activations: int = 0
    """Executions of processes."""
    commits: int = 0
    """Executions of processes that changed the knowledge."""
    skipped: int = 0
    """Executions left out while the node was not stepped."""
    memberships: int = 0
    """Evaluations of membership conditions."""
    published: int = 0
    """Packets sent with knowledge of the node's own components."""
    frames: int = 0
    """Frames given to the link."""
    packets: int = 0
    """Complete packets received."""
    packets_junk: int = 0
    """Complete packets received without valid knowledge."""
    packets_forged: int = 0
    """Complete packets received without the tag that the node's key requires."""
    packets_own: int = 0
    """Packets received with knowledge of the node's own components."""
    packets_old: int = 0
    """Packets received with knowledge no newer than the replica."""
    roles_unknown: int = 0
    """Roles in packets that this node does not use, or defines with other fields."""
    relayed: int = 0
    relays_cancelled: int = 0
    """Relays cancelled: another node relayed, or newer knowledge arrived."""
    relays_refused: int = 0
    """Relays refused: the queue was full."""
    replicas_forgotten: int = 0
    """Replicas dropped because of their age."""
    replicas_evicted: int = 0
    """Replicas dropped because there were too many."""


@dataclass
class Statistics:
    """Counters of a node and of its ensembles, and a histogram of replica ages."""

    counters: NodeCounters = field(default_factory=NodeCounters)
    exchanges: Counter[str] = field(default_factory=Counter)
    """Exchanges and ends of memberships that changed a local component, by ensemble."""
    ages: Counter[int] = field(default_factory=Counter)
    """Ages of all replicas at each publication: counts by upper bin edge, ms."""

    def sample_ages(self, heard: Iterable[Instant], now: Instant) -> None:
        """Count replicas in the histogram of ages."""
        self.ages.update([((now - one) // _BIN + 1) * _BIN // 1000 for one in heard])

    def outcome(self) -> dict[str, dict[Any, int]]:
        """Return all counts in a fixed order: `counters`, `exchanges`, `replica_age_ms`."""
        return {
            "counters": asdict(self.counters),
            "exchanges": dict(sorted(self.exchanges.items())),
            "replica_age_ms": dict(sorted(self.ages.items())),
        }
