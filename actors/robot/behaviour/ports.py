"""Interface between a robot and its behaviour: inputs, ports, decisions and plans."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any, Final, NamedTuple, NoReturn, Protocol, TypeAlias, cast

from msgspec import Meta
from numpy.random import Generator

from actors.array_types import Floats
from actors.geometry import CERTAIN, Covariance, Door, Point, Pose
from actors.instant import Duration, Instant, milliseconds, seconds
from actors.items import ItemGivenUp, ItemKey
from actors.messages import OutgoingFrame, RadioEvent
from actors.settings import LONGEST_S, Interval, Settings
from actors.topic import MessagePart


class GoalStatus(Enum):
    """Status of a goal; names as in move_base (actionlib_msgs/GoalStatus)."""

    ACTIVE = "active"
    SUCCEEDED = "succeeded"
    ABORTED = "aborted"


class AbortReason(Enum):
    """Reason why navigation aborted a goal."""

    NO_PLAN = "no plan"
    """No path to the goal on the map."""
    BLOCKED = "blocked"
    """The local planner found no valid trajectory before its timeout."""
    NO_PROGRESS = "no progress"
    """The robot did not move far enough before the timeout."""


class GoalPhase(Enum):
    """State of navigation while a goal is active; PLANNING and CONTROLLING as in move_base."""

    PLANNING = "planning"
    """Searching for a path."""
    CONTROLLING = "controlling"
    """Following the path with a valid trajectory."""
    OBSTRUCTED = "obstructed"
    """Standing: there is a path, but no valid trajectory."""
    RETREATING = "retreating"
    """Backing away after a bumper contact, or on the behaviour's request."""
    PAUSED = "paused"
    """Standing because the behaviour paused navigation."""


class Goal(NamedTuple):
    """The last requested goal and its state."""

    point: Point
    status: GoalStatus
    reason: AbortReason | None = None
    """Set with ABORTED only."""
    phase: GoalPhase | None = None
    """Set with ACTIVE only."""
    since: Instant | None = None
    """Start of `phase`; set with it."""


class GoalOrder(Enum):
    """Request about the current goal."""

    KEEP = "keep"
    CANCEL = "cancel"
    """Stop and clear the goal."""


TYPICAL_SPEED: Final = 0.33
"""Typical speed, m/s: 0.5 m/s divided by the slowness of 1.5 that `acrc verify navigation` measures."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A global plan; navigation makes a new one every second."""

    path: Floats
    """(n, 2), n ≥ 1: points from the robot's position to the goal, m, map frame; read-only."""

    @cached_property
    def points(self) -> tuple[Point, ...]:
        """The path as Points."""
        return tuple(Point(x, y) for x, y in self.path.tolist())

    def ahead(self, here: Point) -> tuple[Point, ...]:
        """Return the points from the one nearest to `here` to the end."""
        nearest = min(range(len(self.points)), key=lambda index: self.points[index].distance_to(here))
        return self.points[nearest:]

    def distance_to_go(self, here: Point) -> float:
        """Return the distance from `here` to the nearest point and on to the end, m."""
        total, last = 0.0, here
        for point in self.ahead(here):
            total += last.distance_to(point)
            last = point
        return total

    def time_to_go(self, here: Point) -> Duration:
        """Return the time for `distance_to_go` at TYPICAL_SPEED; other robots are ignored."""
        return seconds(self.distance_to_go(here) / TYPICAL_SPEED)


class Positioning(Protocol):
    """Pose estimate and motion of the robot."""

    @property
    def pose(self) -> Pose:
        """Pose estimate at the start of the step, m and rad, map frame."""

    @property
    def covariance(self) -> Covariance:
        """Covariance of x, y and heading, row by row, m², m·rad, rad²."""

    @property
    def lost_probability(self) -> float:
        """Probability that the pose estimate is wrong, 0 to 1, estimated from scans.

        Values above 0.95 are reliable (`acrc verify localisation` measures how reliable). Always 0 with
        odometry alone.
        """

    @property
    def moving(self) -> bool:
        """True if the base reports more than a minimal speed."""

    def disregard(self, peers: Sequence[Point]) -> None:
        """Ignore range readings that end at these positions of other robots, from the next step on.

        m, map frame. Replaces the previous positions; an empty sequence: ignore no readings.
        """

    def relocalise(self) -> None:
        """Discard the pose estimate and search the whole map, for a robot that is lost.

        Until enough scans have arrived, `lost_probability` is high and the pose arbitrary. No effect with
        odometry alone.
        """


