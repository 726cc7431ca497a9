"""The numbers that an order may hold, checked before anything is touched."""

import math
from dataclasses import dataclass

from actors.instant import in_seconds
from actors.messages import Move, Obstacle, Order, StartJam


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
        case StartJam(x, y, radius, duration):
            if not _within(limits.coordinate, x, y):
                return (
                    f"a jammer cannot stand at ({x:g}, {y:g}); "
                    f"each should be a finite number, at most {limits.coordinate:g} m"
                )
            if not 0 < radius <= limits.jam_radius:
                return (
                    f"a jammer reaches {radius:g} m; it should be above 0 and at most {limits.jam_radius:g} m"
                )
            if not 0 < duration <= limits.jam_us:
                return (
                    f"a jammer is on for {in_seconds(duration):g} s; "
                    f"it should be above 0 and at most {in_seconds(limits.jam_us):g} s"
                )
        case Obstacle(x, y) if not _within(limits.coordinate, x, y):
            return (
                f"an obstacle cannot stand at ({x:g}, {y:g}); "
                f"each should be a finite number, at most {limits.coordinate:g} m"
            )
    return None


def _within(greatest: float, *values: float) -> bool:
    return all(math.isfinite(value) and abs(value) <= greatest for value in values)
