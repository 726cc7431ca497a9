"""Link side of a node: publishes its components, keeps replicas of others, relays packets.

Bytes from the link are untrusted; invalid ones only increment counters.

Relaying lets nodes forward knowledge to others that are out of the sender's reach. A node that receives a
new packet waits, longer for a stronger signal, as distant nodes reach farther, and cancels if it receives the
packet again meanwhile. This follows JDEECo's L2 RebroadcastStrategy, in which only nodes more than about 10 m
away relay; here `relay_below_dbm` has that effect.
"""

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby
from typing import Any, Final, NamedTuple

from deeco.ensemble import Contact
from deeco.fragments import Fragmenter, Reassembly
from deeco.history import with_history
from deeco.instant import START, Duration, Instant, Task, check_duration, milliseconds, seconds
from deeco.knowledge import Knowledge, new_tuple
from deeco.link import LinkParameters, Reception, Transmission
from deeco.packet import (
    KnowledgePacket,
    PacketAuthenticator,
    Unpacker,
    Version,
    increment_hops,
    pack,
    verified_packet,
)
from deeco.schema import RoleRegistry
from deeco.statistics import NodeCounters, Statistics


class Replica:
    """Latest received knowledge of a component of another node."""

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
        """Return its knowledge in a role; None if it has not been received in that role."""
        try:
            return self._by_kind[kind]
        except KeyError:
            role = next((one for one in self.roles if isinstance(one, kind)), None)
            return self._by_kind.setdefault(kind, role)

    def contact(self, now: Instant) -> Contact:
        """Return how this knowledge was received."""
        return self._contact


_OLDER_VERSIONS: Final = 16
"""Increases among older versions that replace a version without replica; our choice: more than by relays."""


class Replicas:
    """A limited number of replicas in order of id; old ones are dropped."""

    def __init__(
        self, most: int, forget_after: Duration, counters: NodeCounters, *, authenticated: bool = False
    ) -> None:
        """Create an empty set of replicas; `authenticated`: versions cannot be forged."""
        self._most = most
        self._forget_after = forget_after
        self._counters = counters
        self._authenticated = authenticated
        self.by_id: dict[str, Replica] = {}
        """Replicas in order of id."""
        self._versions: dict[str, Version] = {}
        self._older: dict[str, tuple[Version, int]] = {}
        """Last older version received since the replica was dropped, and number of increases."""
        self._oldest = START
        """Lower bound of all `heard`, so that `drop_old` rarely iterates."""

    def __iter__(self) -> Iterator[Replica]:
        return iter(self.by_id.values())

    def __len__(self) -> int:
        return len(self.by_id)

    def get(self, component: str) -> Replica | None:
        """Return the replica of a component; None if there is none."""
        return self.by_id.get(component)

    def accepts(self, component: str, version: Version) -> bool:
        """Return whether a version is newer than any received, also of replicas dropped since.

        A version that is not authenticated may be forged. After its replica was dropped, a sequence of older
        versions replaces it.
        """
        known = self._versions.get(component)
        if known is None or version > known:
            return True
        if self._authenticated or component in self.by_id:
            return False
        older, increases = self._older.get(component, (version, 0))
        increases += version > older
        self._older[component] = version, increases
        return version > older and increases >= _OLDER_VERSIONS

    def put(self, replica: Replica) -> Replica | None:
        """Add or replace a replica by a newer version; return the previous one, if any."""
        component = replica.id
        self._versions.pop(component, None)
        self._versions[component] = replica.version
        if self._older:
            self._older.pop(component, None)
        if len(self._versions) > 4 * self._most:
            forgotten = next(iter(self._versions))
            del self._versions[forgotten]
            self._older.pop(forgotten, None)
        self._oldest = min(self._oldest, replica.heard)
        before = self.by_id.get(component)
        if before is not None:
            self.by_id[component] = replica
            return before
        if len(self.by_id) >= self._most:
            self._counters.replicas_evicted += 1
            del self.by_id[min(self.by_id.values(), key=lambda one: (one.heard, one.id)).id]
        self.by_id[component] = replica
        self.by_id = dict(sorted(self.by_id.items()))
        return None

    def drop_old(self, now: Instant) -> None:
        """Drop replicas that have not been received for too long."""
        if now - self._oldest <= self._forget_after:
            return
        old = [one.id for one in self if now - one.heard > self._forget_after]
        for component in old:
            del self.by_id[component]
        self._oldest = min((one.heard for one in self), default=now)
        self._counters.replicas_forgotten += len(old)


