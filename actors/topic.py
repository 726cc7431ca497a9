"""Base classes of messages, and topics: keys with their message types."""

from typing import ClassVar, Generic, TypeVar

import msgspec


class Message(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A message between actors; `step` is the step that it belongs to."""

    omissible: ClassVar[int] = 0
    """Number of trailing fields that are not sent while they and all later ones have their default value."""
    step: int


class MessagePart(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A structured value within a message."""


M = TypeVar("M", bound=Message)


class Topic(Generic[M]):
    """A key, or one key per robot, with its message type."""

    def __init__(
        self,
        pattern: str,
        kind: type[M],
        *,
        is_digested: bool = False,
        is_telemetry: bool = False,
        is_from_outside: bool = False,
        is_recorded_only: bool = False,
        is_packed: bool = True,
    ) -> None:
        self.pattern = pattern
        self.kind = kind
        self.is_digested = is_digested
        """The run's digest covers its messages."""
        self.is_telemetry = is_telemetry
        """For display only: not counted, recorded or covered by the digest."""
        self.is_from_outside = is_from_outside
        """Published by clients that are not actors: sent and received counts cannot be compared."""
        self.is_recorded_only = is_recorded_only
        """Recorded in full by the sender and not published: outside digest, counts and barrier."""
        self.is_packed = is_packed
        """Recorded-only messages are deflated; False: they are compact already."""
        self._keys: dict[str, str] = {}

    def key(self, robot: str = "") -> str:
        """Return the key for `robot`, or the topic's only key."""
        key = self._keys.get(robot)
        if key is None:
            key = self._keys[robot] = self.pattern.replace("{id}", robot)
        return key

    def __repr__(self) -> str:
        return f"Topic({self.pattern!r}, {self.kind.__name__})"


def sender(key: str) -> str | None:
    """Return the only robot that may write to `key`, `swarm/up/<id>/…`; None for other keys."""
    parts = key.split("/")
    return parts[2] if parts[:2] == ["swarm", "up"] and len(parts) > 3 else None
