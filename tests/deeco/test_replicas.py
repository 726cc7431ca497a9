"""What a node keeps of others: the newest, not too old, not too much."""

from dataclasses import replace
from typing import Self

from hypothesis import given, settings
from hypothesis import strategies as st

from deeco import Contact, Duration, Instant, Knowledge, component, periodic, role, seconds
from deeco.link import Reception
from deeco.node import Node
from deeco.replication.network import NetworkParameters, Replica, Replicas
from deeco.replication.packet import Version
from deeco.statistics import NodeCounters


@role
class Counting(Knowledge):
    count: int = 0


@component
class Counter(Counting):
    @periodic(every=seconds(1))
    def tick(self) -> Self:
        return replace(self, count=self.count + 1)


def publications(number: int, name: str = "a", epoch: int = 0) -> list[bytes]:
    """The frames in which a node publishes at 0, 1, 2, … s, with the counts 1, 2, 3, …"""
    node = Node([Counter(id=name)], address=1, epoch=epoch)
    return [frame.data for frame in node.advance(Instant(seconds(number)))]


def listener(**parameters: object) -> Node:
    return Node([Counter(id="me")], parameters=NetworkParameters(**parameters), address=2)  # type: ignore[arg-type]


def hear(node: Node, *frames: bytes, sender: int = 1, rssi_dbm: float | None = None) -> None:
    now = node.now
    node.advance(Instant(now + 1000), [Reception(now, sender, frame, rssi_dbm) for frame in frames])


def counts(node: Node) -> dict[str, int]:
    return {one.id: one.role(Counting).count for one in node.replicas}


def test_the_newest_version_counts_in_whatever_order_they_come() -> None:
    first, second, third = publications(3)
    node = listener()
    hear(node, second)
    assert counts(node) == {"a": 2}
    hear(node, first)
    assert counts(node) == {"a": 2}
    hear(node, third, third)
    assert counts(node) == {"a": 3}
    assert node.outcome()["counters"]["packets_old"] == 2


def test_a_restarted_node_is_heard_again() -> None:
    node = listener()
    hear(node, *publications(5))
    hear(node, *publications(1, epoch=1))
    assert counts(node) == {"a": 1}
    hear(node, *publications(9))
    assert counts(node) == {"a": 1}, "what the node sent before it was restarted is older"


def test_own_knowledge_that_comes_back_is_no_replica() -> None:
    node = listener()
    hear(node, *publications(1, name="me"))
    assert counts(node) == {}
    assert node.outcome()["counters"]["packets_own"] == 1


def test_replicas_keep_when_and_how_strongly_they_were_heard() -> None:
    node = listener()
    node.advance(Instant(seconds(3)))
    (frame,) = publications(1)
    node.advance(Instant(seconds(3.1)), [Reception(Instant(2_950_000), 1, frame, -71.5)])
    (replica,) = node.replicas
    assert replica.contact(node.now) == Contact(heard=Instant(2_950_000), rssi_dbm=-71.5, hops=0)


def test_an_older_version_stays_old_after_its_replica_was_forgotten() -> None:
    first, second = publications(2)
    node = listener(forget_after=seconds(5))
    hear(node, second)
    node.advance(Instant(seconds(6)))
    node.advance(Instant(seconds(7)))
    assert counts(node) == {}
    hear(node, first)
    assert counts(node) == {}


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 9), st.integers(0, 4)), max_size=60))
def test_at_any_moment_all_that_is_too_old_is_gone_and_nothing_else(
    story: list[tuple[int, int, int]],
) -> None:
    """Each time a component's newer version comes in, heard a moment ago, and time goes on."""
    replicas = Replicas(256, Duration(5), NodeCounters())
    heard: dict[str, int] = {}
    now = 0
    for counter, (number, ago, passing) in enumerate(story):
        name, moment = f"r{number}", max(0, now - ago)
        heard[name] = moment
        contact = Contact(Instant(moment), None, 0)
        replicas.put(Replica(name, Version(0, counter), (), contact))
        now += passing
        replicas.forget(Instant(now))
        heard = {name: instant for name, instant in heard.items() if now - instant <= 5}
        assert [one.id for one in replicas] == sorted(heard)


def test_the_one_heard_longest_ago_makes_room() -> None:
    node = listener(most_replicas=2)
    for name in ("c", "a", "b"):
        hear(node, *publications(1, name=name))
    assert counts(node) == {"a": 1, "b": 1}
    assert node.outcome()["counters"]["replicas_evicted"] == 1


def test_ages_are_sampled_at_each_own_publication() -> None:
    node = listener()
    node.advance(Instant(500_000))
    (frame,) = publications(1)
    node.advance(Instant(seconds(3)), [Reception(Instant(480_000), 1, frame)])
    assert node.outcome()["replica_age_ms"] == {"550": 1, "1550": 1}, "at 1 and 2 s, by 50 ms"


@settings(max_examples=60)
@given(st.lists(st.binary(max_size=130), max_size=8), st.integers(0, 2**16))
def test_nothing_from_the_air_can_hurt(frames: list[bytes], cut: int) -> None:
    (good,) = publications(1)
    spoilt = bytearray(good)
    spoilt[cut % len(spoilt)] ^= 1 + cut % 255
    node = listener()
    hear(node, *frames, bytes(spoilt), good[: cut % len(good)])
    hear(node, good, sender=7)
    assert counts(node).get("a") == 1, "whatever came before, knowledge that is heard whole counts"


def test_any_step_gives_the_same_publications() -> None:
    def frames(step: Duration) -> list[tuple[int, bytes]]:
        node = Node([Counter(id="a")], publish_phase=seconds(0.25))
        sent = []
        while node.now < seconds(5):
            sent += node.advance(Instant(node.now + step))
        return [(frame.instant, frame.data) for frame in sent]

    assert frames(seconds(0.01)) == frames(seconds(0.1)) == frames(seconds(1))