@dataclass(frozen=True)
class RelayParameters:
    """Conditions and delays of relaying."""

    hop_limit: int = 3
    """Maximum number of relays of a packet, 1 to 15. Default: three times the radio's range spans the shipped
    corridor."""
    max_delay: Duration = field(default=seconds(1))
    """Delay at the strongest signal. Default: as JDEECo 2 (gossip.rebroadcast.delay, 1000 ms)."""
    spread: Duration = field(default=milliseconds(500))
    """Range of the random addition to the delay, which separates nodes with equal signals. Default: five
    steps of 100 ms, as a node processes received packets only at the start of a step."""
    weakest_dbm: float = -95.0
    """Signal strength at and below which there is no delay, dBm. Default: sensitivity of the MRF24J40
    (Microchip DS39776C)."""
    strongest_dbm: float = -45.0
    """Signal strength at and above which the delay is `max_delay`, dBm. Default: the original testbed's
    transmit power minus 40 dB path loss over 1 m, rounded up for stronger transmitters."""
    relay_below_dbm: float | None = None
    """Relay only packets received below this strength, dBm, or without one, as a nearer node adds little
    coverage (distance-based suppression: Ni, Tseng, Chen, Sheu, The broadcast storm problem in a mobile ad
    hoc network, MobiCom 1999). Default: None, no limit; the useful value depends on the link."""
    max_waiting: int = 64
    """Maximum number of packets waiting at once, including cancelled ones."""

    def delay(self, rssi_dbm: float | None, chance: float) -> Duration:
        """Return the delay; `chance` in [0, 1) selects a value within the spread. Medium if `rssi_dbm` is
        None."""
        span = self.strongest_dbm - self.weakest_dbm
        strength = 0.5 if rssi_dbm is None else (rssi_dbm - self.weakest_dbm) / span
        return Duration(round(min(max(strength, 0.0), 1.0) * self.max_delay + chance * self.spread))


class _WaitingPacket(NamedTuple):
    version: Version
    data: bytes


class Relay:
    """Packets waiting to be relayed, at most one per component."""

    def __init__(
        self,
        parameters: RelayParameters,
        address: int,
        plan: Callable[[Callable[[Instant], None], Instant], None],
        send: Callable[[Instant, bytes], None],
        counters: NodeCounters,
    ) -> None:
        """Create a relay; `plan` schedules a task at an instant, `send` gives a packet to the link."""
        self._parameters = parameters
        self._address = address
        self._plan = plan
        self._send = send
        self._counters = counters
        self.waiting: dict[str, _WaitingPacket] = {}
        """Waiting packets by component."""
        self._scheduled = 0
        """Number of scheduled tasks, including those of cancelled packets."""

    def cancel_older(self, packet: KnowledgePacket) -> None:
        """Cancel a waiting packet up to the version of `packet`, sent by another node."""
        waiting = self.waiting.get(packet.component)
        if waiting is not None and waiting.version <= packet.version:
            del self.waiting[packet.component]
            self._counters.relays_cancelled += 1

    def should_relay(self, packet: KnowledgePacket, rssi_dbm: float | None) -> bool:
        """Return whether a new packet is below the hop limit and was not received too strongly."""
        below = self._parameters.relay_below_dbm
        is_near = below is not None and rssi_dbm is not None and rssi_dbm > below
        return not is_near and packet.hops < self._parameters.hop_limit

    def take(self, packet: KnowledgePacket, data: bytes, heard: Instant, rssi_dbm: float | None) -> None:
        """Schedule the relaying of a packet."""
        if self._scheduled >= self._parameters.max_waiting:
            self._counters.relays_refused += 1
            return
        waiting = self.waiting[packet.component] = new_tuple(
            _WaitingPacket, (packet.version, increment_hops(data))
        )
        instant = Instant(heard + self._parameters.delay(rssi_dbm, self._random_share(packet)))

        def relay_packet(now: Instant) -> None:
            self._scheduled -= 1
            if self.waiting.get(packet.component) is waiting:
                del self.waiting[packet.component]
                self._counters.relayed += 1
                self._send(now, waiting.data)

        self._scheduled += 1
        self._plan(relay_packet, instant)

    def clear(self) -> None:
        """Cancel all waiting packets; their scheduled tasks must not run any more."""
        self._counters.relays_cancelled += len(self.waiting)
        self.waiting.clear()
        self._scheduled = 0

    def _random_share(self, packet: KnowledgePacket) -> float:
        """Return a number in [0, 1) that depends on node and packet only, not on other draws."""
        name = f"{self._address}/{packet.component}/{packet.version.epoch}/{packet.version.counter}"
        return zlib.crc32(name.encode("utf-8", "surrogatepass")) / 2**32


