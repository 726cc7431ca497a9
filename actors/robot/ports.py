"""What a behaviour may know and do: everything between the robot and the user's code, typed, without I/O.

A behaviour is made by a function `Start -> Behaviour` in a module of the user's, named by an entry string
such as `cleaning.baseline:behaviour`. What robots share travels in frames of the radio, and in no other way.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple, Protocol

from numpy.random import Generator

from actors.geometry import Point, Pose
from actors.instant import Instant
from actors.messages import Outgoing, PlaceGivenUp, PlaceKey, PlaceReport, RadioEvent


class GoalStatus(Enum):
    """How a goal stands; the names of move_base (actionlib_msgs/GoalStatus)."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class AbortReason(Enum):
    """Why navigation gave a goal up."""

    NO_PLAN = "no plan"
    """No way leads there on the map."""
    BLOCKED = "blocked"
    """Something stood in the way for too long."""
    NO_PROGRESS = "no progress"
    """The robot moved, but did not get away from where it was."""


class Goal(NamedTuple):
    """The last point that navigation was asked to go to, and how that stands."""

    point: Point
    status: GoalStatus
    reason: AbortReason | None = None
    """Set with ABORTED only."""


class GoalOrder(Enum):
    """What to do with the present goal."""

    KEEP = "keep"
    CANCEL = "cancel"
    """Stop, and have no goal any more."""


@dataclass(frozen=True)
class Start:
    """What a behaviour is told once, before its first step."""

    robot: str
    """The robot's id, unique in the swarm."""
    address: int
    """Its short address on the radio (IEEE 802.15.4)."""
    epoch: int
    """How often this robot has been restarted in the run; nothing but the id survives a restart."""
    pose: Pose
    """Where the robot stood when its base was switched on, m and rad, map frame."""
    places: tuple[Point, ...]
    """The places it has to clean, m, in the order given."""
    generator: Generator
    """The behaviour's own random stream: the only randomness it may use."""


class View(NamedTuple):
    """What a behaviour sees at the start of a step."""

    instant: Instant
    pose: Pose
    """Where the robot holds itself to be, m and rad, map frame."""
    moving: bool
    """True while the base reports more than a creeping speed."""
    goal: Goal | None
    """None before the first goal and after CANCEL."""
    radio: tuple[RadioEvent, ...]
    """What the transceiver had to say since the last step, in order of its instants; junk included."""


@dataclass(frozen=True)
class Decision:
    """What a behaviour wants done after a step."""

    goal: Point | GoalOrder = GoalOrder.KEEP
    """A point is a new goal and replaces the present one, also if it is the same point again."""
    frames: tuple[Outgoing, ...] = ()
    """Frames to broadcast, in order of their instants, which lie within the step."""
    reports: tuple[PlaceReport, ...] = ()
    """Places that the robot holds to have visited."""
    given_up: tuple[PlaceGivenUp, ...] = ()
    """Places for which nobody should try any more."""
    route: tuple[PlaceKey, ...] | None = None
    """The places that the robot still means to visit, in their order; None: as said before, and at first
    those of its Start."""


class Behaviour(Protocol):
    """The user's part of a robot; keeps its own state between steps.

    It may also have a method `outcome() -> dict[str, object]`, called once at the end of its process: what it
    has to say about its run, by subject, in values that JSON can hold. It goes into the last record of the
    robot's file and takes no part in the run's digest. The subject "deeco" belongs to the component model.
    """

    def advance(self, view: View, until: Instant) -> Decision:
        """Do what is due at instants from `view.instant` on and before `until`.

        `view` is the newest there is. A goal takes effect with the next step. Steps may be missing between
        two calls: the robot was frozen then. No clock, global randomness or iteration over a set is allowed.
        """
