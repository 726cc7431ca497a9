"""A node's side of the link: publishes its components, keeps replicas of the others', relays.

Bytes from the link are untrusted: whatever comes in, the worst that happens is that a counter grows.

Relaying lets nodes act as proxies for others that are out of reach.
Whoever hears a packet for the first time waits, the longer the stronger it came in, for the far ones carry it
farther; who hears it again meanwhile leaves it at that. (JDEECo's L2 RebroadcastStrategy does so; there only
nodes farther than some 10 m relay at all, as here only those that hear it weakly enough, if so asked.)
"""

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Any, Final, NamedTuple

from deeco.ensemble import Contact
from deeco.fragments import Fragmenter, Reassembly
from deeco.instant import START, Duration, Instant, Task, milliseconds, seconds
from deeco.knowledge import Knowledge, made
from deeco.link import LinkParameters, Reception, Transmission
from deeco.packet import KnowledgePacket, Unpacker, Version, pack, relayed
from deeco.schema import RoleBook
from deeco.statistics import NodeCounters, Statistics


class Replica:
    """One component of another node, as it last published itself."""

    def __init__(
        self, component: str, version: Version, roles: tuple[Knowledge, ...], contact: Contact
    ) -> None:
        self.id = component
        self.version = version
        self.roles = roles
        self.heard = contact.heard
        self._contact = contact
        self._by_kind: dict[type[Knowledge], Knowledge | None] = {}

    def role(self, kind: type[Knowledge]) -> Any:
        """Its knowledge in that role; None if it does not play it, as far as is known here."""
        try:
            return self._by_kind[kind]
        except KeyError:
            found = next((one for one in self.roles if isinstance(one, kind)), None)
            return self._by_kind.setdefault(kind, found)

    def contact(self, now: Instant) -> Contact:
        """How this knowledge came here."""
        return self._contact


class Replicas:
    """At most so many replicas, in the order of their ids; what grows old is dropped."""

    def __init__(self, most: int, forget_after: Duration, counters: NodeCounters) -> None:
        self._most = most
        self._forget_after = forget_after
        self._counters = counters
        self._by_id: dict[str, Replica] = {}
        self._versions: dict[str, Version] = {}
        self._oldest = START
        """No replica was heard before it, so that not every step has to ask every one."""

    def __iter__(self) -> Iterator[Replica]:
        return iter(self._by_id.values())

    def __len__(self) -> int:
        return len(self._by_id)

    def get(self, component: str) -> Replica | None:
        """The replica of a component."""
        return self._by_id.get(component)

    def is_news(self, component: str, version: Version) -> bool:
        """True if no version so new has been heard of; dropping a replica does not forget its version."""
        known = self._versions.get(component)
        return known is None or version > known

    def put(self, replica: Replica) -> None:
        """Take in a newer version than any known."""
        self._versions.pop(replica.id, None)
        self._versions[replica.id] = replica.version
        if len(self._versions) > 4 * self._most:
            del self._versions[next(iter(self._versions))]
        fresh = replica.id not in self._by_id
        if fresh and len(self._by_id) >= self._most:
            self._counters.replicas_evicted += 1
            del self._by_id[min(self._by_id.values(), key=lambda one: (one.heard, one.id)).id]
        self._by_id[replica.id] = replica
        self._oldest = min(self._oldest, replica.heard)
        if fresh:
            self._by_id = dict(sorted(self._by_id.items()))

    def forget(self, now: Instant) -> None:
        """Drop what has not been heard for too long."""
        if now - self._oldest <= self._forget_after:
            return
        old = [one.id for one in self if now - one.heard > self._forget_after]
        for component in old:
            del self._by_id[component]
        self._oldest = min((one.heard for one in self), default=now)
        self._counters.replicas_forgotten += len(old)


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


_EPOCH_STRIDE: Final = 0x9E37
"""Between the first packet's numbers of two epochs, so that no peer takes what is left of a packet of the one
before for a part of this one's. Odd, and 2^16 by the golden ratio: any two epochs lie apart."""


@dataclass(frozen=True)
class NetworkParameters:
    """How a node publishes, remembers and relays."""

    publish_every: Duration = field(default=seconds(1))
    """Period of publishing the own components' roles, whole. Default: JDEECo, DefaultKnowledgePublisher."""
    forget_after: Duration = field(default=seconds(30))
    """A replica that has not been heard of for so long is dropped."""
    most_replicas: int = 256
    """More are not kept; the one heard longest ago goes first."""
    relay: RelayParameters | None = None
    """None: nothing is relayed."""
    link: LinkParameters = field(default_factory=LinkParameters)


