"""What the link to a board has to say, beside the radio's own messages; every event bears its instant."""

from dataclasses import dataclass
from datetime import datetime

from actors.instant import Instant
from actors.messages import AccessFailure, Heard, Overflow, Refused, Sent


@dataclass(frozen=True)
class Unconfirmed:
    """Nobody knows whether the packet `tag` has left: the board had it and never said."""

    instant: Instant
    tag: int
    cause: str
    """One word or two, as in the counters."""


@dataclass(frozen=True)
class Up:
    """The board has been set up and confirmed it; from now on packets go out."""

    instant: Instant


@dataclass(frozen=True)
class Down:
    """Packets wait: the board must be found again. `cause` "silent": it has not answered for long."""

    instant: Instant
    cause: str


@dataclass(frozen=True)
class Fix:
    """A position from the GPS module, degrees, north and east positive; None: the module does not know."""

    instant: Instant
    valid: bool
    latitude: float | None
    longitude: float | None
    utc: datetime | None


@dataclass(frozen=True)
class Temperature:
    """Degrees Celsius; not `valid` where the sensor is missing or talks nonsense."""

    instant: Instant
    celsius: float
    valid: bool


@dataclass(frozen=True)
class Humidity:
    """Relative humidity, percent; `valid` as in Temperature."""

    instant: Instant
    percent: float
    valid: bool


@dataclass(frozen=True)
class Info:
    """What the board told of itself when its button was pressed."""

    instant: Instant
    text: str


PacketEnd = Sent | AccessFailure | Unconfirmed | Overflow | Refused
"""What becomes of a packet: every one that is sent comes to exactly one of these."""
Event = PacketEnd | Heard | Up | Down | Fix | Temperature | Humidity | Info