class Navigation(Protocol):
    """Navigation to one goal at a time; requests take effect in the next step."""

    @property
    def goal(self) -> Goal | None:
        """The last goal and its state; None before the first one and after `stop`."""

    @property
    def plan(self) -> Plan | None:
        """The plan that navigation follows; None if there is none."""

    @property
    def backing_out(self) -> bool:
        """True while the robot backs out on request."""

    def back_out(self, distance: float) -> None:
        """Drive backward along the robot's trail by `distance`, m, above 0 and at most MAX_BACK_OUT.

        Ends early at the end of the trail or at an obstacle. The goal is resumed afterwards.
        """

    def go_to(self, point: Point) -> None:
        """Set the goal to `point`, m, map frame; the same point again starts a new attempt."""

    def stop(self) -> None:
        """Stop and clear the goal."""

    def pause(self) -> None:
        """Stop and keep the goal, or later ones, until `resume`."""

    def resume(self) -> None:
        """Continue to the goal with all timeouts reset."""


class BatteryMeter(Protocol):
    """Charge of the robot's battery."""

    @property
    def charge(self) -> float | None:
        """Share of the battery's capacity that is left, 0 to 1; None: unknown, or not simulated."""


class TaskList(Protocol):
    """The items that the task gave to the robot; it may give further ones during a run."""

    @property
    def items(self) -> Sequence[Any]:
        """All items so far, as plain values: first those of Start, then later ones.

        The index equals the number in the ItemKey.
        """

    @property
    def at_start(self) -> int:
        """Number of items in Start."""

    @property
    def epoch(self) -> int:
        """Number of restarts of the robot; a restarted robot receives all items again."""


class TaskMonitor(Protocol):
    """Receiver of the robot's reports about the task; for results only."""

    def report(self, report: MessagePart) -> None:
        """Send a report of the task's own type."""

    def given_up(self, item: ItemKey, reason: str, now: Instant) -> None:
        """Report that no robot should try an item again, with a reason of at most 100 characters."""

    def remaining(self, route: Sequence[ItemKey]) -> None:
        """Report the items that it still plans to do, in order; initially those of Start."""


class FloorPlan(Protocol):
    """The robot's map."""

    def random_point(self) -> Point:
        """Return a uniformly random point in the scenario's areas where the robot can stand.

        Without areas: on all floor that the robot can reach. Uses the behaviour's random stream.
        """

    def is_free(self, point: Point) -> bool:
        """Return True if the robot's centre can be at `point`, m, including the planner's margin."""

    def length(self, start: Point, goal: Point) -> float | None:
        """Return the length of the shortest path, m; None if there is no path.

        A point that the robot cannot occupy is moved to the nearest free one within 0.5 m. The first query
        for a goal takes about 1 ms, further queries microseconds: use a point that is common to many queries
        as the goal.
        """

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """Return that path as points 0.1 to 0.2 m apart, m; None if there is none.

        Plans of navigation differ: they keep a distance to walls.
        """

    @property
    def doors(self) -> tuple[Door, ...]:
        """Passages of the map in which two robots cannot pass each other."""

    def doors_between(self, start: Point, goal: Point) -> tuple[int, ...] | None:
        """Return the indices of the doors on the shortest path, ends included; None if there is no path."""

    def door(self, point: Point) -> int | None:
        """Return the index of the door that contains `point`; None if there is none."""

    def region(self, point: Point) -> int | None:
        """Return the number of the region between doors; None in a door and off the floor."""


Scalar: TypeAlias = bool | int | float | str
Setting: TypeAlias = Scalar | tuple[Scalar, ...]
"""A value in a scenario's table [strategy]; a list becomes a tuple."""
MAX_RSSI_DBM: Final = 0.0
"""Upper bound of reported signal strengths, dBm (`actors.radio.frame` ends at -35 dBm)."""
MAX_BACK_OUT: Final = 3.0
"""Longest distance of backing out, m: the length of the trail that a robot stores."""
_Interval = Annotated[Duration, Meta(ge=milliseconds(1), le=seconds(LONGEST_S))]


class ExchangeSettings(Settings, frozen=True):
    """Exchange of knowledge between nodes of the component model: a scenario's table [deeco]."""

    publish: _Interval = seconds(1)
    """Period of publishing a node's knowledge (d3scomp/JDEECo, DefaultKnowledgePublisher)."""
    relay: bool = False
    """Rebroadcast received knowledge; off in d3scomp/deeco-adaptation-testbed."""
    hop_limit: Annotated[int, Meta(ge=1, le=15)] = 3
    """Maximum number of rebroadcasts; own choice: the corridor is three radio ranges long."""
    relay_delay: Interval = seconds(1)
    """Longest delay before a rebroadcast, used for the strongest signal (d3scomp/JDEECo 2,
    DefaultKnowledgeDataManager)."""
    relay_below: Annotated[float, Meta(ge=-90, le=MAX_RSSI_DBM, extra={"unit": "dBm"})] = MAX_RSSI_DBM
    """Rebroadcast only knowledge received more weakly than this, dBm; transceivers resolve nothing below
    -90 dBm (`actors.radio.frame`). Default: no limit; own choice, decision 22. JDEECo uses a distance
    (RebroadcastStrategy)."""
    forget: _Interval = seconds(30)
    """Age at which replicas are dropped; own choice. JDEECo keeps them forever."""
    key: (
        Annotated[
            str,
            Meta(
                pattern=r"\A[0-9a-fA-F]{32}\Z",
                description="a string of 32 hexadecimal digits, as of `openssl rand -hex 16`",
            ),
        ]
        | None
    ) = None
    """Key of all nodes that authenticates packets (`deeco.aes_ccm`); absent: no authentication."""


