"""A door of a floor: what strategies are told of it, without what computes it."""

from dataclasses import dataclass

from actors.geometry import Point


@dataclass(frozen=True)
class Door:
    """A narrow place between regions."""

    index: int
    """Its place in the map's list of doors."""
    middle: Point
    """A point of it with the most room, m."""
    regions: tuple[int, ...]
    """The regions that it joins, two or more, ascending."""
