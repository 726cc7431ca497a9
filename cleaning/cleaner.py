"""What cleaning robots let one another know."""

from enum import Enum
from typing import Annotated

from actors.geometry import Point
from cleaning.place import Assignment, Takeover
from deeco import Knowledge, role
from deeco.schema import Resolution


class State(Enum):
    """How a robot gets on."""

    FREE = "free"
    BLOCKED = "blocked"
    """It wants to move and does not."""


@role
class Cleaner(Knowledge):
    """A cleaning robot as others see it: 40 to 135 bytes on the air, most of them for what it has adopted."""

    position: Annotated[Point, Resolution(1000)]
    """Where it holds itself to be, m, map frame."""
    state: State = State.FREE
    destination: Assignment | None = None
    """The place that it heads for; None if it has none, and while it heads for some other point."""
    former: Assignment | None = None
    """The destination that it left for the present one, which it adopted: whoever held that may have this in
    exchange."""
    adopted: tuple[Takeover, ...] = ()
    """What it has taken over from others, the newest last; visited or given up since or not."""

    def is_blocked(self) -> bool:
        """True if it wants to move and does not."""
        return self.state is State.BLOCKED
