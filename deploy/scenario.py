"""The tables of a scenario file, as they stand in its TOML; lengths in m, angles in rad, times in s."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    StringConstraints,
)

from actors.robot.adaptation import LONGEST_S, MOST_HOPS, SHORTEST_S
from actors.robot.ports import Setting
from actors.robot_model import OdometryKind

MOST_ROBOTS: Final = 500
MOST_PLACES: Final = 1000
ROBOT_ID: Final = re.compile(r"r[1-9][0-9]{0,3}")


@dataclass(frozen=True)
class Right:
    """What would have been right, in words that go on after "must be"; `item`: the same for one of a list."""

    words: str
    item: str = ""


def _as_tuples(value: object) -> object:
    """TOML's arrays as tuples, so that the tables can be frozen all through."""
    return tuple(_as_tuples(item) for item in value) if isinstance(value, list) else value


def _growing(span: tuple[float, float]) -> tuple[float, float]:
    if not span[0] < span[1]:
        raise ValueError
    return span


def _setting(value: object) -> object:
    """What TOML can hold and what has one value: no date, no array, no table, no infinity."""
    match value:
        case bool() | str():
            return value
        case int() if -(2**63) <= value < 2**63:
            return value
        case float() if math.isfinite(value):
            return value
    raise ValueError


_Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
_Pose = Annotated[tuple[_Coordinate, _Coordinate, _Coordinate], BeforeValidator(_as_tuples)]
_Point = Annotated[tuple[_Coordinate, _Coordinate], BeforeValidator(_as_tuples)]
_Span = Annotated[
    tuple[_Coordinate, _Coordinate],
    BeforeValidator(_as_tuples),
    AfterValidator(_growing),
    Right("two numbers [from, to] in m, the first below the second"),
]
_A_POSE: Final = "a pose [x, y, heading] in m, m and rad"
_A_POINT: Final = "a point [x, y] in m"
_Id = Annotated[str, StringConstraints(pattern=rf"^{ROBOT_ID.pattern}$")]
_RobotId = Annotated[_Id, Right('the id of a robot, such as "r2"')]
_Text = Annotated[str, StringConstraints(min_length=1)]
_Names = Annotated[
    tuple[_Text, ...],
    BeforeValidator(_as_tuples),
    Field(min_length=1),
    Right('a list of names of areas, such as ["hall"]', item='the name of an area, such as "hall"'),
]
_Model = Annotated[
    _Text, Right('the name of a robot model such as "turtlebot2", or the path of a .toml file')
]
_Sensor = Annotated[_Text, Right('the name of one of the robot model\'s sensors, such as "chapter"')]
_Odometry = Annotated[OdometryKind, Right('"exact", "stage" or "kobuki"')]
_Radius = Annotated[float, Field(gt=0, le=1000), Right("a number of metres above 0, at most 1000")]
_Seconds = Annotated[float, Field(gt=0, le=1e6), Right("a number of seconds above 0, at most 1000000")]
_Interval = Annotated[
    float,
    Field(ge=SHORTEST_S, le=LONGEST_S),
    Right(f"a number of seconds from {SHORTEST_S} to {LONGEST_S}"),
]
_Settings = Annotated[
    Mapping[str, Annotated[Setting, PlainValidator(_setting)]],
    Right(
        "a table [strategy] with the strategy's settings; its name stands in run.strategy",
        item="true, false, a whole number of 64 bits, a finite number or a text",
    ),
]


class Table(BaseModel):
    """A table of the file: every key known, nothing converted, every number finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)


class RunTable(Table):
    """[run]: how long, in which steps, from which seed, and what the robots do when they are stuck."""

    duration: _Seconds = 600.0
    """Simulated time after which the run ends, s."""
    step_ms: Annotated[
        int,
        Field(ge=10, le=100, multiple_of=10),
        Right("a multiple of the 10 ms physics sub-step, from 10 to 100"),
    ] = 100
    """Length of a step, ms."""
    seed: Annotated[int, Field(ge=0, lt=2**63), Right("a whole number from 0 to 9223372036854775807")] = 1
    """From which every random stream is derived."""
    strategy: Annotated[_Text, Right('the name of a strategy, such as "none"')] = "none"
    """Name of the robots' adaptation strategy, or the entry "module:function" of one's own."""
    modules: Annotated[_Text | None, Right("the path of a folder, relative to the scenario file")] = None
    """Where one's own strategy is looked for, before the working directory; absent: beside the file."""


class DeecoTable(Table):
    """[deeco]: how the nodes of the component model exchange knowledge by radio."""

    publish: _Interval = 1.0
    """How often each robot publishes its knowledge, s (d3scomp/JDEECo, DefaultKnowledgePublisher)."""
    relay: Annotated[bool, Right("true or false")] = False
    """Robots pass on what they hear; off in the original testbed."""
    hop_limit: Annotated[int, Field(ge=1, le=MOST_HOPS), Right(f"a whole number from 1 to {MOST_HOPS}")] = 3
    """How often knowledge is passed on at most."""
    relay_delay: Annotated[
        float, Field(ge=0, le=LONGEST_S), Right(f"a number of seconds from 0 to {LONGEST_S}")
    ] = 1.0
    """The longest wait before knowledge is passed on, that for the strongest signal, s."""
    forget: _Interval = 30.0
    """Replicas of robots that were not heard of for so long are dropped, s."""


