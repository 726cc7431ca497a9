"""Replicas: newest version, limited age and number; relaying."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deeco import (
    Contact,
    Duration,
    Instant,
    Knowledge,
    component,
    ensemble,
    milliseconds,
    periodic,
    role,
    seconds,
)
from deeco.link import Reception
from deeco.network import NetworkParameters, Relay, RelayParameters, Replica, Replicas
from deeco.node import Node
from deeco.packet import KnowledgePacket, Version, increment_hops, pack
from deeco.statistics import NodeCounters
from deeco.virtual_network import LossyMedium, Reach, VirtualNetwork


@role
class Counting(Knowledge):
    count: int = 0


@component
class Counter(Counting):
    @periodic(every=seconds(1))
    def tick(self) -> Self:
        return replace(self, count=self.count + 1)


def publications(number: int, name: str = "a", epoch: int = 0) -> list[bytes]:
    """Return the frames of a node that publishes at 0, 1, 2, … s, with the counts 1, 2, 3, …"""
    node = Node([Counter(id=name)], address=1, epoch=epoch)
    return [frame.data for frame in node.advance(Instant(seconds(number)))]


def listener(**parameters: object) -> Node:
    return Node([Counter(id="me")], parameters=NetworkParameters(**parameters), address=2)  # type: ignore[arg-type]


def hear(node: Node, *frames: bytes, sender: int = 1, rssi_dbm: float | None = None) -> None:
    now = node.now
    node.advance(Instant(now + 1000), [Reception(now, sender, frame, rssi_dbm) for frame in frames])


def counts(node: Node) -> dict[str, int]:
    return {one.id: one.role(Counting).count for one in node.replicas}


def test_the_newest_version_wins_in_any_order() -> None:
    first, second, third = publications(3)
    node = listener()
    hear(node, second)
    assert counts(node) == {"a": 2}
    hear(node, first)
    assert counts(node) == {"a": 2}
    hear(node, third, third)
    assert counts(node) == {"a": 3}
    assert node.outcome()["counters"]["packets_old"] == 2
    hear(node, *publications(1, name="me"))
    assert counts(node) == {"a": 3}, "own knowledge that comes back is not a replica"
    assert node.outcome()["counters"]["packets_own"] == 1
    node.advance(Instant(seconds(40)))
    node.advance(Instant(seconds(41)))
    hear(node, second)
    assert counts(node) == {}, "an old version stays old after its replica was dropped"


def test_updates_follow_all_packets_of_their_frame_and_precede_the_next_frame() -> None:
    both = Node([Counter(id="a"), Counter(id="b")], address=1).advance(Instant(1))
    received = [Reception(Instant(0), 1, frame, None) for frame in (both[0].data, *publications(1, name="c"))]
    node, known = listener(), list[set[str]]()
    node._network.take(received, lambda before, after: known.append(set(counts(node))))
    assert len(both) == 1 and known == [{"a", "b"}, {"a", "b"}, {"a", "b", "c"}]


def test_a_restarted_node_is_accepted_again() -> None:
    node = listener()
    hear(node, *publications(5))
    hear(node, *publications(1, epoch=1))
    assert counts(node) == {"a": 1}
    hear(node, *publications(9))
    assert counts(node) == {"a": 1}, "what the node sent before it was restarted is older"


def test_replicas_keep_when_and_how_strongly_they_were_heard() -> None:
    node = listener()
    node.advance(Instant(seconds(3)))
    (frame,) = publications(1)
    node.advance(Instant(seconds(3.1)), [Reception(Instant(2_950_000), 1, frame, -71.5)])
    (replica,) = node.replicas
    assert replica.contact(node.now) == Contact(heard=Instant(2_950_000), rssi_dbm=-71.5, hops=0)


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 9), st.integers(0, 4)), max_size=60))
def test_exactly_the_old_replicas_are_dropped(
    story: list[tuple[int, int, int]],
) -> None:
    replicas = Replicas(256, Duration(5), NodeCounters())
    heard: dict[str, int] = {}
    now = 0
    for counter, (number, ago, passing) in enumerate(story):
        name, moment = f"r{number}", max(0, now - ago)
        heard[name] = moment
        contact = Contact(Instant(moment), None, 0)
        replicas.put(Replica(name, Version(0, counter), (), contact))
        now += passing
        replicas.drop_old(Instant(now))
        heard = {name: instant for name, instant in heard.items() if now - instant <= 5}
        assert [one.id for one in replicas] == sorted(heard)


def test_the_oldest_replica_is_evicted() -> None:
    node = listener(max_replicas=2)
    for name in ("c", "a", "b"):
        hear(node, *publications(1, name=name))
    assert counts(node) == {"a": 1, "b": 1}
    assert node.outcome()["counters"]["replicas_evicted"] == 1


def test_ages_are_sampled_at_each_own_publication() -> None:
    node = listener()
    node.advance(Instant(500_000))
    (frame,) = publications(1)
    node.advance(Instant(seconds(3)), [Reception(Instant(480_000), 1, frame)])
    assert node.outcome()["replica_age_ms"] == {550: 1, 1550: 1}, "at 1 and 2 s, by 50 ms"


@settings(max_examples=60)
@given(st.lists(st.binary(max_size=130), max_size=8), st.integers(0, 2**16))
def test_invalid_frames_are_harmless(frames: list[bytes], cut: int) -> None:
    (good,) = publications(1)
    spoilt = bytearray(good)
    spoilt[cut % len(spoilt)] ^= 1 + cut % 255
    node = listener()
    hear(node, *frames, bytes(spoilt), good[: cut % len(good)])
    hear(node, good, sender=7)
    assert counts(node).get("a") == 1, "whatever came before, knowledge that is heard whole counts"


@role
class Vehicle(Knowledge):
    position: float = 0.0


@component
class Car(Vehicle):
    pass


@ensemble(every=seconds(100), offset=seconds(50))
class Near:
    """Knowledge is relayed within 15 m of its source."""

    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        return False

    def boundary(self, sender: Vehicle, here: Vehicle) -> bool:
        return abs(sender.position - here.position) <= 15


def cars(
    positions: Sequence[float], relay: RelayParameters, ensembles: tuple[object, ...] = ()
) -> dict[str, Node]:
    return {
        f"c{number}": Node(
            [Car(id=f"c{number}", position=position)],
            ensembles,
            parameters=NetworkParameters(relay=relay, publish_every=seconds(4)),
            address=number,
            publish_phase=milliseconds(10 + 700 * number),
        )
        for number, position in enumerate(positions)
    }


def within(metres: float, positions: Sequence[float]) -> Reach:
    """Return a reach with 5 dB of loss per metre from -40 dBm."""

    def reach(sender: str, receiver: str) -> float | None:
        gap = abs(positions[int(sender[1:])] - positions[int(receiver[1:])])
        return -40.0 - 5.0 * gap if gap <= metres else None

    return reach


def known(node: Node) -> dict[str, int]:
    return {one.id: one.contact(node.now).hops for one in node.replicas}


LINE = (0.0, 10.0, 20.0, 30.0, 40.0)


def run(positions: Sequence[float], nodes: dict[str, Node]) -> None:
    VirtualNetwork(nodes, LossyMedium(reach=within(10.0, positions))).advance(seconds(4))


def total(nodes: dict[str, Node], counter: str) -> int:
    return sum(node.outcome()["counters"][counter] for node in nodes.values())


def test_knowledge_travels_as_far_as_the_hop_limit() -> None:
    nodes = cars(LINE, RelayParameters(hop_limit=2))
    run(LINE, nodes)
    assert known(nodes["c3"]) == {"c0": 2, "c1": 1, "c2": 0, "c4": 0}
    assert "c0" not in known(nodes["c4"]), "it would take a third relay"


@pytest.mark.parametrize(("below", "cancelled"), [(None, 1), (-80.0, 0)])
def test_the_farthest_receiver_relays_first_and_near_ones_cancel(below: float | None, cancelled: int) -> None:
    positions = (0.0, 1.0, 9.0, 17.0)  # c1 receives c0 with -45 dBm, c2 with -85 dBm
    nodes = cars(positions, RelayParameters(relay_below_dbm=below))
    air = VirtualNetwork(nodes, LossyMedium(reach=within(10.0, positions)))
    air.advance(seconds(1.5))  # c0 has published at 10 ms, and c1 at 710 ms
    relays = [(sender, frame.instant) for sender, frame in air.medium.sent if b"c0" in frame.data][1:]
    assert [sender for sender, _ in relays] == ["c2", "c3"]
    assert relays[0][1] < seconds(0.4)
    assert "c0" in known(nodes["c1"]) and "c0" in known(nodes["c3"])
    assert nodes["c1"].outcome()["counters"]["relays_cancelled"] == cancelled


def test_delay_grows_with_strength() -> None:
    relay = RelayParameters()
    delays = [relay.delay(rssi, 0.0) for rssi in (-120.0, -95.0, -80.0, -60.0, -45.0, 0.0)]
    assert delays == [0, 0, 300_000, 700_000, 1_000_000, 1_000_000]
    assert relay.delay(None, 0.0) == 500_000
    assert relay.delay(-95.0, 0.5) == 250_000


@pytest.mark.parametrize(
    ("below", "rssi", "wanted"),
    [(-80.0, -79.9, False), (-80.0, -80.0, True), (-80.0, None, True), (None, -30.0, True)],
)
def test_frames_at_the_threshold_or_of_unknown_strength_are_relayed(
    below: float | None, rssi: float | None, wanted: bool
) -> None:
    relay = Relay(RelayParameters(relay_below_dbm=below), 1, NodeCounters())
    assert relay.should_relay(KnowledgePacket("c0", Version(0, 1), 0, ()), rssi) is wanted
    assert not relay.should_relay(KnowledgePacket("c0", Version(0, 1), 3, ()), rssi), "it has come far enough"


@ensemble(every=seconds(100), offset=seconds(50))
class Unbounded:
    def membership(self, coordinator: Vehicle, member: Vehicle) -> bool:
        return False


@pytest.mark.parametrize("unbounded", [False, True])
def test_relaying_ends_at_the_boundary_unless_an_ensemble_has_none(unbounded: bool) -> None:
    nodes = cars(LINE, RelayParameters(hop_limit=15), (Near(), Unbounded()) if unbounded else (Near(),))
    run(LINE, nodes)
    assert "c0" in known(nodes["c2"]), "c1 relays, as it is within 15 m"
    assert ("c0" in known(nodes["c3"])) is unbounded


def test_newer_knowledge_replaces_a_waiting_packet() -> None:
    """c0 publishes every 0.2 s, with a signal so strong that relays are delayed by a second."""
    fast = Node([Car(id="c0")], parameters=NetworkParameters(publish_every=milliseconds(200)), address=0)
    slow = cars((0.0, 1.0), RelayParameters())["c1"]
    air = VirtualNetwork({"c0": fast, "c1": slow}, LossyMedium(reach=lambda sender, receiver: -30.0))
    air.advance(seconds(4))
    counters = slow.outcome()["counters"]
    assert counters["relayed"] == 0 and counters["relays_cancelled"] == 19, "of 20 heard, the last one waits"


def test_cancelled_packets_count_until_their_scheduled_time() -> None:
    counters = NodeCounters()
    relay = Relay(RelayParameters(max_waiting=4), 1, counters)
    for number in range(100):
        packet = KnowledgePacket("c0", Version(0, number), 0, ())
        relay.cancel_older(packet)
        relay.take(packet, pack(packet), Instant(0), -60.0)
    assert counters.relays_refused == 96 and counters.relays_cancelled == 4
    assert relay.due(Instant(seconds(2))) == [], "the packet after the last one that fitted cancelled it"
    relay.take(packet, pack(packet), Instant(0), -60.0)
    assert [data for _, data in relay.due(Instant(seconds(2)))] == [increment_hops(pack(packet))]
    assert counters.relays_refused == 96 and counters.relayed == 1


def test_skipping_cancels_relays_and_counts_those_of_the_gap() -> None:
    relay = Relay(RelayParameters(), 1, NodeCounters())
    for number, rssi_dbm in enumerate((-95.0, -45.0)):  # delays below 0.5 s, and of at least 1 s
        packet = KnowledgePacket(f"c{number}", Version(0, 1), 0, ())
        relay.take(packet, pack(packet), Instant(0), rssi_dbm)
    assert relay.clear(Instant(seconds(1))) == 1
    assert relay.due(Instant(seconds(3))) == []


@pytest.mark.parametrize("hops", [1, 3, 15])
@given(number=st.integers(2, 6))
def test_a_packet_is_relayed_at_most_once_by_each(hops: int, number: int) -> None:
    positions = [float(index) for index in range(number)]
    nodes = cars(positions, RelayParameters(hop_limit=hops))
    air = VirtualNetwork(nodes, LossyMedium(reach=within(100.0, positions)))
    air.advance(seconds(3.9))  # one publication each, as the next is due at 4.01 s; 2 nodes still wait
    assert total(nodes, "published") <= number
    assert total(nodes, "relayed") <= number * (number - 1)
    assert len(air.medium.sent) == total(nodes, "published") + total(nodes, "relayed")
