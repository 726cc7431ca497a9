"""What page and server say to one another: JSON, a text a message; what comes from a page is checked."""

from typing import Annotated, Final

import msgspec

ASK_BYTES: Final = 1024
"""No message from a page is longer."""


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An order that somebody gives on the page."""

    series: Annotated[int, msgspec.Meta(ge=0, lt=1 << 31)]
    """Orders of one drag, or of keys pressed in a row, have the same, chosen by the page; 0: it is alone."""
    order: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    """As one types it behind `acrc order RUN`."""


class OrderLine(msgspec.Struct, frozen=True, tag_field="kind", tag="said"):
    """One line of the list of orders, and what became of it; with a number that came before it is renewed."""

    number: int
    """Lines count from 1, in the order in which they began."""
    order: str
    """The last one of the line."""
    times: int = 1
    """So many orders are told by this line."""
    waiting: int = 0
    """Of them, those of which the run has not said what became of them."""
    refused: int = 0
    refusal: str = ""
    """Why the last one that was refused was."""


class MapRobot(msgspec.Struct, frozen=True, array_like=True):
    """A robot on the map."""

    id: str
    x: float
    y: float
    heading: float
    state: str
    """A word of `appearance.STATES`."""
    destination: tuple[float, float] | None = None
    """The place that it means to visit next, by its own account."""
    blocker: str = ""
    """Who stands in its way; empty unless it is blocked."""


Circle = tuple[float, float, float]
"""x, y, radius: an obstacle."""
Jammer = tuple[float, float, float, float]
"""x, y, radius, seconds left."""
Line = tuple[float, float, float, float]
"""x, y, to x, to y: a wall that somebody has put, or a door."""
Waypoint = tuple[float, float, float]
"""Simulated s, x, y."""


class Place(msgspec.Struct, frozen=True, array_like=True):
    """A place to be cleaned."""

    owner: str
    x: float
    y: float


class LegendEntry(msgspec.Struct, frozen=True, array_like=True):
    """How a thing is drawn, and what it is."""

    name: str
    shape: str
    colour: str
    """As "#0072b2"; empty: that of the robot whose it is."""
    says: str


class Floor(msgspec.Struct, frozen=True, tag_field="kind", tag="floor"):
    """What does not change: sent once."""

    png: str
    """Base64: opaque where something stands, half where nobody knows, else clear; north is up."""
    west: float
    south: float
    width: float
    """m, as all lengths."""
    height: float
    radii: dict[str, float]
    """Of the robots' bodies, by id, in the scenario's order."""
    colours: dict[str, str]
    """Of the robots, by id."""
    places: tuple[Place, ...]
    doors: tuple[Line, ...]
    """Where a door would hang in each narrow place that can be closed."""
    states: dict[str, tuple[str, str]]
    """The colour of each state of a robot, and that of letters on it."""
    legend: tuple[LegendEntry, ...]


class Past(msgspec.Struct, frozen=True, tag_field="kind", tag="past"):
    """What a page would know had it been open all the time: sent once."""

    trails: dict[str, tuple[Waypoint, ...]]
    """Where each robot was, oldest first."""


class MapState(msgspec.Struct, frozen=True, tag_field="kind", tag="state"):
    """How things stand: the newest there is."""

    t: float
    """Simulated s."""
    step: int
    robots: tuple[MapRobot, ...]
    links: tuple[tuple[int, int], ...]
    """Robots, by their places in `robots`, of which one has lately heard the other."""
    done: tuple[int, ...]
    """Indices of those that were reported, in Floor.places and `given` behind it."""
    given_up: tuple[int, ...]
    given: tuple[Place, ...]
    """Places that came since the start."""
    obstacles: tuple[Circle, ...]
    jammers: tuple[Jammer, ...]
    walls: tuple[Line, ...]
    closed: tuple[int, ...]
    """Indices in Floor.doors of those that were ordered to close."""
    paused: bool
    speed: float
    """Simulated seconds per second, at most; 0: as fast as possible."""
    over: bool
    missed: int
    """Steps of the run that never came to the server."""
    late: int = 0
    """States that this page was too slow for."""
    junk: int = 0
    """Messages from pages that were no orders."""


class JunkError(ValueError):
    """A message from a page that is no order."""


def ask(data: str | bytes) -> Ask:
    """The order in a message. Raises JunkError."""
    if len(data) > ASK_BYTES:
        raise JunkError
    try:
        return msgspec.json.decode(data, type=Ask)
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise JunkError from error
