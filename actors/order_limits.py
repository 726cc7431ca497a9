"""The numbers that an order may hold, checked before anything is touched."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from actors import portable
from actors.instant import in_seconds
from actors.orders import CloseDoor, Give, Move, Obstacle, OpenDoor, Order, Speed, StartJam, Step, Wall


@dataclass(frozen=True)
class OrderLimits:
    """How far an order may go; own choices, far beyond any floor and any run."""

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
    """What is wrong with the numbers of an order, in words without an end; None if nothing is."""
    if isinstance(order, Wall):
        return _wall_fault(order, limits)
    if isinstance(order, Step | Speed):
        return _rhythm_fault(order, limits)
    if isinstance(order, StartJam):
        return _jam_fault(order, limits)
    if isinstance(order, Give):
        return _places_fault(order.robot, order.places, limits)
    return _point_fault(order, limits)


def _point_fault(order: Order, limits: OrderLimits) -> str | None:
    match order:
        case Move(robot, x, y, heading):
            if not _within(limits.coordinate, x, y) or not _within(limits.heading, heading):
                return (
                    f"{robot} cannot move to ({x:g}, {y:g}) with heading {heading:g}; each should be a "
                    f"finite number, at most {limits.coordinate:g} m and {limits.heading:g} rad"
                )
        case Obstacle(x, y) if not _within(limits.coordinate, x, y):
            return f"an obstacle cannot stand at ({x:g}, {y:g}); {_finite(limits)}"
        case Obstacle(radius=radius) if not 0 < radius <= limits.obstacle_radius:
            return (
                f"an obstacle has a radius of {radius:g} m; it should be above 0 and at most "
                f"{limits.obstacle_radius:g} m"
            )
        case CloseDoor(x, y) | OpenDoor(x, y) if not _within(limits.coordinate, x, y):
            return f"there is no door at ({x:g}, {y:g}); {_finite(limits)}"
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


def _wall_fault(wall: Wall, limits: OrderLimits) -> str | None:
    if not _within(limits.coordinate, wall.x, wall.y, wall.to_x, wall.to_y):
        return (
            f"a wall cannot stand from ({wall.x:g}, {wall.y:g}) to ({wall.to_x:g}, {wall.to_y:g}); "
            f"{_finite(limits)}"
        )
    length = portable.hypot(wall.to_x - wall.x, wall.to_y - wall.y)
    too_long = f"a wall is {length:g} m long; it should be at most {limits.wall:g} m"
    return too_long if length > limits.wall else None


def _rhythm_fault(order: Step | Speed, limits: OrderLimits) -> str | None:
    if isinstance(order, Step):
        within = 0 < order.steps <= limits.steps
        return None if within else f"{order.steps} steps; it should be 1 to {limits.steps}"
    if order.factor == 0 or limits.slowest <= order.factor <= limits.fastest:
        return None
    return f"{order.factor:g} simulated seconds per second; must be {limits.slowest:g} to {limits.fastest:g}"


def _within(greatest: float, *values: float) -> bool:
    return all(math.isfinite(value) and abs(value) <= greatest for value in values)
