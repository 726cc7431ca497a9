"""UDP link between two nodes of this process: exchange, loss, hostile datagrams, bounded queues, mistakes."""

import asyncio
import random
import socket
from collections.abc import Coroutine
from dataclasses import replace
from typing import Any, Self

import pytest

from deeco import (
    DefinitionError,
    DeploymentError,
    ExecutionError,
    Knowledge,
    component,
    ensemble,
    milliseconds,
    periodic,
    role,
    seconds,
)
from deeco.link import LinkParameters
from deeco.network import NetworkParameters
from deeco.node import Node
from deeco.udp import MAX_DATAGRAM, UdpLink
from tests.deeco.refusals import refused

FAST = NetworkParameters(publish_every=milliseconds(50))


@role
class Counting(Knowledge):
    count: int = 0


@component
class Counter(Counting):
    seen: int = 0

    @periodic(every=milliseconds(50))
    def tick(self) -> Self:
        return replace(self, count=self.count + 1)


@ensemble(every=milliseconds(50))
class Meeting:
    def membership(self, coordinator: Counting, member: Counting) -> bool:
        return True

    def at_member(self, coordinator: Counting, member: Counter) -> Counter:
        return replace(member, seen=coordinator.count)


def free_ports(number: int) -> list[int]:
    opened = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(number)]
    for one in opened:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in opened]
    for one in opened:
        one.close()
    return ports


def node(name: str, parameters: NetworkParameters = FAST) -> Node:
    return Node([Counter(id=name)], [Meeting()], parameters=parameters, address=ord(name))


def seen(one: Node, name: str) -> int:
    counter = one.knowledge(name)
    assert isinstance(counter, Counter)
    return counter.seen


async def until(condition: Any, *running: Coroutine[Any, Any, None]) -> None:
    """Run links until the condition holds, at most 10 s."""
    tasks = [asyncio.ensure_future(one) for one in running]
    async with asyncio.timeout(10):
        while not condition():
            await asyncio.sleep(0.01)
            for task in tasks:
                if task.done():
                    task.result()
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def linked(ports: list[int], **options: Any) -> tuple[UdpLink, UdpLink]:
    first, second = (f"127.0.0.1:{port}" for port in ports)
    step = milliseconds(10)
    return (
        UdpLink(ports[0], [second], host="127.0.0.1", step=step),
        UdpLink(ports[1], [first], host="127.0.0.1", step=step, **options),
    )


def test_two_nodes_exchange_knowledge_and_duration_ends_a_link() -> None:
    a, b = node("a"), node("b")
    first, second = linked(free_ports(2))
    asyncio.run(until(lambda: seen(a, "a") > 3 and seen(b, "b") > 3, first.run(a), second.run(b)))
    assert first.counters.sent > 3 and second.counters.received > 3
    assert second.counters.lost == second.counters.overflow == second.counters.oversized == 0
    third = UdpLink(free_ports(1)[0], [], host="127.0.0.1", step=milliseconds(10))
    alone = node("c")
    asyncio.run(third.run(alone, duration=milliseconds(100)))
    assert 100_000 <= alone.now < 2_000_000


def test_all_datagrams_are_lost_with_a_loss_of_1() -> None:
    a, b = node("a"), node("b")
    first, second = linked(free_ports(2), loss=1.0)
    asyncio.run(until(lambda: second.counters.lost > 3, first.run(a), second.run(b)))
    assert second.counters.received == 0 == seen(b, "b") and seen(a, "a") > 0


def test_hostile_datagrams_are_counted_and_the_exchange_goes_on() -> None:
    a, b = node("a"), node("b")
    ports = free_ports(2)
    first, second = linked(ports)
    rng = random.Random(1)

    async def attack() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hostile:
            while True:
                for size in (0, 9, rng.randrange(1, 200), MAX_DATAGRAM, MAX_DATAGRAM + 1, 60_000):
                    hostile.sendto(rng.randbytes(size), ("127.0.0.1", ports[1]))
                await asyncio.sleep(0.005)

    def done() -> bool:
        return seen(b, "b") > 5 and second.counters.oversized > 10

    asyncio.run(until(done, first.run(a), second.run(b), attack()))
    counters = b.outcome()["counters"]
    assert counters["junk_frames"] > 10
    assert [replica.id for replica in b.replicas] == ["a"]