_EPOCH_STRIDE: Final = 0x9E37
"""Distance between the first packet numbers of two epochs, so that peers do not mix fragments of both. Odd,
and 2^16 times the golden ratio: any two epochs are far apart."""


@dataclass(frozen=True)
class NetworkParameters:
    """Parameters of publishing, replicas and relaying. Raises DefinitionError for a wrong duration."""

    publish_every: Duration = field(default=seconds(1))
    """Period of publishing all roles of the node's own components. Default: JDEECo,
    DefaultKnowledgePublisher."""
    forget_after: Duration = field(default=seconds(30))
    """Age at which a replica is dropped."""
    max_replicas: int = 256
    """Maximum number of replicas; beyond it the oldest is dropped."""
    relay: RelayParameters | None = None
    """None: no relaying."""
    link: LinkParameters = field(default_factory=LinkParameters)
    authenticator: PacketAuthenticator | None = None
    """Tags of packets, with the key of the swarm. None: packets are not authenticated."""

    def __post_init__(self) -> None:
        check_duration("NetworkParameters: publish_every", self.publish_every)
        check_duration("NetworkParameters: forget_after", self.forget_after)


@lru_cache(maxsize=16)
def _shared_unpacker(registry: RoleRegistry, limits: LinkParameters) -> Unpacker:
    """Return the unpacker of all nodes of this process with this registry: each packet is decoded once."""
    return Unpacker(limits, known=registry.fingerprints)


ReplicaUpdate = tuple[Replica | None, Replica]
"""Previous replica of a component, if any, and the new one."""


