"""The small interface behind which Zenoh, memory and replay look alike to an actor."""

from typing import Protocol

import msgspec

from actors.topic import Message, Topic


class Delivery(msgspec.Struct, frozen=True, gc=False):
    """Encoded bytes that arrived on a key."""

    topic: Topic[Message]
    key: str
    payload: bytes


class Outlet(Protocol):
    """The sending half of a bus; keeps the order of one sender's messages on one key."""

    def publish(self, key: str, payload: bytes) -> None:
        """Hand `payload` to everyone who listens to `key`; never drops."""


class Bus(Outlet, Protocol):
    """A bus from which an actor fetches what it waits for: the mesh, or a recording.

    In memory nobody can wait: there the bus hands each message to the shells that listen (`MemoryBus`).
    """

    def receive(self, topic: Topic[Message]) -> Delivery:
        """The next message on any key of `topic`; waits for it."""

    def poll(self, topic: Topic[Message]) -> Delivery | None:
        """The next message on any key of `topic` if one is there."""