def test_a_full_queue_and_a_full_socket_drop_datagrams() -> None:
    link = UdpLink(7000, ["127.0.0.1:7001", "127.0.0.1:7002"], max_waiting=2)
    for _ in range(5):
        link.datagram_received(b"x" * 20, ("127.0.0.1", 9))
    assert (link.counters.received, link.counters.overflow) == (2, 3)

    class Transport:
        """Counts datagrams."""

        sent = 0

        def sendto(self, data: bytes, target: object) -> None:
            self.sent += 1

    transport: Any = Transport()
    targets = [("127.0.0.1", 7001), ("127.0.0.1", 7002)]
    link._send(transport, b"x", targets)
    link.pause_writing()
    link._send(transport, b"x", targets)
    link.resume_writing()
    link._send(transport, b"x", targets)
    link.error_received(OSError())
    assert (transport.sent, link.counters.sent, link.counters.overflow, link.counters.errors) == (4, 4, 5, 1)


def test_a_link_that_is_far_behind_skips() -> None:
    a, (port,) = node("a"), free_ports(1)

    async def blocked() -> None:
        loop = asyncio.get_running_loop()
        loop.call_later(0.02, lambda: __import__("time").sleep(1.3))
        await UdpLink(port, [], host="127.0.0.1", step=milliseconds(10)).run(a, duration=seconds(1.4))

    asyncio.run(blocked())
    assert a.outcome()["counters"]["skipped"] > 10


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"port": 70_000}, "UdpLink: port '0.0.0.0:70000' must be host:port, such as"),
        ({"port": True}, "UdpLink: port '0.0.0.0:True' must be host:port, such as"),
        ({"peers": ["robot"]}, "UdpLink: peers 'robot' must be host:port, such as"),
        ({"peers": [":7000"]}, "UdpLink: peers ':7000' must be host:port, such as"),
    ],
)
def test_wrong_addresses_are_refused(options: dict[str, Any], sentence: str) -> None:
    with refused(f"{sentence} 192.168.1.255:7000; ports are 1 to 65535", DeploymentError):
        UdpLink(**{"port": 7000, "peers": [], **options})


def test_other_wrong_options_are_refused() -> None:
    with refused("UdpLink: loss=20; must be from 0 to 1", DeploymentError):
        UdpLink(7000, [], loss=20)
    with refused("UdpLink: step=0.1 is not a duration; use one, such as seconds(1)", DefinitionError):
        UdpLink(7000, [], step=0.1)  # type: ignore[arg-type]


def test_a_port_in_use_an_unknown_peer_and_a_long_frame_are_named() -> None:
    (port,) = free_ports(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", port))
        with pytest.raises(DeploymentError, match=rf"^UdpLink: .*in use; check port {port} and the peers$"):
            asyncio.run(UdpLink(port, [], host="127.0.0.1").run(node("a")))
    with pytest.raises(DeploymentError, match=r"^UdpLink: .*; check port"):
        asyncio.run(UdpLink(port, ["no such host:7000"], host="127.0.0.1").run(node("a")))

    @role
    class Long(Knowledge):
        text: str = "x" * 250
        more: tuple[str, ...] = ("x" * 250,) * 7

    @component
    class Talker(Long):
        """Publishes 2 000 bytes."""

    parameters = NetworkParameters(link=LinkParameters(frame_data=4000, max_packet=3000))
    talker = Node([Talker(id="t")], parameters=parameters)
    with pytest.raises(ExecutionError, match=r"at most 1472 are allowed \(LinkParameters\.frame_data\)$"):
        asyncio.run(UdpLink(port, ["127.0.0.1:7000"], host="127.0.0.1").run(talker))
