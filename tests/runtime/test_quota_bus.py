"""What one sender may leave unread is bounded over all his keys; the others go on, and he is named."""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import pytest

from actors.messages import DRIVE, READY
from actors.runtime.bus.quota_bus import QuotaBus
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from actors.topic import Message, Topic

DRIVES, READIES = cast(Topic[Message], DRIVE), cast(Topic[Message], READY)


class Payload(NamedTuple):
    """As Zenoh hands it over."""

    data: bytes

    def to_bytes(self) -> bytes:
        return self.data


class Sample(NamedTuple):
    """As Zenoh hands it over."""

    key_expr: str
    payload: Payload


class Session:
    """Hands over what the test says."""

    def __init__(self) -> None:
        self.listeners: dict[str, Callable[[Any], None]] = {}

    def declare_subscriber(self, key: str, listener: Callable[[Any], None]) -> None:
        self.listeners[key] = listener


class Mesh:
    """A bus over such a session."""

    def __init__(self) -> None:
        session = Session()
        self.bus = QuotaBus(session, (at(DRIVE, "*"), at(READY, "*")))  # type: ignore[arg-type]
        self._listeners = session.listeners

    def arrive(self, topic: Any, robot: str, size: int = 1, times: int = 1) -> None:
        """So many messages from the robot."""
        for _ in range(times):
            self._listeners[topic.key("*")](Sample(topic.key(robot), Payload(bytes(size))))


def test_whoever_keeps_to_his_quota_is_heard_for_ever() -> None:
    mesh = Mesh()
    for _ in range(5):
        mesh.arrive(DRIVE, "r1", times=QuotaBus.MESSAGES)
        for _ in range(QuotaBus.MESSAGES):
            assert mesh.bus.receive(DRIVES).key == DRIVE.key("r1")
    assert mesh.bus.poll(DRIVES) is None


@pytest.mark.parametrize("waiting_for", [DRIVES, READIES])
def test_a_flood_over_two_keys_is_one_flood(waiting_for: Any) -> None:
    mesh = Mesh()
    mesh.arrive(DRIVE, "r1", times=QuotaBus.MESSAGES // 2)
    mesh.arrive(READY, "r1", times=QuotaBus.MESSAGES // 2)
    mesh.arrive(DRIVE, "r2", times=QuotaBus.MESSAGES)
    assert mesh.bus.receive(DRIVES).key == DRIVE.key("r1")
    mesh.arrive(READY, "r1", times=2)
    with pytest.raises(AcrcError) as caught:
        mesh.bus.receive(waiting_for)
    assert str(caught.value) == (
        f"r1 floods {READY.key('r1')}: 1001 messages of together 1001 bytes wait and nobody has asked "
        "for them; at most 1000 of together 67108864 may wait"
    )


def test_few_messages_that_are_large_are_a_flood() -> None:
    mesh = Mesh()
    mesh.arrive(DRIVE, "r1", size=QuotaBus.BYTES // 2, times=2)
    assert mesh.bus.poll(DRIVES) is not None
    mesh.arrive(DRIVE, "r1", size=QuotaBus.BYTES // 2, times=1)
    mesh.arrive(READY, "r1")
    with pytest.raises(
        AcrcError, match=f"^r1 floods {READY.key('r1')}: 3 messages of together 67108865 bytes"
    ):
        mesh.bus.poll(READIES)


def test_after_a_flood_nothing_more_is_kept() -> None:
    mesh = Mesh()
    mesh.arrive(DRIVE, "r1", times=QuotaBus.MESSAGES + 1)
    mesh.arrive(READY, "r2", times=10)
    assert mesh.bus._queues[READIES].qsize() == 1, "the flood's end alone, which wakes who waits there"