class Network:
    """Converts frames to replicas, and knowledge to frames."""

    def __init__(
        self,
        parameters: NetworkParameters,
        registry: RoleRegistry,
        *,
        own: frozenset[str],
        plan: Callable[[Task, Instant], None],
        may_relay: Callable[[Replica], bool],
        address: int,
        epoch: int,
        statistics: Statistics,
        previous: "Network | None" = None,
    ) -> None:
        """Continue numbering and reassembly of the network `previous`, if any.

        `own`: ids of the node's components. `plan`: schedules a task at an instant. `may_relay`: returns
        whether a sender's knowledge may be relayed.
        """
        self._registry = registry
        self._own = own
        self._may_relay = may_relay
        self._epoch = epoch
        self._has_histories = registry.has_histories
        self._limits = parameters.link
        self._authenticator = parameters.authenticator
        self._statistics = statistics
        self._counters = statistics.counters
        self._unpacker = _shared_unpacker(registry, parameters.link)
        registry.nodes.add(address)
        self._publications = 0
        self._reassembly = Reassembly(parameters.link)
        self._fragmenter = Fragmenter(address & 0xFF, parameters.link, first=epoch * _EPOCH_STRIDE)
        if previous is not None:
            self._publications = previous._publications
            self._reassembly = previous._reassembly
            self._fragmenter = previous._fragmenter
        self._outbox: list[tuple[Instant, bytes]] = []
        self.replicas = Replicas(
            parameters.max_replicas,
            parameters.forget_after,
            self._counters,
            authenticated=self._authenticator is not None,
        )
        self._relay: Relay | None = None
        if parameters.relay is not None:
            self._relay = Relay(parameters.relay, address, plan, self._send, self._counters)

    def publish(self, now: Instant, knowledge: Sequence[Knowledge]) -> None:
        """Send the roles of own components; record the ages of all replicas."""
        for value in knowledge:
            self._publications += 1
            version = Version(self._epoch, self._publications)
            self._counters.published += 1
            packet = KnowledgePacket(value.id, version, 0, self._registry.pack(value))
            self._send(now, pack(packet, self._limits, self._authenticator))
        self._statistics.sample_ages([replica.heard for replica in self.replicas], now)

    def take(self, reception: Reception) -> list[ReplicaUpdate]:
        """Return the replicas changed by the packets that this frame completes."""
        updates: list[ReplicaUpdate] = []
        for data in self._reassembly.take(reception.instant, reception.sender, reception.data):
            if update := self._process_packet(data, reception):
                updates.append(update)
        return updates

    def transmissions(self) -> list[Transmission]:
        """Return the frames sent since the last call; packets of one instant share frames."""
        if not self._outbox:
            return []
        sent: list[Transmission] = []
        for instant, group in groupby(self._outbox, key=lambda item: item[0]):
            frames = self._fragmenter.frames([data for _, data in group])
            sent += [new_tuple(Transmission, (instant, frame)) for frame in frames]
        self._outbox = []
        self._counters.frames += len(sent)
        return sent

    def clear(self) -> None:
        """Cancel waiting relays."""
        if self._relay is not None:
            self._relay.clear()

    def counters(self) -> dict[str, int]:
        """Return the counters of the reassembly."""
        return self._reassembly.counters()

    def _send(self, now: Instant, data: bytes) -> None:
        self._outbox += ((now, data),)

    def _with_histories(
        self, component: str, roles: tuple[Knowledge, ...], now: Instant
    ) -> tuple[Knowledge, ...]:
        known = self.replicas.get(component)
        before = {type(one): one for one in known.roles} if known else {}
        return tuple(with_history(one, before.get(type(one)), now) for one in roles)

    def _process_packet(self, data: bytes, reception: Reception) -> ReplicaUpdate | None:
        counters, relay = self._counters, self._relay
        counters.packets += 1
        authenticator = self._authenticator
        content = data if authenticator is None else verified_packet(data, authenticator)
        if content is None:
            counters.packets_forged += 1
            return None
        packet = self._unpacker.unpack(content)
        if packet is None:
            counters.packets_junk += 1
            return None
        component = packet.component
        if component in self._own:
            counters.packets_own += 1
            return None
        if relay is not None and component in relay.waiting:
            relay.cancel_older(packet)
        held = self.replicas.by_id.get(component)
        # Most packets have no news: the first test saves them a call.
        if (held is not None and packet.version <= held.version) or not self.replicas.accepts(
            component, packet.version
        ):
            counters.packets_old += 1
            return None
        unpacked = self._registry.unpack(component, packet.roles)
        if unpacked is None:
            counters.packets_junk += 1
            return None
        roles, unknown = unpacked
        counters.roles_unknown += unknown
        rssi_dbm = reception.rssi_dbm
        contact = new_tuple(Contact, (reception.instant, rssi_dbm, packet.hops))
        if self._has_histories:
            roles = self._with_histories(component, roles, reception.instant)
        replica = Replica(component, packet.version, roles, contact)
        before = self.replicas.put(replica)
        if relay is not None and relay.should_relay(packet, rssi_dbm) and self._may_relay(replica):
            relay.take(packet, data, reception.instant, rssi_dbm)
        return before, replica