_DEFAULT_EXCHANGE: Final = ExchangeSettings()


class _NoFloorPlan:
    """Placeholder for a Start without floor plan: has no doors, and every query raises LookupError."""

    doors: tuple[Door, ...] = ()

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):
            raise AttributeError(name)
        raise LookupError("this Start has no floor plan; pass floor=")


_NO_FLOOR: Final = cast(FloorPlan, _NoFloorPlan())


@dataclass(frozen=True)
class Start:
    """Initial data of a behaviour."""

    robot: str
    """The robot's id, unique in the swarm."""
    address: int
    """The robot's short address on the radio (IEEE 802.15.4)."""
    epoch: int
    """Number of restarts of this robot in the run; only the id survives a restart."""
    pose: Pose
    """Pose of the robot when its base was switched on, m and rad, map frame."""
    items: tuple[Any, ...]
    """Items that the task gives to the robot, as plain values, in the order of the scenario; a View may add
    more. `msgspec.convert` makes them the task's item type."""
    generator: Generator
    """The behaviour's random stream: the only randomness it may use."""
    settings: Mapping[str, Setting] = field(default_factory=lambda: MappingProxyType({}))
    """The scenario's table [strategy]: settings that differ from the strategy's defaults; read-only."""
    exchange: ExchangeSettings = _DEFAULT_EXCHANGE
    """Exchange of knowledge, if the behaviour has a node."""
    floor: FloorPlan = _NO_FLOOR
    """The robot's map; its random points come from `generator`."""
    members: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """Radio addresses by id of all robots of the run or fleet, also of this one and of those that are off, in
    the order of its file; read-only."""


class View(NamedTuple):
    """Input of a behaviour at the start of a step."""

    instant: Instant
    pose: Pose
    """Pose estimate, m and rad, map frame."""
    moving: bool
    """True if the base reports more than a minimal speed."""
    goal: Goal | None
    """None before the first goal and after CANCEL."""
    radio: tuple[RadioEvent, ...]
    """Events of the transceiver since the last step, in order of time; includes corrupt frames."""
    covariance: Covariance = CERTAIN
    """Covariance of the pose estimate."""
    lost: float = 0.0
    """Probability that the pose estimate is wrong."""
    plan: Plan | None = None
    """The plan that navigation follows to the goal; None if there is none."""
    backing_out: bool = False
    """True while the robot backs out because of a decision."""
    items: tuple[Any, ...] = ()
    """Items given in this step; they follow those of Start and of earlier views."""
    battery: float | None = None
    """Charge of the battery, 0 to 1; None: unknown."""


@dataclass(frozen=True)
class Decision:
    """Requests of a behaviour after a step."""

    goal: Point | GoalOrder = GoalOrder.KEEP
    """A point replaces the current goal; the same point again starts a new attempt."""
    _: KW_ONLY
    frames: tuple[OutgoingFrame, ...] = ()
    """Frames to broadcast, in order of their instants, which lie within the step."""
    reports: tuple[MessagePart, ...] = ()
    """Reports of the task's own type."""
    given_up: tuple[ItemGivenUp, ...] = ()
    """Items that no robot should try again."""
    route: tuple[ItemKey, ...] | None = None
    """Items that the robot still plans to do, in order; None: unchanged, initially those of Start."""
    paused: bool | None = None
    """True: stand and keep the goal; False: continue with all timeouts reset; None: unchanged, initially
    False."""
    peers: tuple[Point, ...] | None = None
    """Estimated positions of other robots, m, map frame, at which the localiser ignores range readings.
    Replaces the previous positions; None: unchanged, initially none."""
    back_out: float | None = None
    """Distance to back out along the robot's trail, m, above 0 and at most MAX_BACK_OUT; None: unchanged.
    Goals are resumed afterwards; CANCEL ends it."""
    relocalise: bool = False
    """True: discard the pose estimate and search the whole map."""


class Behaviour(Protocol):
    """Controller of one robot, written by the user; keeps its state between steps.

    It may have a method `outcome() -> dict[str, object]`, called once when its process ends: results by name,
    as JSON values. They are recorded and are not part of the run's digest. Numbers, strings and booleans,
    also in nested dicts, appear in the run's result and in tables. Reserved names: "deeco", "adaptation",
    "localisation" and "navigation".
    """

    def advance(self, view: View, until: Instant) -> Decision:
        """Process all events from `view.instant` to before `until`.

        A goal takes effect in the next step. Steps are missing between two calls if the robot was frozen.
        Clocks, global randomness and iteration over sets are not allowed.
        """
