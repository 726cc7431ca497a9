"""What page and server say to one another: JSON, a text a message; what comes from a page is checked."""

from typing import Annotated, Final

import msgspec

ASK_BYTES: Final = 1024
"""No message from a page is longer."""


class Ask(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An order that somebody gives on the page."""

    id: Annotated[int, msgspec.Meta(ge=0, lt=1 << 31)]
    """Chosen by the page; what became of the order carries it."""
    order: Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
    """As one types it behind `acrc order RUN`."""


class OrderAnswer(msgspec.Struct, frozen=True, tag_field="kind", tag="said"):
    """What became of an order."""

    id: int
    order: str
    refusal: str
    """A sentence; empty: it was carried out."""


class MapRobot(msgspec.Struct, frozen=True, array_like=True):
    """A robot on the map."""

    id: str
    x: float
    y: float
    heading: float
    standing: str
    """driving, frozen or ended."""


Circle = tuple[float, float, float]
"""x, y, radius: an obstacle, or a jammer while it is on."""
Line = tuple[float, float, float, float]
"""x, y, to x, to y: a wall that somebody has put."""
Spot = tuple[float, float]
"""x, y."""


class Place(msgspec.Struct, frozen=True, array_like=True):
    """A place to be cleaned."""

    owner: str
    x: float
    y: float


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
    """Of the robots' bodies, by id."""
    places: tuple[Place, ...]


class MapState(msgspec.Struct, frozen=True, tag_field="kind", tag="state"):
    """How things stand: the newest there is."""

    t: float
    """Simulated s."""
    step: int
    robots: tuple[MapRobot, ...]
    done: tuple[int, ...]
    """Indices of those that were reported, in Floor.places and `given` behind it."""
    given_up: tuple[int, ...]
    given: tuple[Place, ...]
    """Places that came since the start."""
    obstacles: tuple[Circle, ...]
    jammers: tuple[Circle, ...]
    walls: tuple[Line, ...]
    closed: tuple[Spot, ...]
    """Doors that were ordered to close, each by the point that was named."""
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
