"""How the page draws things: states of robots, marks of what lies on the floor, and the legend of them."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from actors.observer.colours import WHITE, Colour, contrast, hexadecimal
from actors.observer.glyphs import MARKS, OWN_STATES, Mark
from deploy.control.wire import LegendEntry

STATES: Final = ("driving", "standing", "blocked", "idle", "frozen", "off")
"""What a robot may be, seen from outside. "standing": it means to visit places, and stays where it is;
"blocked": the same with another robot near it; "idle": it stays, and means to visit none."""
_BLACK: Final[Colour] = (0, 0, 0)
_MARKS: Final[Mapping[str, Mark]] = MappingProxyType({
    **{name: MARKS[name] for name in ("open", "given")},
    "done": MARKS["done"]._replace(shape="dim disc", says="place reported as done"),
    "given up": MARKS["given up"]._replace(says="place given up"),
    "off": MARKS["off"]._replace(says="robot off"),
    "frozen": MARKS["frozen"]._replace(says="robot frozen"),
    "blocked": Mark("blocked", OWN_STATES["blocked"].colour, "robot blocked: it stays, and by whom"),
    "destination": Mark("dashes", None, "the place that a robot says it visits next"),
    "trail": Mark("trail", None, "where a robot was in the last 20 s"),
    "link": Mark("link", None, "one robot heard the other in the last 3 s"),
    **{name: MARKS[name] for name in ("door", "closed door", "wall", "obstacle", "jammer")},
})  # fmt: skip


def state_colours() -> dict[str, tuple[str, str]]:
    """The colour of each state, and that of letters on it: white or black, whichever is read better."""
    grounds = {state: OWN_STATES[state].colour for state in STATES}
    return {
        state: (hexadecimal(ground), hexadecimal(max(WHITE, _BLACK, key=lambda ink: contrast(ink, ground))))
        for state, ground in grounds.items()
    }


def legend() -> tuple[LegendEntry, ...]:
    """Every mark that the page draws."""
    return tuple(
        LegendEntry(name, mark.shape, hexadecimal(mark.colour) if mark.colour else "", mark.says)
        for name, mark in _MARKS.items()
    )
