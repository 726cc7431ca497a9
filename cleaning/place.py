"""Places to be cleaned, as they change hands: whose they were, and how often they have been taken over."""

from dataclasses import dataclass
from typing import Annotated, Final

from actors.geometry import Point
from actors.robot.behaviour import Start, TaskList
from actors.task.words import PlaceKey
from deeco.replication.schema import Resolution

RESTART_TERM: Final = 2**20
"""What a restart adds to the terms of a robot's own assignments; see `assignments`. No tuning: any number
will do that is larger than how often a place changes hands between two restarts. This one is reached after
36 days with an exchange every 3 s, the ensemble's period. It costs air only after a restart: 4 bytes a
place."""
LAST_TERM: Final = 2**63 - 1
"""No place is taken over beyond it: no honest swarm comes there, and the next but one has no form on the air.
Whoever hears so great a term hears a liar."""


@dataclass(frozen=True)
class Takeover:
    """That somebody has taken a place over: what is said of it to those who held it before."""

    owner: str
    """The robot that the place was given to."""
    index: int
    """Its index in the owner's list."""
    term: int
    """How often it had changed hands, as far as who took it knew; its own taking included."""

    @property
    def key(self) -> PlaceKey:
        """Which place it is."""
        return PlaceKey(self.owner, self.index)


@dataclass(frozen=True)
class Assignment:
    """The assignment to clean a place."""

    owner: str
    """The robot that the place was given to."""
    index: int
    """Its index in the owner's list."""
    point: Annotated[Point, Resolution(1000)]
    """Where it is, m, map frame; rounded to the millimetre when it changes hands."""
    term: int = 0
    """How often it has changed hands, as far as its holder knows."""

    @property
    def key(self) -> PlaceKey:
        """Which place it is."""
        return PlaceKey(self.owner, self.index)

    @property
    def takeover(self) -> Takeover:
        """The same without where it is."""
        return Takeover(self.owner, self.index, self.term)


def assignments(start: Start) -> tuple[Assignment, ...]:
    """A robot's own places, in the order given.

    A robot that was restarted takes them all again, and with a term above all that it may have had before:
    others have handed places back to it, and must not draw them off by what they said of them long ago.
    """
    term = start.epoch * RESTART_TERM
    return tuple(Assignment(start.robot, index, point, term) for index, point in enumerate(start.places))


def since(tasks: TaskList, robot: str, known: int) -> tuple[Assignment, ...]:
    """What the robot has been given beyond the first `known` of its places, in the order given.

    As `assignments`, of which these are more.
    """
    term = tasks.epoch * RESTART_TERM
    new = tasks.places[known:]
    return tuple(Assignment(robot, index, point, term) for index, point in enumerate(new, start=known))
