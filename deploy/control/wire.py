"""Protocol between map page and server (JSON), checked, and the link from the server to the run."""

import secrets
import time
from collections.abc import Callable
from typing import Annotated, Final, NamedTuple

import msgspec

from actors.messages import ANSWERED, CONTROL, DRIVE, PROGRESS, RECEIVED, TRUTH, Answered, Control
from actors.runtime.bus_interface import Bus, Delivery
from actors.runtime.codec import decode, encode
from actors.runtime.core import at
from actors.runtime.errors import AcrcError
from deploy.control.page_floor import OrderLines
from deploy.control.scene import Scene
from deploy.run import orders

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


LISTENS: Final = (at(DRIVE, "*"), at(TRUTH), at(CONTROL), at(ANSWERED), at(PROGRESS), at(RECEIVED, "*"))
"""In this order they are looked at: an order comes before its answer."""
WAITING: Final = 256
"""Orders that may wait for an answer of the run."""
PATIENCE_S: Final = 10.0
"""After so long pages are told that the run has not said yet what becomes of an order."""


class _WaitingOrder(NamedTuple):
    line: int
    since_s: float


class RunLink:
    """Keeps a scene up with a run; `looks` rather loses messages than holds anybody up."""

    def __init__(
        self,
        scene: Scene,
        lines: OrderLines,
        looks: Bus,
        speaks: Bus,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """`lines`: told every order, and what becomes of it."""
        self._scene = scene
        self._lines = lines
        self._looks = looks
        self._speaks = speaks
        self._clock = clock
        self._waiting: dict[str, _WaitingOrder] = {}

    def give(self, wish: Ask) -> None:
        """Give the run an order."""
        line = self._lines.begin(wish)
        words = wish.order.split()
        try:
            if not words:
                raise AcrcError("no order")
            order = orders.parse(words[0], words[1:])
        except AcrcError as error:
            self._lines.end(line, str(error))
            return
        if len(self._waiting) >= WAITING or self._scene.over:
            reason = "the run is over" if self._scene.over else "too many orders wait already"
            self._lines.end(line, reason)
            return
        ticket = secrets.token_hex(8)
        self._waiting[ticket] = _WaitingOrder(line, self._clock())
        self._speaks.publish(CONTROL.key(), encode(Control(0, (order,), ticket), CONTROL.key()))

    def look(self) -> None:
        """Take in all that has come; of what transceivers said, the newest of each."""
        heard: dict[str, Delivery] = {}
        for address in LISTENS:
            while (delivery := self._looks.poll(address.topic)) is not None:
                if address.topic is RECEIVED:
                    heard[delivery.key] = delivery
                else:
                    self._take(delivery)
        for delivery in heard.values():
            self._take(delivery)
        late = [t for t, one in self._waiting.items() if self._clock() - one.since_s > PATIENCE_S]
        for ticket in late:
            self._answer(ticket, "the run has not said yet; it heeds the order at its next step")

    def _take(self, delivery: Delivery) -> None:
        message = decode(delivery.topic, delivery.key, delivery.payload)
        self._scene.take(message, delivery.key.split("/")[2])
        if isinstance(message, Answered):
            self._answer(message.ticket, "; ".join(message.refusals))

    def _answer(self, ticket: str, refusal: str) -> None:
        waiting = self._waiting.pop(ticket, None)
        if waiting is not None:
            self._lines.end(waiting.line, refusal)
