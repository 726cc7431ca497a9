"""Knowledge that cleaning robots publish."""

from enum import Enum
from typing import Annotated

from actors.geometry import Point
from cleaning.place import Assignment, Takeover
from deeco import Knowledge, role
from deeco.schema import Resolution


class State(Enum):
    """Mobility of a robot."""

    FREE = "free"
    BLOCKED = "blocked"
    """The robot has a target and does not move."""


@role
class Cleaner(Knowledge):
    """Published state of a cleaning robot: 40 to 135 bytes on the air, mostly adopted places."""

    position: Annotated[Point, Resolution(1000)]
    """Estimated position, m, map frame."""
    state: State = State.FREE
    destination: Assignment | None = None
    """Current destination; None without one and while the robot drives to another point."""
    former: Assignment | None = None
    """Destination before the current one, which was adopted; offered in exchange to its former holder."""
    adopted: tuple[Takeover, ...] = ()
    """Adopted places, newest last, including settled ones."""

    def is_blocked(self) -> bool:
        """Return True if the robot has a target and does not move."""
        return self.state is State.BLOCKED
