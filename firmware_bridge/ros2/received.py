"""Decoding of received publications: type hash and payload."""

from typing import Any

from firmware_bridge.ros2.message_types import InvalidMessageError, decode, type_hash
from firmware_bridge.ros2.names import NO_HASH
from firmware_bridge.ros2.session import ReceivedSample


def decode_sample(sample: ReceivedSample, kind: str) -> Any:
    """Return the message of a publication. Raises InvalidMessageError."""
    expected = type_hash(kind)
    if sample.type_hash not in {"", NO_HASH, expected}:
        raise InvalidMessageError(
            f"{kind}: the robot's definition differs from ours: type hash {sample.type_hash[:80]}, "
            f"not {expected}"
        )
    return decode(sample.payload, kind)