class RobotsTable(Table):
    """[robots]: how many, of which kind, and where they start."""

    count: Annotated[int, Field(ge=1, le=MOST_ROBOTS), Right(f"a whole number from 1 to {MOST_ROBOTS}")] = 4
    """They are called r1, r2, and so on."""
    model: _Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the scenario file."""
    sensor: _Sensor | None = None
    """Which of the model's sensors is mounted; absent: the model's own choice."""
    odometry: _Odometry | None = None
    """Which errors the odometry has; absent: those of the model."""
    start: Annotated[
        tuple[_Pose, ...],
        BeforeValidator(_as_tuples),
        Field(max_length=MOST_ROBOTS),
        Right(f"a list of poses [x, y, heading] in m, m and rad, at most {MOST_ROBOTS}", item=_A_POSE),
    ] = ()
    """Where r1, r2, … start; robots beyond the list are put somewhere free."""
    areas: _Names | None = None
    """Where they are put then: in these areas; absent: anywhere free."""


class PlacesTable(Table):
    """[places]: which places the robots have to clean."""

    preset: Annotated[
        Literal["golden", "areas", "free", "listed"] | None, Right('"golden", "areas", "free" or "listed"')
    ] = None
    """areas: drawn in `areas`; free: drawn on all reachable floor; listed: every [[robot]] lists its own;
    golden: those of the original testbed for r1 to r4, for the others as if absent. Absent: areas if the
    scenario has any, else free."""
    areas: _Names | None = None
    """In which areas, each as often as its surface says; absent: in all of the scenario's."""
    per_robot: Annotated[
        int | None, Field(ge=0, le=MOST_PLACES), Right(f"a whole number from 0 to {MOST_PLACES}")
    ] = None
    """How many each robot gets; absent: 10, as in the original testbed."""


class RadioTable(Table):
    """[radio]: the model of the air."""

    preset: Annotated[_Text, Right('the name of a radio preset, such as "chapter"')] = "chapter"
    """Name of the radio's parameters."""


class AreaTable(Table):
    """[[area]]: a rectangle of the floor that has a name."""

    name: Annotated[_Text, Right('a name such as "hall"')]
    x: _Span
    """From the west edge to the east edge, m."""
    y: _Span
    """From the south edge to the north edge, m."""


class RobotTable(Table):
    """[[robot]]: what is different about one robot."""

    id: _RobotId
    model: _Model | None = None
    sensor: _Sensor | None = None
    """Which sensor; absent: as for all robots if the model is theirs, else the model's own choice."""
    odometry: _Odometry | None = None
    start: Annotated[_Pose | None, Right(_A_POSE)] = None
    places: Annotated[
        tuple[_Point, ...] | None,
        BeforeValidator(_as_tuples),
        Field(max_length=MOST_PLACES),
        Right(f"a list of points [x, y] in m, at most {MOST_PLACES}", item=_A_POINT),
    ] = None
    """The places it has to clean, in this order."""


class EventTable(Table):
    """[[event]]: something that happens at an instant: one of the actions, with what belongs to it."""

    at: Annotated[float, Field(ge=0, le=1e6), Right("a number of seconds from 0 to below the duration")]
    """When, s; it happens at the first step boundary from then on."""
    kill: _RobotId | None = None
    """End the robot's process; its body stays."""
    freeze: _RobotId | None = None
    """Stop the robot's process."""
    thaw: _RobotId | None = None
    """Let a frozen robot go on."""
    restart: _RobotId | None = None
    """Start the robot's process anew."""
    move: _RobotId | None = None
    """Put the robot somewhere else: `to`."""
    to: Annotated[_Pose | None, Right(_A_POSE)] = None
    jam: Annotated[_Point | None, Right(_A_POINT)] = None
    """Switch a jammer on: `radius`, `duration`."""
    obstacle: Annotated[_Point | None, Right(_A_POINT)] = None
    """Put a round thing on the floor: `radius`."""
    radius: _Radius | None = None
    duration: _Seconds | None = None


class Scenario(Table):
    """A scenario file; all paths in it are absolute once it has been read, and `run.modules` is set."""

    map: Annotated[_Text, Right("the path of a map's YAML file, relative to the scenario file")]
    run: RunTable = RunTable()
    strategy: _Settings = {}
    """Settings of the strategy that [run] names; what is absent is as the strategy has it."""
    deeco: DeecoTable = DeecoTable()
    robots: RobotsTable = RobotsTable()
    places: PlacesTable = PlacesTable()
    radio: RadioTable = RadioTable()
    area: Annotated[tuple[AreaTable, ...], BeforeValidator(_as_tuples)] = ()
    robot: Annotated[tuple[RobotTable, ...], BeforeValidator(_as_tuples)] = ()
    event: Annotated[tuple[EventTable, ...], BeforeValidator(_as_tuples)] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """The robots' ids, in order."""
        return tuple(f"r{number}" for number in range(1, self.robots.count + 1))
