"""Limits of messages that their types do not express: of orders, and of what a robot sends in a step.

Each function returns what is wrong, in words that follow the sender's name, or None.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from actors import portable
from actors.instant import in_seconds
from actors.messages import FRAME_DATA_LIMIT, MOST_FRAMES, Drive, Outgoing, Transmit
from actors.orders import Give, Obstacle, Order, Speed, StartJam, Step, Wall
from actors.task.task import TaskLimits, words_fault
from actors.wording import brief, span


@dataclass(frozen=True)
class OrderLimits:
    """Limits of the numbers in orders; own choices, far beyond any floor and any run."""

    coordinate: float = 1e6
    """Greatest x or y, m, either sign."""
    heading: float = 1e6
    """Greatest heading, rad, either sign; it is brought into (-π, π]."""
    jam_radius: float = 1e6
    """Greatest reach of a jammer, m."""
    obstacle_radius: float = 100.0
    """Greatest radius of an obstacle, m."""
    jam_us: int = 10**12
    """Longest jam, µs: 11.6 days. The radio counts nanoseconds in 64 bits."""
    obstacles: int = 1000
    """Obstacles on one floor; each one costs every later step."""
    wall: float = 75.0
    """Longest wall, m: as long as all obstacles in a row."""
    steps: int = 1_000_000
    """Most steps to a pause."""
    slowest: float = 0.01
    """Least simulated seconds per second, but for 0, which stands for no limit."""
    fastest: float = 1e6
    places: int = 1000
    """Places that a robot is given after the start; all of them fit one message to a new process of it."""
    refusals: int = 100
    """Sentences on refused orders that are kept; what comes after is counted."""


def fault(order: Order, limits: OrderLimits) -> str | None:
    """Return what is wrong with the numbers of an order, as a sentence without a full stop, or None."""
    for name, value, low, high in _bounds(order, limits):
        above = name in {"radius", "duration"}
        if not low <= value <= high or (above and value == 0):
            right = span(gt=low, le=high) if above else span(ge=low, le=high)
            return f"{order.__struct_config__.tag}.{name} is {value:g}, but must be {right}"
    return None


def _bounds(order: Order, limits: OrderLimits) -> Iterator[tuple[str, float, float, float]]:
    """Yield the numbers of an order, m, rad and s: each with its name, its lower and its upper bound."""
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
        case Give():
            yield "places", len(order.places), 1, limits.places
            for place in order.places:
                yield from (("places", coordinate, -far, far) for coordinate in place)
        case Step():
            yield "steps", order.steps, 1, limits.steps
        case Speed() if order.factor != 0:
            yield "factor", order.factor, limits.slowest, limits.fastest


_TAGS: Final = 2**63


@dataclass(frozen=True)
class MessageLimits(TaskLimits):
    """How much a robot may send in one step; own choices, far above what a strategy needs.

    Its reports of places must also fit one message (actors.runtime.codec.MESSAGE_LIMIT).
    """

    frames: int = MOST_FRAMES


LIMITS: Final = MessageLimits()


def drive_fault(drive: Drive, step: int, begin: int, end: int) -> str | None:
    """Return what is wrong with a Drive that answers the Senses of the step from `begin` to `end`, µs."""
    if drive.step != step:
        return f"answers with a Drive of step {drive.step}; it should be of step {step}"
    if drive.reports or drive.given_up or drive.route is not None:
        return words_fault(drive, begin, end, LIMITS)
    return None


def transmit_fault(transmit: Transmit, step: int, announced: int) -> str | None:
    """Return what is wrong with a Transmit as a whole; each of its frames is taken or refused by itself."""
    if transmit.step != step:
        return f"gives a Transmit of step {transmit.step}; it should be of step {step}"
    if len(transmit.frames) != announced:
        return f"announced {announced} frames, but its Transmit carries {len(transmit.frames)}"
    return None


def frames_fault(frames: Sequence[object], begin: int, end: int, limits: MessageLimits) -> str | None:
    """Return what is wrong with frames to be sent in the step from `begin` to `end`, µs."""
    if len(frames) > limits.frames:
        return f"sends {len(frames)} frames in one step; at most {limits.frames} may be"
    earliest = begin
    for frame in frames:
        if not isinstance(frame, Outgoing) or not isinstance(frame.data, bytes):
            return f"sends {brief(frame)}; it should be an Outgoing with bytes"
        if wrong := _frame_fault(frame, earliest, end):
            return wrong
        earliest = frame.instant
    return None


def _frame_fault(frame: Outgoing, earliest: int, end: int) -> str | None:
    if len(frame.data) > FRAME_DATA_LIMIT:
        return f"sends a frame of {len(frame.data)} bytes; it should have at most {FRAME_DATA_LIMIT}"
    if type(frame.instant) is not int:
        return f"sends a frame at {brief(frame.instant)} µs; it should be a whole number"
    if not earliest <= frame.instant < end:
        return f"sends a frame at {frame.instant} µs; it should be sent from {earliest} to {end - 1} µs"
    if not 0 <= frame.tag < _TAGS:
        return f"sends a frame with the tag {frame.tag}; it should be 0 to {_TAGS - 1}"
    return None
