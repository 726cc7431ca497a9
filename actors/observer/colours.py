"""The colours of everything that is drawn of a run, in windows and in pictures, in one place.

Robots' first six colours are those of Okabe and Ito, "Color universal design" (2008), so ordered that
neighbours differ
for colour-blind eyes, too; the first four differ from black and from white with a contrast of at least 3.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

Colour = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

ROBOTS: Final[tuple[Colour, ...]] = (
    (0, 114, 178),
    (213, 94, 0),
    (0, 158, 115),
    (204, 121, 167),
    (230, 159, 0),
    (86, 180, 233),
    (120, 105, 105),
    (135, 105, 75),
)
"""In the scenario's order; then they repeat. Any two differ by 10 or more in CIEDE2000 for normal, protanopic
and deuteranopic eyes; the last two are own choices."""
GROUND: Final = 13
"""Brightness around the floor, in a window."""
FLOOR: Final = 26
WALL: Final = 150
WHITE: Final[Colour] = (255, 255, 255)
GREY: Final[Colour] = (130, 130, 130)
FATES: Final[Mapping[str, Colour]] = MappingProxyType(
    {
        "heard": (0, 114, 178),
        "collision": (213, 60, 40),
        "disturbed": (204, 121, 167),
        "half duplex": (230, 159, 0),
        "receiver busy": (138, 109, 59),
        "below sensitivity": (128, 128, 128),
        "powered off": (90, 90, 96),
        "withheld": (148, 103, 189),
    }
)
"""What may become of a copy of a frame."""
LINK: Final[Colour] = (200, 225, 255)
"""Of the strongest."""
SCAN: Final[Colour] = WHITE
PARTICLES: Final[Colour] = (120, 230, 120)
PLAN: Final[Colour] = (255, 220, 90)
COSTS_COLOUR: Final[Colour] = (120, 110, 200)
"""Of what is dear to drive through."""
ARC: Final[Colour] = (255, 90, 200)


def robot(index: int) -> Colour:
    """The colour of the robot with this index in the run's order."""
    return ROBOTS[index % len(ROBOTS)]


def faded(colour: Colour, share: float, ground: Colour = (FLOOR, FLOOR, FLOOR)) -> Colour:
    """So much of the colour, 0 to 1, and the rest of what is behind it."""
    red, green, blue = (
        round(part * share + rest * (1 - share)) for part, rest in zip(colour, ground, strict=True)
    )
    return red, green, blue


def contrast(one: Colour, other: Colour) -> float:
    """The contrast ratio of WCAG 2.1, 1 to 21."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def hexadecimal(colour: Colour) -> str:
    """As "#0072b2"."""
    return "#" + "".join(f"{part:02x}" for part in colour)


def _luminance(colour: Colour) -> float:
    linear = [part / 255 / 12.92 if part <= 10 else ((part / 255 + 0.055) / 1.055) ** 2.4 for part in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