class News(NamedTuple):
    """A replica that is new or has changed."""

    before: Replica | None
    after: Replica


class Network:
    """Turns frames into replicas, and knowledge into frames."""

    def __init__(
        self,
        parameters: NetworkParameters,
        book: RoleBook,
        *,
        own: frozenset[str],
        plan: Callable[[Task, Instant], None],
        passes: Callable[[Replica], bool],
        address: int,
        epoch: int,
        statistics: Statistics,
        former: "Network | None" = None,
    ) -> None:
        """Continue the numbering and the reassembly of the network `former`.

        `own`: ids of the node's components. `plan`: have a task done at an instant. `passes`: True if the
        knowledge of a sender may be relayed.
        """
        self._book = book
        self._own = own
        self._passes = passes
        self._epoch = epoch
        self._limits = parameters.link
        self._statistics = statistics
        self._counters = statistics.counters
        self._unpacker = Unpacker(parameters.link, known=book.fingerprints)
        self._publications = 0
        self._reassembly = Reassembly(parameters.link)
        self._fragmenter = Fragmenter(address & 0xFF, parameters.link, first=epoch * _EPOCH_STRIDE)
        if former is not None:
            self._publications = former._publications
            self._reassembly = former._reassembly
            self._fragmenter = former._fragmenter
        self._outbox: list[tuple[Instant, bytes]] = []
        self.replicas = Replicas(parameters.most_replicas, parameters.forget_after, self._counters)
        self._relay: Relay | None = None
        if parameters.relay is not None:
            self._relay = Relay(parameters.relay, address, plan, self._send, self._counters)

    def publish(self, now: Instant, knowledge: Sequence[Knowledge]) -> None:
        """Send the roles of the own components; sample the age of what is known of others."""
        for value in knowledge:
            self._publications += 1
            version = Version(self._epoch, self._publications)
            self._counters.published += 1
            self._send(now, pack(KnowledgePacket(value.id, version, 0, self._book.pack(value)), self._limits))
        for replica in self.replicas:
            self._statistics.sample_age(replica.heard, now)

    def take(self, reception: Reception) -> list[News]:
        """What a frame from the link brings, once it completes a packet."""
        whole = self._reassembly.take(reception.instant, reception.sender, reception.data)
        found: list[News] = []
        for data in whole:
            if news := self._open(data, reception):
                found += (news,)
        return found

    def transmissions(self) -> list[Transmission]:
        """The frames of everything sent since the last call; what is sent at one instant shares frames."""
        if not self._outbox:
            return []
        sent: list[Transmission] = []
        for instant, group in groupby(self._outbox, key=lambda item: item[0]):
            frames = self._fragmenter.frames([data for _, data in group])
            sent += [made(Transmission, (instant, frame)) for frame in frames]
        self._outbox = []
        self._counters.frames += len(sent)
        return sent

    def clear(self) -> None:
        """Relay nothing of what waits for it."""
        if self._relay is not None:
            self._relay.clear()

    def counters(self) -> dict[str, int]:
        """What the reassembly has counted."""
        return self._reassembly.counters()

    def _send(self, now: Instant, data: bytes) -> None:
        self._outbox += ((now, data),)

    def _open(self, data: bytes, reception: Reception) -> News | None:
        counters, relay = self._counters, self._relay
        counters.packets += 1
        packet = self._unpacker.unpack(data)
        if packet is None:
            counters.packets_junk += 1
            return None
        component = packet.component
        if component in self._own:
            counters.packets_own += 1
            return None
        if relay is not None:
            relay.heard(packet)
        if not self.replicas.is_news(component, packet.version):
            counters.packets_old += 1
            return None
        unpacked = self._book.unpack(component, packet.roles)
        if unpacked is None:
            counters.packets_junk += 1
            return None
        roles, unknown = unpacked
        counters.roles_unknown += unknown
        rssi_dbm = reception.rssi_dbm
        contact = made(Contact, (reception.instant, rssi_dbm, packet.hops))
        replica = Replica(component, packet.version, roles, contact)
        news = made(News, (self.replicas.get(component), replica))
        self.replicas.put(replica)
        if relay is not None and relay.wants(packet, rssi_dbm) and self._passes(replica):
            relay.take(packet, data, reception.instant, rssi_dbm)
        return news
