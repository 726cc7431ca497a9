"""What the link to a board has to say, beside the radio's own messages; every event bears its instant."""

from dataclasses import dataclass
from datetime import datetime

from actors.board_readings import Humidity, Info, Temperature
from actors.instant import Instant
from actors.messages import AccessFailure, Heard, Overflow, Refused, Sent


@dataclass(frozen=True)
class UnconfirmedPacket:
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
class PositionFix:
    """A position from the GPS module, degrees, north and east positive; None: the module does not know."""

    instant: Instant
    valid: bool
    latitude: float | None
    longitude: float | None
    utc: datetime | None


PacketEnd = Sent | AccessFailure | UnconfirmedPacket | Overflow | Refused
"""What becomes of a packet: every one that is sent comes to exactly one of these."""
Event = PacketEnd | Heard | Up | Down | PositionFix | Temperature | Humidity | Info
