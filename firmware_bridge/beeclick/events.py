"""What the link to a board has to say: ends of packets, what was heard, readings; each has its instant."""

from dataclasses import dataclass

from actors.board_readings import BoardNote
from actors.instant import Instant
from actors.messages import AccessFailure, Heard, Overflow, Refused, Sent


@dataclass(frozen=True)
class UnconfirmedPacket:
    """Nobody knows whether the packet `tag` has left: the board had it and never said."""

    instant: Instant
    tag: int
    cause: str
    """One word or two, as in the counters."""


PacketEnd = Sent | AccessFailure | UnconfirmedPacket | Overflow | Refused
"""What becomes of a packet: every one that is sent comes to exactly one of these."""
Event = PacketEnd | Heard | BoardNote
