"""Passing on what was heard, so that nodes act as proxies for others that are out of reach.

Whoever hears a packet for the first time waits, the longer the stronger it came in, for the far ones carry it
farther; who hears it again meanwhile leaves it at that. (JDEECo's L2 RebroadcastStrategy does so; there only
nodes farther than some 10 m relay at all, as here only those that hear it weakly enough, if so asked.)
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from deeco.instant import Duration, Instant, milliseconds, seconds
from deeco.replacing import made
from deeco.replication.packet import KnowledgePacket, Version, relayed
from deeco.statistics import NodeCounters


@dataclass(frozen=True)
class RelayParameters:
    """When and how far packets are relayed."""

    hop_limit: int = 3
    """A packet is relayed at most so often on its way, 1 to 15. Default: three times the radio's range spans
    the shipped corridor."""
    longest: Duration = field(default=seconds(1))
    """Wait at the strongest signal. Default: that of JDEECo 2 (gossip.rebroadcast.delay, 1000 ms)."""
    spread: Duration = field(default=milliseconds(500))
    """Two nodes that hear a packet equally well wait differently by up to so long. Default: five steps of
    100 ms; only at a step's start does a node learn that another one has relayed meanwhile."""
    weakest_dbm: float = -95.0
    """At this strength and below there is no wait, dBm. Default: the sensitivity of the MRF24J40 (Microchip
    DS39776C)."""
    strongest_dbm: float = -45.0
    """At this strength and above the wait is the longest, dBm. Default: about what arrives over 1 m at the
    original testbed's transmit power in dBm less the path loss of 40 dB, rounded up for stronger senders."""
    relay_below_dbm: float | None = None
    """Who hears a packet more strongly than this, dBm, is too near to its sender to reach many others, and
    does not relay it; of unknown strength it is relayed. This is distance-based suppression: Ni, Tseng, Chen,
    Sheu, The broadcast storm problem in a mobile ad hoc network, MobiCom 1999. Default: None, everybody
    relays; what is near depends on the link."""
    waiting: int = 64
    """Packets that may wait at once, with those that were cancelled while they waited."""

    def delay(self, rssi_dbm: float | None, chance: float) -> Duration:
        """How long to wait; `chance` in [0, 1) chooses within the spread. Of unknown strength: medium."""
        span = self.strongest_dbm - self.weakest_dbm
        strength = 0.5 if rssi_dbm is None else (rssi_dbm - self.weakest_dbm) / span
        return Duration(round(min(max(strength, 0.0), 1.0) * self.longest + chance * self.spread))


class _Waiting(NamedTuple):
    version: Version
    data: bytes


class Relay:
    """Packets that wait to be relayed, at most one for each component."""

    def __init__(
        self,
        parameters: RelayParameters,
        address: int,
        plan: Callable[[Callable[[Instant], None], Instant], None],
        send: Callable[[Instant, bytes], None],
        counters: NodeCounters,
    ) -> None:
        """`plan` has a task done at an instant; `send` hands a packet to the link."""
        self._p = parameters
        self._address = address
        self._plan = plan
        self._send = send
        self._counters = counters
        self._waiting: dict[str, _Waiting] = {}
        self._planned = 0
        """Instants that are planned, also for what was cancelled since."""

    def heard(self, packet: KnowledgePacket) -> None:
        """Somebody has sent this, too: what waits and is no newer need not be relayed."""
        waiting = self._waiting.get(packet.component)
        if waiting is not None and waiting.version <= packet.version:
            del self._waiting[packet.component]
            self._counters.relays_cancelled += 1

    def wants(self, packet: KnowledgePacket, rssi_dbm: float | None) -> bool:
        """False of news that has come far enough, or from too near."""
        below = self._p.relay_below_dbm
        near = below is not None and rssi_dbm is not None and rssi_dbm > below
        return not near and packet.hops < self._p.hop_limit

    def take(self, packet: KnowledgePacket, data: bytes, heard: Instant, rssi_dbm: float | None) -> None:
        """Relay news that is wanted."""
        if self._planned >= self._p.waiting:
            self._counters.relays_refused += 1
            return
        waiting = self._waiting[packet.component] = made(_Waiting, (packet.version, relayed(data)))
        at = Instant(heard + self._p.delay(rssi_dbm, self._chance(packet)))

        def due(now: Instant) -> None:
            self._planned -= 1
            if self._waiting.get(packet.component) is waiting:
                del self._waiting[packet.component]
                self._counters.relayed += 1
                self._send(now, waiting.data)

        self._planned += 1
        self._plan(due, at)

    def clear(self) -> None:
        """Relay nothing of what waits: it is too late for it, and what was planned is not done."""
        self._counters.relays_cancelled += len(self._waiting)
        self._waiting.clear()
        self._planned = 0

    def _chance(self, packet: KnowledgePacket) -> float:
        """In [0, 1): by node and packet only, so that no other draw changes it."""
        name = f"{self._address}/{packet.component}/{packet.version.epoch}/{packet.version.counter}"
        return zlib.crc32(name.encode("utf-8", "surrogatepass")) / 2**32
