"""Link side of a node: publishes its components, keeps replicas of others, relays packets.

Bytes from the link are untrusted; invalid ones only increment counters.

Relaying lets nodes forward knowledge to others that are out of the sender's reach. A node that receives a
new packet waits, longer for a stronger signal, as distant nodes reach farther, and cancels if it receives the
packet again meanwhile. This follows JDEECo's L2 RebroadcastStrategy, in which only nodes more than about 10 m
away relay; here `relay_below_dbm` has that effect.
"""

import heapq
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import groupby
from operator import itemgetter
from typing import Any, Final, NamedTuple

from deeco.ensemble import Contact
from deeco.fragments import SHORTEST, Fragmenter, Reassembly
from deeco.history import with_history
from deeco.instant import START, Duration, Instant, check_duration, milliseconds, seconds
from deeco.knowledge import Knowledge, new_tuple
from deeco.link import LinkParameters, ReceivedFrame, Transmission
from deeco.packet import (
    FramePackets,
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

    __slots__ = ("_by_kind", "_contact", "heard", "id", "roles", "version")

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
        """Replicas, in order of id after an iteration."""
        self._is_sorted = True
        self._versions: dict[str, Version] = {}
        self._older: dict[str, tuple[Version, int]] = {}
        """Last older version received since the replica was dropped, and number of increases."""
        self._oldest = START
        """Lower bound of all `heard`, so that `drop_old` rarely iterates."""

    def __iter__(self) -> Iterator[Replica]:
        if not self._is_sorted:
            self.by_id, self._is_sorted = dict(sorted(self.by_id.items())), True
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
        if before is None:
            if len(self.by_id) >= self._most:
                self._counters.replicas_evicted += 1
                del self.by_id[min(self.by_id.values(), key=lambda one: (one.heard, one.id)).id]
            self._is_sorted = False
        self.by_id[component] = replica
        return before

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
        limited = 0.0 if strength < 0.0 else 1.0 if strength > 1.0 else strength  # cheaper than min and max
        return Duration(round(limited * self.max_delay + chance * self.spread))


class _WaitingPacket(NamedTuple):
    version: Version
    data: bytes
    """The packet as received."""


class Relay:
    """Packets waiting to be relayed, at most one per component."""

    def __init__(self, parameters: RelayParameters, address: int, counters: NodeCounters) -> None:
        """Create a relay of the node with this link address."""
        self._parameters = parameters
        self._address = zlib.crc32(f"{address}/".encode())
        self._counters = counters
        self.waiting: dict[str, _WaitingPacket] = {}
        """Waiting packets by component."""
        self._scheduled: list[tuple[Instant, int, str, _WaitingPacket]] = []
        """Heap of packets, cancelled ones included: instant of relaying, serial number, component, packet."""
        self._serial = 0

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
        if len(self._scheduled) >= self._parameters.max_waiting:
            self._counters.relays_refused += 1
            return
        component, version, _, _ = packet
        waiting = self.waiting[component] = new_tuple(_WaitingPacket, (version, data))
        # a number in [0, 1) that depends on node and packet only, not on other draws
        name = f"{component}/{version.epoch}/{version.counter}".encode("utf-8", "surrogatepass")
        delay = self._parameters.delay(rssi_dbm, zlib.crc32(name, self._address) / 2**32)
        self._serial += 1
        heapq.heappush(self._scheduled, (Instant(heard + delay), self._serial, component, waiting))

    def due(self, until: Instant) -> list[tuple[Instant, bytes]]:
        """Remove the packets scheduled before `until`; return those to be sent, in order of time."""
        sent: list[tuple[Instant, bytes]] = []
        while self._scheduled and self._scheduled[0][0] < until:
            instant, _, component, waiting = heapq.heappop(self._scheduled)
            if self.waiting.get(component) is waiting:
                del self.waiting[component]
                sent.append((instant, increment_hops(waiting.data)))
        self._counters.relayed += len(sent)
        return sent

    def clear(self, now: Instant) -> int:
        """Cancel all waiting packets; return the number of those scheduled before `now`, cancelled or not."""
        self._counters.relays_cancelled += len(self.waiting)
        self.waiting.clear()
        scheduled, self._scheduled = self._scheduled, []
        return sum(one[0] < now for one in scheduled)


_INSTANT: Final = itemgetter(0)
_MOST_FRAMES: Final = 1024
"""Frames whose packets are shared: those of a step of 1000 nodes."""
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


UpdateListener = Callable[[Replica | None, Replica], None]
"""Receives the previous replica of a component, if any, and the new one."""


class Network:
    """Converts frames to replicas, and knowledge to frames."""

    def __init__(
        self,
        parameters: NetworkParameters,
        registry: RoleRegistry,
        *,
        own: frozenset[str],
        may_relay: Callable[[Replica], bool],
        address: int,
        epoch: int,
        statistics: Statistics,
        previous: "Network | None" = None,
    ) -> None:
        """Continue numbering and reassembly of the network `previous`, if any.

        `own`: ids of the node's components. `may_relay`: returns whether a sender's knowledge may be relayed.
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
        self._shared_frames = self._unpacker.frames if self._authenticator is None else None
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
            self._relay = Relay(parameters.relay, address, self._counters)

    def publish(self, now: Instant, knowledge: Sequence[Knowledge]) -> None:
        """Send the roles of own components; record the ages of all replicas."""
        for value in knowledge:
            self._publications += 1
            version = Version(self._epoch, self._publications)
            self._counters.published += 1
            packet = KnowledgePacket(value.id, version, 0, self._registry.pack(value))
            self._outbox.append((now, pack(packet, self._limits, self._authenticator)))
        self._statistics.sample_ages([replica.heard for replica in self.replicas], now)

    def take(self, receptions: Iterable[ReceivedFrame], on_update: UpdateListener) -> None:
        """Process frames; call `on_update` for each replica that their packets change."""
        counters, reassembly, frames = self._counters, self._reassembly, self._shared_frames
        own, relay, replicas = self._own, self._relay, self.replicas
        updates: list[tuple[Replica | None, Replica]] = []
        for reception in receptions:
            packets = frames.get(reception.data) if frames and not reassembly.open else None
            if packets is None:
                packets = self._packets(reception)
            else:
                reassembly.counters.complete += 1
                counters.packets += 1
            for data, packet in packets:
                component, version, _, _ = packet
                if component in own:
                    counters.packets_own += 1
                    continue
                if relay is not None and component in relay.waiting:
                    relay.cancel_older(packet)
                held = replicas.by_id.get(component)
                # Most packets have no news: the first test saves them a call.
                if (held is not None and version <= held.version) or not replicas.accepts(component, version):
                    counters.packets_old += 1
                elif update := self._take_news(packet, data, reception):
                    updates.append(update)
            while updates:
                on_update(*updates.pop(0))

    def transmissions(self, until: Instant) -> list[Transmission]:
        """Return the frames sent since the last call and relayed before `until`; packets of one instant share
        frames."""
        packets = self._outbox if self._relay is None else self._relay.due(until) + self._outbox
        if not packets:
            return []
        sent: list[Transmission] = []
        for instant, group in groupby(sorted(packets, key=_INSTANT), key=_INSTANT):
            frames = self._fragmenter.frames([data for _, data in group])
            sent += [new_tuple(Transmission, (instant, frame)) for frame in frames]
        self._outbox = []
        self._counters.frames += len(sent)
        return sent

    def clear(self, now: Instant) -> int:
        """Cancel waiting relays; return the number of those scheduled before `now`."""
        return 0 if self._relay is None else self._relay.clear(now)

    def counters(self) -> dict[str, int]:
        """Return the counters of the reassembly by the names in ReassemblyCounters."""
        return asdict(self._reassembly.counters)

    def _with_histories(
        self, component: str, roles: tuple[Knowledge, ...], now: Instant
    ) -> tuple[Knowledge, ...]:
        known = self.replicas.get(component)
        before = {type(one): one for one in known.roles} if known else {}
        return tuple(with_history(one, before.get(type(one)), now) for one in roles)

    def _packets(self, reception: ReceivedFrame) -> FramePackets:
        """Return the valid packets that a frame completes, with their data."""
        counters, authenticator, frame = self._counters, self._authenticator, reception.data
        is_whole = not self._reassembly.open
        found: list[tuple[bytes, KnowledgePacket]] = []
        for data in self._reassembly.take(Instant(reception.instant), reception.sender, frame):
            counters.packets += 1
            content = data if authenticator is None else verified_packet(data, authenticator)
            if content is None:
                counters.packets_forged += 1
            elif packet := self._unpacker.unpack(content):
                found.append((data, packet))
                is_whole &= len(frame) - len(data) < SHORTEST
            else:
                counters.packets_junk += 1
        frames = self._shared_frames
        if found and is_whole and frames is not None and len(self._registry.nodes) > 1:
            if len(frames) >= _MOST_FRAMES:
                del frames[next(iter(frames))]
            frames[frame] = found
        return found

    def _take_news(
        self, packet: KnowledgePacket, data: bytes, reception: ReceivedFrame
    ) -> tuple[Replica | None, Replica] | None:
        """Store and relay a packet that is newer than the replica; return both replicas if it is valid."""
        component, version, hops, packed = packet
        unpacked = self._registry.unpack(component, packed)
        if unpacked is None:
            self._counters.packets_junk += 1
            return None
        roles, unknown = unpacked
        self._counters.roles_unknown += unknown
        heard: Any = reception.instant  # an Instant, without a call of the type
        rssi_dbm, relay = reception.rssi_dbm, self._relay
        if self._has_histories:
            roles = self._with_histories(component, roles, heard)
        replica = Replica(component, version, roles, new_tuple(Contact, (heard, rssi_dbm, hops)))
        before = self.replicas.put(replica)
        if relay is not None and relay.should_relay(packet, rssi_dbm) and self._may_relay(replica):
            relay.take(packet, data, heard, rssi_dbm)
        return before, replica
