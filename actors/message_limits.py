"""Limits on orders and on a robot's messages per step that the message types do not express.

Each function returns the fault as text that continues the sender's name, or None.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import msgspec

from actors import portable
from actors.instant import in_seconds
from actors.items import ITEM_LIMIT, TaskLimits, task_reports_fault
from actors.messages import FRAME_DATA_LIMIT, MOST_FRAMES, Drive, OutgoingFrame, Transmit
from actors.orders import ItemAssignment, Obstacle, Order, Speed, StartJam, Step, Wall
from actors.wording import bounds_text, short_repr


@dataclass(frozen=True)
class OrderLimits:
    """Limits of numbers in orders; own choices, far beyond any floor and any run."""

    coordinate: float = 1e6
    """Largest magnitude of x or y, m."""
    heading: float = 1e6
    """Largest magnitude of a heading, rad; headings are normalised to (-π, π]."""
    jam_radius: float = 1e6
    """Largest range of a jammer, m."""
    obstacle_radius: float = 100.0
    """Largest radius of an obstacle, m."""
    jam_us: int = 10**12
    """Longest jamming, µs: 11.6 days. The radio counts nanoseconds in 64 bits."""
    obstacles: int = 1000
    """Most obstacles on one floor; each adds to the cost of every later step."""
    wall: float = 75.0
    """Longest wall, m: the length of all obstacles in a row."""
    steps: int = 1_000_000
    """Most steps until a pause."""
    slowest: float = 0.01
    """Lowest speed, simulated seconds per second; 0 means unlimited and is always allowed."""
    fastest: float = 1e6
    items: int = 1000
    """Most items given to a robot after the start; a restarted robot receives them in one message."""
    refusals: int = 100
    """Most refusal messages kept; further ones are only counted."""


def order_fault(order: Order, limits: OrderLimits) -> str | None:
    """Return the fault in the numbers of an order, without a full stop, or None."""
    for name, value, low, high in _bounds(order, limits):
        above = name in {"radius", "duration"}
        if not low <= value <= high or (above and value == 0):
            right = bounds_text(gt=low, le=high) if above else bounds_text(ge=low, le=high)
            return f"{order.__struct_config__.tag}.{name} is {value:g}, but must be {right}"
    return None


def _bounds(order: Order, limits: OrderLimits) -> Iterator[tuple[str, float, float, float]]:
    """Yield the numbers of an order, m, rad or s: name, value, lower bound, upper bound."""
    far = limits.coordinate
    for name, most in (("x", far), ("y", far), ("to_x", far), ("to_y", far), ("heading", limits.heading)):
        if hasattr(order, name):
            yield name, getattr(order, name), -most, most
    match order:
        case Obstacle():
            yield "radius", order.radius, 0, limits.obstacle_radius
        case StartJam():
            yield "radius", order.radius, 0, limits.jam_radius
            yield "duration", in_seconds(order.duration), 0, in_seconds(limits.jam_us)
        case Wall():
            length = portable.hypot(order.to_x - order.x, order.to_y - order.y)
            yield "length", length, 0, limits.wall
        case ItemAssignment():
            yield "items", len(order.items), 1, limits.items
            for item in order.items:
                yield "items", len(msgspec.msgpack.encode(item)), 1, ITEM_LIMIT
        case Step():
            yield "steps", order.steps, 1, limits.steps
        case Speed() if order.factor != 0:
            yield "factor", order.factor, limits.slowest, limits.fastest


_TAGS: Final = 2**63


class MessageLimits(TaskLimits, frozen=True):
    """Limits of a robot's messages per step; own choices, far above what a strategy needs.

    Task reports must also fit into one message (actors.runtime.codec.MESSAGE_LIMIT).
    """

    frames: int = MOST_FRAMES


LIMITS: Final = MessageLimits()


def drive_fault(drive: Drive, step: int, begin: int, end: int) -> str | None:
    """Return the fault in a Drive, or None; the step that it answers lasts from `begin` to `end`, µs."""
    if drive.step != step:
        return f"sent a Drive of step {drive.step}, expected step {step}"
    if drive.reports or drive.given_up or drive.route is not None:
        return task_reports_fault(drive, begin, end, LIMITS)
    return None


def transmit_fault(transmit: Transmit, step: int, announced: int) -> str | None:
    """Return the fault in a Transmit as a whole, or None; its frames are checked one by one."""
    if transmit.step != step:
        return f"sent a Transmit of step {transmit.step}, expected step {step}"
    if len(transmit.frames) != announced:
        return f"announced {announced} frames, but its Transmit carries {len(transmit.frames)}"
    return None


def frames_fault(frames: Sequence[object], begin: int, end: int, limits: MessageLimits) -> str | None:
    """Return the fault in frames to be sent in the step from `begin` to `end`, µs, or None."""
    if len(frames) > limits.frames:
        return f"sends {len(frames)} frames in one step; the limit is {limits.frames}"
    earliest = begin
    for frame in frames:
        if not isinstance(frame, OutgoingFrame) or not isinstance(frame.data, bytes):
            return f"sends {short_repr(frame)}; a frame must be an OutgoingFrame with bytes"
        if wrong := _frame_fault(frame, earliest, end):
            return wrong
        earliest = frame.instant
    return None


def _frame_fault(frame: OutgoingFrame, earliest: int, end: int) -> str | None:
    if len(frame.data) > FRAME_DATA_LIMIT:
        return f"sends a frame of {len(frame.data)} bytes; the limit is {FRAME_DATA_LIMIT}"
    if type(frame.instant) is not int:
        return f"sends a frame at {short_repr(frame.instant)} µs; the instant must be an integer"
    if not earliest <= frame.instant < end:
        return f"sends a frame at {frame.instant} µs; the instant must be from {earliest} to {end - 1} µs"
    if not 0 <= frame.tag < _TAGS:
        return f"sends a frame with the tag {frame.tag}; the tag must be from 0 to {_TAGS - 1}"
    return None
