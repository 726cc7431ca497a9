"""What a behaviour may know and do: everything between the robot and the user's code, typed, without I/O.

A behaviour is made by a function `Start -> Behaviour` in a module of the user's, named by an entry string
such as `cleaning.strategies.none:behaviour`. What robots share travels in frames of the radio, and in no
other way.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, field
from types import MappingProxyType
from typing import Annotated, Final, NamedTuple, Protocol, TypeAlias

from msgspec import Meta
from numpy.random import Generator

from actors.floor.door import Door
from actors.geometry import CERTAIN, Covariance, Point, Pose
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import Outgoing, RadioEvent
from actors.robot.behaviour.equipment import FloorPlan
from actors.robot.behaviour.plan import Goal, GoalOrder, Plan
from actors.settings import LONGEST_S, Interval, Settings
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport

Scalar: TypeAlias = bool | int | float | str
Setting: TypeAlias = Scalar | tuple[Scalar, ...]
"""A value in a scenario's table [strategy], or a list of values, as a tuple."""
EVERYBODY_DBM: Final = 0.0
"""No transceiver reports more (`actors.radio.frame` ends at -35 dBm)."""
FARTHEST_BACK: Final = 3.0
"""Farther than this nobody backs out, m: so long is the trail that a robot remembers."""
_NO_MAP: Final = LookupError("this Start was made without a floor plan")


_Interval = Annotated[Duration, Meta(ge=milliseconds(1), le=seconds(LONGEST_S))]


class ExchangeSettings(Settings, frozen=True):
    """How nodes of the component model exchange knowledge: a scenario's table [deeco]."""

    publish: _Interval = seconds(1)
    """How often the own knowledge is published (d3scomp/JDEECo, DefaultKnowledgePublisher)."""
    relay: bool = False
    """Pass on what is heard; off in d3scomp/deeco-adaptation-testbed."""
    hop_limit: Annotated[int, Meta(ge=1, le=15)] = 3
    """How often knowledge is passed on at most; own choice: the corridor is three radio ranges long."""
    relay_delay: Interval = seconds(1)
    """The longest wait before passing knowledge on, that for the strongest signal (d3scomp/JDEECo 2,
    DefaultKnowledgeDataManager)."""
    relay_below: Annotated[float, Meta(ge=-90, le=EVERYBODY_DBM, extra={"unit": "dBm"})] = EVERYBODY_DBM
    """What is heard more strongly than this is not passed on, dBm; transceivers distinguish nothing weaker
    than -90 dBm (`actors.radio.frame`). Default: everybody passes on; own choice, decision 22. JDEECo has a
    distance in its place (RebroadcastStrategy)."""
    forget: _Interval = seconds(30)
    """Replicas not heard of for so long are dropped; own choice. JDEECo keeps them for ever."""


_AS_IT_IS: Final = ExchangeSettings()


class _NoFloorPlan:
    """Stands where nobody has given a robot its map: whatever is asked, there is none."""

    doors: tuple[Door, ...] = ()

    def random_place(self) -> Point:
        """There is none."""
        raise _NO_MAP

    def is_free(self, point: Point) -> bool:
        """Nobody knows."""
        raise _NO_MAP

    def length(self, start: Point, goal: Point) -> float | None:
        """Nobody knows."""
        raise _NO_MAP

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """Nobody knows."""
        raise _NO_MAP

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Nobody knows."""
        raise _NO_MAP

    def door(self, point: Point) -> int | None:
        """Nobody knows."""
        raise _NO_MAP

    def region(self, point: Point) -> int | None:
        """Nobody knows."""
        raise _NO_MAP


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
    """The places it has to clean, m, in the order given; a View may bring more."""
    generator: Generator
    """The behaviour's own random stream: the only randomness it may use."""
    settings: Mapping[str, Setting] = field(default_factory=lambda: MappingProxyType({}))
    """The strategy's numbers where they differ from its own: the scenario's table [strategy]; read-only."""
    exchange: ExchangeSettings = _AS_IT_IS
    """How the node exchanges knowledge with others, if there is a node."""
    floor: FloorPlan = field(default_factory=_NoFloorPlan)
    """The robot's map; what it draws, it draws from `generator`."""


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
    covariance: Covariance = CERTAIN
    """How far the pose is to be trusted."""
    lost: float = 0.0
    """Probability that the robot is somewhere else altogether."""
    plan: Plan | None = None
    """The way that navigation follows to the goal; None while there is none."""
    backing_out: bool = False
    """True while the robot backs out because a decision said so."""
    places: tuple[Point, ...] = ()
    """Places to clean that it is given with this step; they follow those that it has, in Start and since."""


@dataclass(frozen=True)
class Decision:
    """What a behaviour wants done after a step."""

    goal: Point | GoalOrder = GoalOrder.KEEP
    """A point is a new goal and replaces the present one, also if it is the same point again."""
    _: KW_ONLY
    frames: tuple[Outgoing, ...] = ()
    """Frames to broadcast, in order of their instants, which lie within the step."""
    reports: tuple[PlaceReport, ...] = ()
    """Places that the robot holds to have visited."""
    given_up: tuple[PlaceGivenUp, ...] = ()
    """Places for which nobody should try any more."""
    route: tuple[PlaceKey, ...] | None = None
    """The places that the robot still means to visit, in their order; None: as said before, and at first
    those of its Start."""
    paused: bool | None = None
    """True: stand, and keep the goal, whichever it is; False: go on, with all patience anew; None: as before,
    and at first go on."""
    peers: tuple[Point, ...] | None = None
    """Where other robots are held to be, m, map frame: the localiser disregards range readings that end
    there. They replace the ones given before; None: as before, and at first none."""
    back_out: float | None = None
    """Back out along the own trail by so much, m, above 0 and at most FARTHEST_BACK; None: as before. A goal,
    also one of the same decision, waits until that is over, CANCEL ends it."""
    relocalise: bool = False
    """True: forget the pose, and look for it all over the map."""


class Behaviour(Protocol):
    """The user's part of a robot; keeps its own state between steps.

    It may also have a method `outcome() -> dict[str, object]`, called once at the end of its process: its own
    results by name, in values that JSON can hold. They go into the last record of the robot's file and are no
    part of the run's digest. Numbers, texts and booleans, also within dicts, appear in the run's result and
    in tables. The names "deeco" and "adaptation" belong to the component model, "localisation" and
    "navigation" to the robot.
    """

    def advance(self, view: View, until: Instant) -> Decision:
        """Do what is due at instants from `view.instant` on and before `until`.

        `view` is the newest there is. A goal takes effect with the next step. Steps may be missing between
        two calls: the robot was frozen then. No clock, global randomness or iteration over a set is allowed.
        """
