"""The seam between a robot and its strategy: what a behaviour knows, asks for and decides, and its plan."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Final, NamedTuple, NoReturn, Protocol, TypeAlias, cast

from msgspec import Meta
from numpy.random import Generator

from actors.array_types import Floats
from actors.geometry import CERTAIN, Covariance, Door, Point, Pose
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.messages import Outgoing, RadioEvent
from actors.settings import LONGEST_S, Interval, Settings
from actors.task.task import PlaceGivenUp, PlaceKey, PlaceReport


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
    """The local planner found no valid trajectory for too long."""
    NO_PROGRESS = "no progress"
    """The robot did not get away from where it was."""


class GoalPhase(Enum):
    """What navigation is about while a goal is active; the first ones as in move_base."""

    PLANNING = "planning"
    """It has no way to the goal, and looks for one."""
    CONTROLLING = "controlling"
    """It has a way, and the local planner a valid trajectory."""
    OBSTRUCTED = "obstructed"
    """It has a way, but the local planner no valid trajectory, so the robot stands."""
    RETREATING = "retreating"
    """It backs away from what its bumper has touched, or because its behaviour said so."""
    PAUSED = "paused"
    """The behaviour lets it stand."""


class Goal(NamedTuple):
    """The last point that navigation was asked to go to, and how that stands."""

    point: Point
    status: GoalStatus
    reason: AbortReason | None = None
    """Set with ABORTED only."""
    phase: GoalPhase | None = None
    """Set with ACTIVE only."""
    since: Instant | None = None
    """When `phase` began; set with it."""


class GoalOrder(Enum):
    """What to do with the present goal."""

    KEEP = "keep"
    CANCEL = "cancel"
    """Stop, and have no goal any more."""


PACE: Final = 0.33
"""So fast robots get on, m/s: 0.5 m/s by the slowness of 1.5 that `acrc verify navigation` measures."""


@dataclass(frozen=True, eq=False)
class Plan:
    """One plan of navigation's, which makes a new one every second."""

    way: Floats
    """(n, 2), n ≥ 1: points from where the robot was to the goal, m, map frame; nobody's to change."""

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """The same as points."""
        return tuple(Point(x, y) for x, y in self.way.tolist())

    def ahead(self, here: Point) -> tuple[Point, ...]:
        """The points from the one nearest to `here` on."""
        nearest = min(range(len(self.points)), key=lambda index: self.points[index].distance_to(here))
        return self.points[nearest:]

    def distance_to_go(self, here: Point) -> float:
        """How far it is from `here` to the plan's nearest point and on to its end, m."""
        total, last = 0.0, here
        for point in self.ahead(here):
            total += last.distance_to(point)
            last = point
        return total

    def time_to_go(self, here: Point) -> Duration:
        """How long that takes at PACE: an estimate that knows of nobody in the way."""
        return seconds(self.distance_to_go(here) / PACE)


class Positioning(Protocol):
    """Where the robot holds itself to be, and whether it moves."""

    @property
    def pose(self) -> Pose:
        """m and rad, map frame, at the start of the step."""

    @property
    def covariance(self) -> Covariance:
        """How far the pose is to be trusted: of x, y and heading, row by row, m², m·rad, rad²."""

    @property
    def is_lost(self) -> float:
        """The probability that the robot is somewhere else altogether, 0 to 1, by what its scans say.

        Above 0.95 it is time to act on it: `acrc verify localisation` counts how seldom that is wrong. The
        odometry alone never finds out, and says 0.
        """

    @property
    def moving(self) -> bool:
        """True while the base reports more than a creeping speed."""

    def disregard(self, peers: Sequence[Point]) -> None:
        """From the next step on, do not believe range readings that end at other robots, which are there.

        m, map frame. They replace those given before; none at all: believe every reading.
        """

    def relocalise(self) -> None:
        """Forget the pose, and look for it all over the map: for a robot that knows that it is lost.

        Until it has seen enough, `is_lost` is high and the pose anything. Without effect on odometry alone.
        """


