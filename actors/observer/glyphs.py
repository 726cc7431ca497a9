"""Colours, hatches and marks shared by the viewer, pages, pictures and reports.

Any two states in one picture differ by at least 10 in CIEDE2000 for normal, protanopic and deuteranopic
vision; hatches distinguish them in grey.
"""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from actors.runtime.errors import printable
from actors.task.task import SYMBOLS, MarkStyle, TaskDeclaration, style_fault

Colour = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""


def colour_of(text: str) -> Colour:
    """Return a colour such as "#0072b2"."""
    red, green, blue = bytes.fromhex(text.removeprefix("#"))
    return red, green, blue


ROBOTS: Final = tuple(
    map(
        colour_of,
        ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#786969", "#87694b"),
    )
)
"""Robot colours in scenario order, then repeated. Any two differ by 10 or more in CIEDE2000 for
normal, protanopic and deuteranopic vision; the last two are chosen here."""
RADIUS: Final = 0.177
"""Radius of a drawn robot, m: a TurtleBot 2 as in the original's Stage model (0.354 m wide)."""
PERSON_RADIUS: Final = 0.25
"""Radius of a drawn person, m, as of its body (`actors.world.social_force`)."""
_FEW: Final = 12
GROUND: Final = 13
"""Brightness around the floor in the viewer."""
FLOOR: Final = 26
WALL: Final = 150
WHITE: Final = (255, 255, 255)
BLACK: Final = (0, 0, 0)
GREY: Final = (130, 130, 130)
_STYLES: Final = tomllib.loads(Path(__file__).with_name("glyphs.toml").read_text("utf-8"))
OUTCOME_COLOURS: Final = MappingProxyType(
    {name: colour_of(text) for name, text in _STYLES["outcomes"].items()}
)
"""Colours of outcomes of frames."""
LINK: Final = (200, 225, 255)
"""Colour of the strongest link."""
SCAN: Final = WHITE
PARTICLES: Final = (120, 230, 120)
PLAN: Final = (255, 220, 90)
COSTS_COLOUR: Final = (120, 110, 200)
"""Colour of costs in the cost map."""
ARC: Final = (255, 90, 200)


def is_small_swarm(robots: Sequence[str]) -> bool:
    """Return True for few robots, which get individual names and marks."""
    return len(robots) <= _FEW


def robot(index: int) -> Colour:
    """Return the colour of a robot by its index in scenario order."""
    return ROBOTS[index % len(ROBOTS)]


def faded(colour: Colour, share: float, ground: Colour = (FLOOR, FLOOR, FLOOR)) -> Colour:
    """Blend a colour with the background; `share`: of the colour, 0 to 1."""
    red, green, blue = (
        round(part * share + rest * (1 - share)) for part, rest in zip(colour, ground, strict=True)
    )
    return red, green, blue


def contrast(one: Colour, other: Colour) -> float:
    """Return the contrast ratio of WCAG 2.1, 1 to 21."""
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def hexadecimal(colour: Colour) -> str:
    """Return a colour such as "#0072b2"."""
    return "#" + "".join(f"{part:02x}" for part in colour)


def _luminance(colour: Colour) -> float:
    linear = [part / 255 / 12.92 if part <= 10 else ((part / 255 + 0.055) / 1.055) ** 2.4 for part in colour]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


class StateGlyph(NamedTuple):
    """Colour and hatch of a robot's state."""

    colour: Colour
    hatch: str
    """Hatch of matplotlib; empty: none."""


class Mark(NamedTuple):
    """Mark on a floor or in a lane."""

    shape: str
    """One of SYMBOLS, or `tint`, `bar`, `dashed ring` or `dotted line`."""
    colour: Colour | None
    """None: the colour of the robot concerned."""
    meaning: str
    """Text of the legend."""


def _glyphs(styles: Mapping[str, tuple[str, str]]) -> Mapping[str, StateGlyph]:
    """Return glyphs, from colours such as "#0072b2" and hatches."""
    return MappingProxyType(
        {name: StateGlyph(colour_of(colour), hatch) for name, (colour, hatch) in styles.items()}
    )


CAUSE_GLYPHS: Final = _glyphs(_STYLES["causes"])
"""Causes by ground truth, in the stacking order of reports."""
ACTIVITY_GLYPHS: Final = MappingProxyType(
    {word: CAUSE_GLYPHS[word] for word in ("driving", "deadlock", "idle", "frozen", "off")}
    | dict(_glyphs(_STYLES["activities"]))
)
"""Activities that a robot reports, else observed ones, and `deadlock` by ground truth. All have enough
contrast to white text."""

PUT: Final = (195, 30, 135)
"""Colour of added obstacles and walls."""
JAM: Final = (90, 135, 255)
DOOR: Final = (255, 210, 127)
"""Colour of doors on a light background."""
CLOSED: Final = (176, 98, 28)
RED: Final = (193, 39, 45)
PERSON: Final = (118, 150, 0)
"""Colour of people, on light and dark backgrounds."""

MARKS: Final = MappingProxyType(
    {
        "start": Mark("square", None, "start of a robot; disc with name: latest position"),
        "off": Mark("heavy cross", None, "robot off"),
        "frozen": Mark("snowflake", None, "robot frozen"),
        "carried": Mark("dotted line", None, "robot carried"),
        "stood": Mark("soft ring", RED, "robots blocked each other here, total time"),
        "door": Mark("tint", DOOR, "door of the map"),
        "closed door": Mark("bar", CLOSED, "closed door"),
        "wall": Mark("bar", PUT, "added wall"),
        "obstacle": Mark("disc", PUT, "added obstacle"),
        "person": Mark("filled ring", PERSON, "person; thin line: path walked"),
        "jammer": Mark("dashed ring", JAM, "jammer: no reception inside"),
    }
)
"""Marks on floors, by kind; those of items and events are declared by the task."""
ADOPTION: Final = "took over"
"""Kind of the event that a robot plans to do an item of another owner."""


def item_marks(task: TaskDeclaration) -> dict[str, Mark]:
    """Return the marks of a task's items by state; unknown symbols are rings."""
    return _marks(task.marks)


def event_marks(task: TaskDeclaration) -> dict[str, Mark]:
    """Return the marks of a task's events by kind, and of adoptions; unknown symbols are rings."""
    adoption = Mark("triangle", None, f"{printable(task.item)} adopted from another robot")
    return {**_marks(task.events), ADOPTION: adoption}


def _marks(styles: Mapping[str, MarkStyle]) -> dict[str, Mark]:
    return {
        name: Mark(one.symbol if one.symbol in SYMBOLS else "ring", None, printable(one.description))
        for name, one in styles.items()
    }


def cause_glyphs(task: TaskDeclaration) -> dict[str, StateGlyph]:
    """Return the glyphs of all causes: CAUSE_GLYPHS, then own ones of the task; invalid ones are grey."""
    return dict(CAUSE_GLYPHS) | {
        name: StateGlyph(GREY, "") if style_fault(style) else StateGlyph(colour_of(style[0]), style[1])
        for name, style in task.causes.items()
        if name not in CAUSE_GLYPHS
    }
