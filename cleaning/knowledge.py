"""What a cleaning robot lets the others know, and how that is written into a frame of the radio."""

import math
from enum import Enum
from typing import Annotated, Final

import msgspec

from actors.geometry import Point


class WorkState(Enum):
    """How a robot's work goes."""

    DRIVING = "driving"
    BLOCKED = "blocked"
    """Navigation gave the destination up."""
    IDLE = "idle"
    """It has no destination."""


class Knowledge(msgspec.Struct, frozen=True, array_like=True, forbid_unknown_fields=True):
    """What one robot publishes about itself."""

    id: Annotated[str, msgspec.Meta(min_length=1, max_length=32)]
    position: Point
    """m, map frame."""
    destination: Point | None
    """m, map frame."""
    state: WorkState


FRAME_LIMIT: Final = 100
"""Data bytes that knowledge may take; with an id of 32 letters and digits it takes 83 at most."""
_ENCODER: Final = msgspec.msgpack.Encoder()
_DECODER: Final = msgspec.msgpack.Decoder(Knowledge)


def pack(knowledge: Knowledge) -> bytes:
    """The frame's data: a msgpack array of the fields, at most FRAME_LIMIT bytes."""
    data = _ENCODER.encode(knowledge)
    assert len(data) <= FRAME_LIMIT
    return data


def unpack(data: bytes) -> Knowledge | None:
    """The knowledge in a frame, or None for anything else that the air may hold."""
    if len(data) > FRAME_LIMIT:
        return None
    try:
        knowledge = _DECODER.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return None
    points = (
        (knowledge.position,)
        if knowledge.destination is None
        else (knowledge.position, knowledge.destination)
    )
    return knowledge if all(math.isfinite(number) for point in points for number in point) else None
