"""What every message is, and on which key which message travels."""

from typing import ClassVar, Generic, TypeVar

import msgspec


class Message(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A value that travels between actors; `step` is the step it belongs to."""

    omissible: ClassVar[int] = 0
    """So many of the last fields do not travel while all of them are empty."""
    step: int


class MessagePart(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """A value inside a message."""


M = TypeVar("M", bound=Message)


class Topic(Generic[M]):
    """A key, or a family of keys with one robot id in it, and the type of what travels there."""

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
        """Its messages make up the run's digest."""
        self.is_telemetry = is_telemetry
        """They are only shown to people: neither counted, nor recorded, nor in the digest."""
        self.is_from_outside = is_from_outside
        """No actor publishes them, so they cannot be balanced against what was received."""
        self.is_recorded_only = is_recorded_only
        """Its sender records them in full and publishes none: outside digest, counts and barrier."""
        self.is_packed = is_packed
        """Where they are only recorded, they are deflated; False: they are compact as they are."""
        self._keys: dict[str, str] = {}

    def key(self, robot: str = "") -> str:
        """The key for `robot`, or the topic's only key."""
        key = self._keys.get(robot)
        if key is None:
            key = self._keys[robot] = self.pattern.replace("{id}", robot)
        return key

    def __repr__(self) -> str:
        return f"Topic({self.pattern!r}, {self.kind.__name__})"


def sender(key: str) -> str | None:
    """The robot that alone may write to `key`, `swarm/up/<id>/…`; None for a key of somebody else."""
    parts = key.split("/")
    return parts[2] if parts[:2] == ["swarm", "up"] and len(parts) > 3 else None
