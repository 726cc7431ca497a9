"""Places to be cleaned as they change hands, and the golden places of the original testbed."""

from dataclasses import dataclass
from typing import Annotated, Final

from actors.geometry import Point
from actors.robot.behaviour import Start, TaskList
from actors.task.task import PlaceKey
from deeco.schema import Resolution

_GOLDEN: Final = (
    (
        (21.216, 11.918), (17.665, 6.420), (8.456, 12.329), (23.105, 12.257), (18.843, 11.570),
        (7.928, 13.289), (17.528, 5.508), (10.890, 13.094), (12.216, 5.907), (14.042, 12.991),
    ),
    (
        (8.583, 13.617), (20.843, 12.078), (3.337, 12.312), (10.002, 13.292), (17.959, 3.762),
        (2.740, 11.575), (19.643, 12.216), (21.349, 11.936), (9.218, 13.410), (20.680, 12.092),
    ),
    (
        (23.019, 11.620), (20.773, 12.328), (3.600, 12.783), (12.495, 1.164), (12.468, 4.930),
        (13.771, 12.119), (21.914, 13.469), (14.058, 11.304), (17.981, 13.483), (9.700, 11.981),
    ),
    (
        (3.357, 11.356), (17.117, 13.234), (11.686, 1.162), (8.508, 13.664), (26.454, 11.137),
        (19.922, 13.313), (11.756, 12.574), (12.677, 6.371), (18.811, 13.495), (17.832, 13.650),
    ),
)  # fmt: skip
GOLDEN: Final = tuple(tuple(Point(*place) for place in places) for places in _GOLDEN)
"""The ten places of each of the testbed's four robots, m, to the millimetre: what its generator gives for its
seed, java.util.Random(42). Some lie nearer to a wall than a robot's radius: they are reached from within
0.5 m."""


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
