"""Knowledge that logistics robots publish."""

from typing import Annotated

from actors.geometry import Point
from deeco import Knowledge, Resolution, role


@role
class Carrier(Knowledge):
    """Published state of a logistics robot."""

    position: Annotated[Point, Resolution(1000)]
    """Estimated position, m, map frame."""
    charge: Annotated[float, Resolution(10_000)] = 1.0
    """Charge of its battery, 0 to 1; 1 if unknown."""
    charger: int = -1
    """Index of the charger that it uses or wants; -1: none."""
    is_blocked: bool = False
    """It has a target and does not move."""
