"""A node's side of the link: publishes its components, keeps replicas of the others', relays.

Bytes from the link are untrusted: whatever comes in, the worst that happens is that a counter grows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import Final, NamedTuple

from deeco.agenda import Task
from deeco.ensemble import Contact
from deeco.instant import Duration, Instant, seconds
from deeco.knowledge import Knowledge
from deeco.link import Reception, Transmission
from deeco.parameters import LinkParameters
from deeco.replacing import made
from deeco.replication.fragments import Fragmenter
from deeco.replication.packet import KnowledgePacket, Unpacker, Version, pack
from deeco.replication.reassembly import Reassembly
from deeco.replication.relaying import Relay, RelayParameters
from deeco.replication.replicas import Replica, Replicas
from deeco.replication.schema import RoleBook
from deeco.statistics import Statistics

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


@dataclass(frozen=True)
class NodeSurroundings:
    """What the network needs to know of its node."""

    own: frozenset[str]
    """Ids of the node's components."""
    plan: Callable[[Task, Instant], None]
    """Have a task done at an instant."""
    passes: Callable[[Replica], bool]
    """May the knowledge of this sender be relayed?"""


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
        node: NodeSurroundings,
        *,
        address: int,
        epoch: int,
        statistics: Statistics,
        former: "Network | None" = None,
    ) -> None:
        """`former`: the network so far. This one numbers what it sends from there on, and keeps what has
        been heard in part.
        """
        self._book = book
        self._node = node
        self._epoch = epoch
        self._limits = parameters.link
        self._statistics = statistics
        self._counters = statistics.counters
        self._publications: int = 0 if former is None else former._publications
        self._reassembly: Reassembly = Reassembly(parameters.link) if former is None else former._reassembly
        self._unpacker = Unpacker(parameters.link, known=book.fingerprints)
        self._fragmenter: Fragmenter = Fragmenter(
            address & 0xFF, parameters.link, first=epoch * _EPOCH_STRIDE
        )
        if former is not None:
            self._fragmenter = former._fragmenter
        self._outbox: list[tuple[Instant, bytes]] = []
        self.replicas = Replicas(parameters.most_replicas, parameters.forget_after, self._counters)
        self._relay: Relay | None = None
        if parameters.relay is not None:
            self._relay = Relay(parameters.relay, address, node.plan, self._send, self._counters)

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
        return [news for data in whole if (news := self._open(data, reception))]

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
        self._counters.packets += 1
        packet = self._unpacker.unpack(data)
        if packet is None:
            self._counters.packets_junk += 1
            return None
        if packet.component in self._node.own:
            self._counters.packets_own += 1
            return None
        if self._relay is not None:
            self._relay.heard(packet)
        if not self.replicas.is_news(packet.component, packet.version):
            self._counters.packets_old += 1
            return None
        return self._admit(packet, data, reception)

    def _admit(self, packet: KnowledgePacket, data: bytes, reception: Reception) -> News | None:
        unpacked = self._book.unpack(packet.component, packet.roles)
        if unpacked is None:
            self._counters.packets_junk += 1
            return None
        roles, unknown = unpacked
        self._counters.roles_unknown += unknown
        contact = made(Contact, (reception.instant, reception.rssi_dbm, packet.hops))
        replica = Replica(packet.component, packet.version, roles, contact)
        news = made(News, (self.replicas.get(packet.component), replica))
        self.replicas.put(news.after)
        relay, rssi_dbm = self._relay, reception.rssi_dbm
        if relay is not None and relay.wants(packet, rssi_dbm) and self._node.passes(news.after):
            relay.take(packet, data, reception.instant, rssi_dbm)
        return news
