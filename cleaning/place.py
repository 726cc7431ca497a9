"""Places to be cleaned, as they change hands: whose they were, and how often they have been taken over."""

from dataclasses import dataclass
from typing import Annotated, Final

from actors.geometry import Point
from actors.messages import PlaceKey
from actors.robot.behaviour.ports import Start
from deeco.replication.schema import Resolution

RESTART_TERM: Final = 2**20
"""What a restart adds to the terms of a robot's own duties; see `duties`. No tuning: any number will do that
is larger than how often a place changes hands between two restarts. This one is reached after 36 days with
an exchange every 3 s, the ensemble's period. It costs air only after a restart: 4 bytes a place."""
LAST_TERM: Final = 2**63 - 1
"""No place is taken over beyond it: no honest swarm comes there, and the next but one has no form on the air.
Whoever hears so great a term hears a liar."""


@dataclass(frozen=True)
class Claim:
    """That somebody has taken a place over: what is said of it to those who held it before."""

    owner: str
    """The robot that the place belonged to at the start of the run."""
    index: int
    """Its index in the owner's list."""
    term: int
    """How often it had changed hands, as far as who took it knew; its own taking included."""

    @property
    def key(self) -> PlaceKey:
        """Which place it is."""
        return PlaceKey(self.owner, self.index)


@dataclass(frozen=True)
class Duty:
    """The duty to clean a place."""

    owner: str
    """The robot that the place belonged to at the start of the run."""
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
    def claim(self) -> Claim:
        """The same without where it is."""
        return Claim(self.owner, self.index, self.term)


def duties(start: Start) -> tuple[Duty, ...]:
    """A robot's own places, in the order given.

    A robot that was restarted takes them all again, and with a term above all that it may have had before:
    others have handed places back to it, and must not draw them off by what they said of them long ago.
    """
    term = start.epoch * RESTART_TERM
    return tuple(Duty(start.robot, index, point, term) for index, point in enumerate(start.places))