class Navigation(Protocol):
    """Drives the robot to one goal at a time; an order takes effect with the next step."""

    @property
    def goal(self) -> Goal | None:
        """The last goal, how it stands and why; None before the first one and after `stop`."""

    @property
    def plan(self) -> Plan | None:
        """The way that navigation follows, with distance and time to go; None while there is none."""

    @property
    def backing_out(self) -> bool:
        """True while it backs out because it was told to."""

    def back_out(self, distance: float) -> None:
        """Drive backward along the own trail by `distance`, m, above 0 and at most FARTHEST_BACK.

        It ends early where the trail does, and where something stands behind. A goal waits for that.
        """

    def go_to(self, point: Point) -> None:
        """Make `point`, m in the map frame, the goal, also if it is the goal already: a new attempt."""

    def stop(self) -> None:
        """Have no goal, and stand."""

    def pause(self) -> None:
        """Stand, and keep the goal, also one that is given later, until `resume`."""

    def resume(self) -> None:
        """Go on to the goal, with all patience anew."""


class TaskList(Protocol):
    """The places that the robot has to clean; more may come while the run goes on."""

    @property
    def places(self) -> Sequence[Point]:
        """All that it has been given so far, m, map frame: those of its Start, then what came, in order.

        The index of a place in it is that of its PlaceKey.
        """

    @property
    def at_start(self) -> int:
        """So many of them are those of its Start."""

    @property
    def epoch(self) -> int:
        """How often the robot has been restarted; a new process is told of all places again."""


class PlaceMonitor(Protocol):
    """Takes down, for the result alone, what the robot holds to have come of places."""

    def visited(self, place: PlaceKey, now: Instant) -> None:
        """Say that a place has been cleaned."""

    def given_up(self, place: PlaceKey, reason: str, now: Instant) -> None:
        """Say that nobody is to try for a place any more, and why, in at most 100 characters."""

    def remaining(self, route: Sequence[PlaceKey]) -> None:
        """Say which places the robot still means to visit, in their order; at first those of its Start."""


class FloorPlan(Protocol):
    """The map as the robot has it."""

    def random_place(self) -> Point:
        """A point in the areas in which places lie, each as likely as another, where the robot can stand.

        Without areas: on all floor that the robot can reach. Drawn from the behaviour's own stream.
        """

    def is_free(self, point: Point) -> bool:
        """True if the robot's centre can be at `point`, m, by the map and the margin that planning keeps."""

    def length(self, start: Point, goal: Point) -> float | None:
        """How far the shortest way between two points of the map is, m; None where no way leads.

        A point where the robot cannot be stands for the nearest within 0.5 m where it can. The first question
        about a goal takes about a millisecond, every other one microseconds: have what is asked about from
        many sides as the goal.
        """

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """That way: points 0.1 to 0.2 m apart, m; None without one. Navigation's own keep off walls."""

    @property
    def doors(self) -> tuple[Door, ...]:
        """The map's narrow places, in which robots that meet do not get by; each by its index."""

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Which doors that way goes through, begins in or ends in, in order; None without a way."""

    def door(self, point: Point) -> int | None:
        """The index of the door that `point` is in; None in none."""

    def region(self, point: Point) -> int | None:
        """The number of the region between doors that `point` is in; None in a door and off the floor."""


Scalar: TypeAlias = bool | int | float | str
Setting: TypeAlias = Scalar | tuple[Scalar, ...]
"""A value in a scenario's table [strategy], or a list of values, as a tuple."""
EVERYBODY_DBM: Final = 0.0
"""No transceiver reports more (`actors.radio.frame` ends at -35 dBm)."""
FARTHEST_BACK: Final = 3.0
"""Farther than this nobody backs out, m: so long is the trail that a robot remembers."""
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
    """The floor of a Start that was made without one: it has no doors, and every question is an error."""

    doors: tuple[Door, ...] = ()

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):
            raise AttributeError(name)
        raise LookupError("this Start was made without a floor plan")


_NO_FLOOR: Final = cast(FloorPlan, _NoFloorPlan())


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
    floor: FloorPlan = _NO_FLOOR
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
