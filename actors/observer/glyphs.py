"""The one drawing language: a word, a colour and a hatch for each state of a robot, a mark for each thing.

Windows, pages, pictures and reports draw with these and nothing else. Two states that stand in one picture
differ by 10 or more in CIEDE2000 for normal, protanopic and deuteranopic eyes; hatches tell them apart in
grey.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

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
RADIUS: Final = 0.177
"""Of a drawn robot, m: a TurtleBot 2 as in the original's Stage model (0.354 m wide)."""
_FEW: Final = 12
GROUND: Final = 13
"""Brightness around the floor, in a window."""
FLOOR: Final = 26
WALL: Final = 150
WHITE: Final[Colour] = (255, 255, 255)
BLACK: Final[Colour] = (0, 0, 0)
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


def has_few(robots: Sequence[str]) -> bool:
    """Return True for so few robots that each has its name and its marks."""
    return len(robots) <= _FEW


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


class StateGlyph(NamedTuple):
    """How a state of a robot is drawn."""

    colour: Colour
    hatch: str
    """As matplotlib has them; empty: none."""


class Mark(NamedTuple):
    """How a thing on the floor is drawn."""

    shape: str
    """`ring`, `disc`, `diamond`, `cross`, `square`, `tint`, `bar`, `dashed ring`, `soft ring`, `heavy cross`,
    `snowflake`, `dotted line`, `tick` or `triangle`."""
    colour: Colour | None
    """None: that of the robot whose it is."""
    says: str
    """For a legend."""


SEEN_STATES: Final[Mapping[str, StateGlyph]] = MappingProxyType(
    {
        "driving": StateGlyph((54, 126, 93), ""),
        "waiting at a door": StateGlyph((246, 122, 85), ""),
        "blocked on open floor": StateGlyph((252, 192, 131), "//"),
        "deadlock": StateGlyph((101, 7, 0), "xx"),
        "livelock": StateGlyph((131, 183, 167), "++"),
        "blocked by dead robot": StateGlyph((162, 46, 167), "\\\\"),
        "done robot in the way": StateGlyph((207, 171, 243), "||"),
        "closed door": StateGlyph((88, 84, 83), "--"),
        "unreachable": StateGlyph((2, 21, 125), "oo"),
        "no plan": StateGlyph((3, 75, 44), ".."),
        "waits on purpose": StateGlyph((157, 89, 0), "///"),
        "no progress": StateGlyph((231, 216, 9), ""),
        "lost": StateGlyph((189, 121, 249), "**"),
        "strategy idle": StateGlyph((235, 217, 191), "---"),
        "idle": StateGlyph((79, 90, 112), "."),
        "frozen": StateGlyph((64, 134, 146), "OO"),
        "off": StateGlyph((17, 19, 28), ""),
    }
)
"""By ground truth: the causes, in the order in which a report stacks them."""
OWN_STATES: Final[Mapping[str, StateGlyph]] = MappingProxyType(
    {
        **{word: SEEN_STATES[word] for word in ("driving", "deadlock", "idle", "frozen", "off")},
        "planning": StateGlyph((35, 59, 88), "//"),
        "no trajectory": StateGlyph((176, 112, 9), "\\\\"),
        "backing out": StateGlyph((105, 79, 8), "||"),
        "blocked": StateGlyph((181, 65, 61), "xx"),
        "adopted": StateGlyph((4, 79, 210), "++"),
        "elsewhere": StateGlyph((143, 101, 235), ".."),
        "paused": StateGlyph((19, 38, 164), "--"),
        "aborted": StateGlyph((226, 71, 107), "oo"),
        "standing": StateGlyph((70, 69, 73), "**"),
        "not heard": StateGlyph((33, 9, 1), "---"),
    }
)
"""By the robot's own account, or seen from outside while nobody knows more, and `deadlock`, which ground
truth knows alone. White letters can be read on each."""

PUT: Final[Colour] = (195, 30, 135)
"""What was put on the floor."""
JAM: Final[Colour] = (90, 135, 255)
DOOR: Final[Colour] = (255, 210, 127)
"""On paper; on a dark ground faded."""
CLOSED: Final[Colour] = (176, 98, 28)
RED: Final[Colour] = (193, 39, 45)

MARKS: Final[Mapping[str, Mark]] = MappingProxyType(
    {
        "open": Mark("ring", None, "place still open, in its owner's colour"),
        "given": Mark("diamond", None, "place that came while the run went on"),
        "done": Mark("disc", None, "place done: filled as who cleaned it, ringed as its owner"),
        "given up": Mark("cross", None, "place given up, or reported and not cleaned"),
        "start": Mark("square", None, "start of a robot; its disc: where it is, or ended"),
        "off": Mark("heavy cross", None, "a robot was off here"),
        "frozen": Mark("snowflake", None, "a robot was frozen here"),
        "carried": Mark("dotted line", None, "a robot was carried"),
        "stood": Mark("soft ring", RED, "stood before another robot here, for so many s"),
        "door": Mark("tint", DOOR, "door of the map"),
        "closed door": Mark("bar", CLOSED, "door that was closed"),
        "wall": Mark("bar", PUT, "wall that was put there"),
        "obstacle": Mark("disc", PUT, "thing that was put there"),
        "jammer": Mark("dashed ring", JAM, "jammer: nothing is heard inside"),
        "cleaned": Mark("tick", None, "cleaned a place, in its owner's colour"),
        "took over": Mark("triangle", None, "took a place over"),
    }
)
"""What stands on a floor or in a lane."""
