"""The numbers that an order may hold, checked before anything is touched."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from actors.instant import in_seconds
from actors.messages import CloseDoor, Give, Move, Obstacle, OpenDoor, Order, StartJam


@dataclass(frozen=True)
class OrderLimits:
    """How far an order may go; own choices, far beyond any floor and any run."""

    coordinate: float = 1e6
    """Greatest x or y, m, either sign."""
    heading: float = 1e6
    """Greatest heading, rad, either sign; it is brought into (-π, π]."""
    jam_radius: float = 1e6
    """Greatest reach of a jammer, m."""
    jam_us: int = 10**12
    """Longest jam, µs: 11.6 days. The radio counts nanoseconds in 64 bits."""
    obstacles: int = 1000
    """Obstacles on one floor; each one costs every later step."""
    places: int = 1000
    """Places that a robot is given after the start; all of them fit one message to a new process of it."""
    refusals: int = 100
    """Sentences on refused orders that are kept; what comes after is counted."""


def fault(order: Order, limits: OrderLimits) -> str | None:
    """What is wrong with the numbers of an order, in words without an end; None if nothing is."""
    match order:
        case Move(robot, x, y, heading):
            if not _within(limits.coordinate, x, y) or not _within(limits.heading, heading):
                return (
                    f"{robot} cannot move to ({x:g}, {y:g}) with heading {heading:g}; each should be a "
                    f"finite number, at most {limits.coordinate:g} m and {limits.heading:g} rad"
                )
        case StartJam():
            return _jam_fault(order, limits)
        case Obstacle(x, y) if not _within(limits.coordinate, x, y):
            return f"an obstacle cannot stand at ({x:g}, {y:g}); {_finite(limits)}"
        case Give(robot, places):
            return _places_fault(robot, places, limits)
        case CloseDoor(x, y) | OpenDoor(x, y) if not _within(limits.coordinate, x, y):
            return f"there is no door at ({x:g}, {y:g}); {_finite(limits)}"
    return None


def _jam_fault(jam: StartJam, limits: OrderLimits) -> str | None:
    if not _within(limits.coordinate, jam.x, jam.y):
        return f"a jammer cannot stand at ({jam.x:g}, {jam.y:g}); {_finite(limits)}"
    if not 0 < jam.radius <= limits.jam_radius:
        return f"a jammer reaches {jam.radius:g} m; it should be above 0 and at most {limits.jam_radius:g} m"
    if not 0 < jam.duration <= limits.jam_us:
        return (
            f"a jammer is on for {in_seconds(jam.duration):g} s; "
            f"it should be above 0 and at most {in_seconds(limits.jam_us):g} s"
        )
    return None


def _finite(limits: OrderLimits) -> str:
    return f"each should be a finite number, at most {limits.coordinate:g} m"


def _places_fault(robot: str, places: Sequence[tuple[float, float]], limits: OrderLimits) -> str | None:
    if not 0 < len(places) <= limits.places:
        return f"{robot} is given {len(places)} places; it should be 1 to {limits.places}"
    for x, y in places:
        if not _within(limits.coordinate, x, y):
            return f"{robot} cannot clean at ({x:g}, {y:g}); {_finite(limits)}"
    return None


def _within(greatest: float, *values: float) -> bool:
    return all(math.isfinite(value) and abs(value) <= greatest for value in values)
