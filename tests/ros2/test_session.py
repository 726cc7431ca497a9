"""A session of a ROS 2 node: connection, bounded queues, graph and attachments."""

import time
from collections.abc import Callable, Iterator

import pytest

from actors.instant import Instant
from firmware_bridge.ros2 import message_types
from firmware_bridge.ros2.names import Attachment, EndpointKind, QosProfile
from firmware_bridge.ros2.session import ReceivedSample, Ros2Session, Subscription
from firmware_bridge.ros2.settings import RouterLink
from tests.helpers import free_port
from tests.ros2.routers import start_router

TWIST = "geometry_msgs/msg/Twist"
_TIMEOUT_S = 10.0


def wait_for(condition: Callable[[], object], timeout_s: float = _TIMEOUT_S) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "timeout"
        time.sleep(0.01)


@pytest.fixture
def link() -> Iterator[RouterLink]:
    yield RouterLink(router=f"tcp/127.0.0.1:{free_port()}", domain=7, namespace="/r1")


def session(link: RouterLink, name: str, *, serves: bool = False) -> Ros2Session:
    return Ros2Session(link, name, lambda: Instant(time.monotonic_ns() // 1000), serves=serves)


def twist(v: float) -> bytes:
    vector = message_types.new("geometry_msgs/Vector3", x=v, y=0.0, z=0.0)
    return message_types.encode(
        message_types.new("geometry_msgs/Twist", linear=vector, angular=vector), TWIST
    )


def test_two_nodes_exchange_messages_across_a_restart_of_their_router(link: RouterLink) -> None:
    port = int(link.router.rpartition(":")[2])
    with session(link, "driver") as one, session(link, "base") as other:
        publisher = one.publisher("/r1/cmd_vel", TWIST)
        received = other.subscribe("/r1/cmd_vel", TWIST)
        wait_for(lambda: one.fault.startswith("Unable to connect"))  # the router does not run yet
        publisher.put(twist(0.1), 1)
        assert publisher.unsent == 1
        for number in (1, 2):
            router = start_router(port)
            wait_for(lambda: one.is_connected and other.is_connected)
            wait_for(lambda: len(one.endpoints()) == len(other.endpoints()) == 2)
            time.sleep(0.1)  # subscriptions reach the publisher's session
            publisher.put(twist(0.2), 5)
            samples: list[ReceivedSample] = []
            wait_for(lambda samples=samples: samples.extend(received.take()) or samples)  # type: ignore[misc]
            (sample,) = samples
            assert message_types.decode(sample.payload, TWIST).linear.x == 0.2
            assert sample.type_hash == message_types.type_hash(TWIST)
            assert sample.attachment == Attachment(number, 5, publisher.gid)
            assert other.publisher_names("/r1/cmd_vel") == {publisher.gid: "/r1/driver"}
            (subscription,) = (end for end in one.endpoints() if end.kind is EndpointKind.SUBSCRIPTION)
            assert (subscription.node, subscription.topic, subscription.type) == (
                "/r1/base",
                "/r1/cmd_vel",
                TWIST,
            )
            router.close()  # type: ignore[no-untyped-call]
            wait_for(lambda: not one.is_connected and not one.endpoints()[2:])


def test_a_full_queue_drops_the_oldest_publication_and_counts_it() -> None:
    subscription = Subscription(2)
    for number in range(5):
        subscription.add(ReceivedSample(Instant(0), b"%d" % number, "", Attachment(number, 0, bytes(16))))
    assert [one.payload for one in subscription.take()] == [b"3", b"4"]
    assert (subscription.dropped, subscription.publishers[bytes(16)], subscription.take()) == (3, 5, [])


@pytest.mark.parametrize("profile", [QosProfile(), QosProfile(False, False, 5), QosProfile(True, True, 1)])
def test_a_profile_survives_its_token(profile: QosProfile) -> None:
    assert QosProfile.decode(profile.encode()) == profile
