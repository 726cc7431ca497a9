"""The tables of a scenario file, as they stand in its TOML; lengths in m, angles in rad, times in s."""

import json
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, StringConstraints

from actors.radio.propagation.walls import MATERIALS
from actors.randomness import keyed_seed
from actors.robot_model import OdometryKind
from actors.table import A_POINT, A_POSE, FileTable, Point, Pose, Right, Span, Text, as_tuples
from deploy.scenario.stack_tables import AreaTable, DeecoTable, Settings

MOST_WIFI: Final = 20


def _known(name: str) -> str:
    if name not in MATERIALS:
        raise ValueError
    return name


Material = Annotated[
    str,
    AfterValidator(_known),
    Right("a material: " + ", ".join(f'"{name}"' for name in MATERIALS)),
]


class RadioTable(FileTable):
    """[radio]: the model of the air; what is absent is as the preset has it."""

    preset: Annotated[Text, Right('the name of a radio preset, such as "chapter"')] = "chapter"
    """Name of the radio's parameters."""
    channel: Annotated[
        int | None, Field(ge=11, le=26), Right("an IEEE 802.15.4 channel, a whole number from 11 to 26")
    ] = None
    """Which part of the band the frames use; it counts where there is Wi-Fi."""
    walls: Material | None = None
    """What everything is made of that is occupied on the map; "air": walls cost nothing."""
    shadowing_db: Annotated[float | None, Field(ge=0, le=30), Right("a number of dB from 0 to 30")] = None
    """Standard deviation of the loss between places alike, dB; 0: none."""
    correlation_distance: Annotated[
        float | None, Field(ge=0.1, le=1000), Right("a number of metres from 0.1 to 1000")
    ] = None
    """Over which the shadowing changes, m."""


class WallTable(FileTable):
    """[[wall]]: a rectangle in which what is occupied on the map is of a material of its own."""

    material: Material
    x: Span
    """From west to east, m."""
    y: Span
    """From south to north, m."""


class WifiTable(FileTable):
    """[[wifi]]: a Wi-Fi station that is on and off."""

    at: Annotated[Point, Right(A_POINT)]
    """Where it stands."""
    channel: Annotated[int, Field(ge=1, le=13), Right("a Wi-Fi channel, a whole number from 1 to 13")]
    duty: Annotated[float, Field(gt=0, lt=1), Right("a number above 0 and below 1")]
    """Share of the time that it sends."""
    power_dbm: Annotated[float, Field(ge=-60, le=30), Right("a number of dBm from -60 to 30")] = 17.0
    """Radiated power, dBm."""


MOST_PLACES: Final = 1000
ROBOT_ID: Final = re.compile(r"r[1-9][0-9]{0,3}")
Id = Annotated[str, StringConstraints(pattern=rf"^{ROBOT_ID.pattern}$")]
RobotId = Annotated[Id, Right('the id of a robot, such as "r2"')]
Names = Annotated[
    tuple[Text, ...],
    BeforeValidator(as_tuples),
    Field(min_length=1),
    Right('a list of names of areas, such as ["hall"]', item='the name of an area, such as "hall"'),
]
Model = Annotated[Text, Right('the name of a robot model such as "turtlebot2", or the path of a .toml file')]
Sensor = Annotated[Text, Right('the name of one of the robot model\'s sensors, such as "chapter"')]
OdometryName = Annotated[OdometryKind, Right('"exact", "stage" or "kobuki"')]
Radius = Annotated[float, Field(gt=0, le=1000), Right("a number of metres above 0, at most 1000")]
Seconds = Annotated[float, Field(gt=0, le=1e6), Right("a number of seconds above 0, at most 1000000")]
Parameters = Annotated[Mapping[str, Any], Right("a table of a preset and of parameters")]
"""As it stands in the file; what may stand there, `deploy.scenario.stack_tables` says."""


MOST_ROBOTS: Final = 500


class RunTable(FileTable):
    """[run]: how long, in which steps, from which seed, and what the robots do when they are stuck."""

    duration: Seconds = 600.0
    """Simulated time after which the run ends, s."""
    step_ms: Annotated[
        int,
        Field(ge=10, le=100, multiple_of=10),
        Right("a multiple of the 10 ms physics sub-step, from 10 to 100"),
    ] = 100
    """Length of a step, ms."""
    seed: Annotated[int, Field(ge=0, lt=2**63), Right("a whole number from 0 to 9223372036854775807")] = 1
    """From which every random stream is derived."""
    key: Annotated[
        str | None,
        Field(pattern="^([0-9a-fA-F]{2}){16,64}$"),
        Right("32 to 128 hexadecimal digits, an even number, as of `openssl rand -hex 16`"),
    ] = None
    """Every random stream is derived from it, too, so that no robot that knows the seed can compute one."""
    strategy: Annotated[Text, Right('the name of a strategy, such as "none"')] = "none"
    """Name of the robots' adaptation strategy, or the entry "module:function" of one's own."""
    modules: Annotated[Text | None, Right("the path of a folder, relative to the scenario file")] = None
    """Where one's own strategy is looked for, before the working directory; absent: beside the file."""

    def seed_of(self, part: str) -> int:
        """The seed of what is drawn for one part of the run."""
        return keyed_seed(self.seed, self.key or "", part)


class RobotsTable(FileTable):
    """[robots]: how many, of which kind, and where they start."""

    count: Annotated[int, Field(ge=1, le=MOST_ROBOTS), Right(f"a whole number from 1 to {MOST_ROBOTS}")] = 4
    """They are called r1, r2, and so on."""
    model: Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the scenario file."""
    sensor: Sensor | None = None
    """Which of the model's sensors is mounted; absent: the model's own choice."""
    odometry: OdometryName | None = None
    """Which errors the odometry has; absent: those of the model."""
    start: Annotated[
        tuple[Pose, ...],
        BeforeValidator(as_tuples),
        Field(max_length=MOST_ROBOTS),
        Right(f"a list of poses [x, y, heading] in m, m and rad, at most {MOST_ROBOTS}", item=A_POSE),
    ] = ()
    """Where r1, r2, … start; robots beyond the list are put somewhere free."""
    areas: Names | None = None
    """Where they are put then: in these areas; absent: anywhere free."""


class PlacesTable(FileTable):
    """[places]: which places the robots have to clean."""

    preset: Annotated[
        Literal["golden", "areas", "free", "listed"] | None, Right('"golden", "areas", "free" or "listed"')
    ] = None
    """areas: drawn in `areas`; free: drawn on all reachable floor; listed: every [[robot]] lists its own;
    golden: those of the original testbed for r1 to r4, for the others as if absent. Absent: areas if the
    scenario has any, else free."""
    areas: Names | None = None
    """In which areas, each as often as its surface says; absent: in all of the scenario's."""
    per_robot: Annotated[
        int | None, Field(ge=0, le=MOST_PLACES), Right(f"a whole number from 0 to {MOST_PLACES}")
    ] = None
    """How many each robot gets; absent: 10, as in the original testbed."""


class UncertaintyTable(FileTable):
    """[uncertainty]: how the floor differs from the robots' map, what sensors miss, how odometry drifts."""

    map_error: Annotated[float, Field(ge=0, le=0.5), Right("a number of metres from 0 to 0.5")] = 0.0
    """Standard deviation of how far walls are from where the map has them, m."""
    glass: Annotated[float, Field(ge=0, le=1), Right("a share from 0 to 1")] = 0.0
    """Share of the walls that range sensors look through."""
    furniture: Annotated[int, Field(ge=0, le=1000), Right("a whole number from 0 to 1000")] = 0
    """So many things on the floor, of 0.25 m radius, that the map does not have."""
    drift: Annotated[float, Field(ge=0, le=1000), Right("a number from 0 to 1000")] = 1.0
    """The odometry's errors are so many times as large as those of its kind."""
    dropout: Annotated[float, Field(ge=0, le=1), Right("a share from 0 to 1")] = 0.0
    """Share of the rays of every scan that give no echo, whatever they hit."""


class RobotTable(FileTable):
    """[[robot]]: what is different about one robot."""

    id: RobotId
    model: Model | None = None
    sensor: Sensor | None = None
    """Which sensor; absent: as for all robots if the model is theirs, else the model's own choice."""
    odometry: OdometryName | None = None
    start: Annotated[Pose | None, Right(A_POSE)] = None
    places: Annotated[
        tuple[Point, ...] | None,
        BeforeValidator(as_tuples),
        Field(max_length=MOST_PLACES),
        Right(f"a list of points [x, y] in m, at most {MOST_PLACES}", item=A_POINT),
    ] = None
    """The places it has to clean, in this order."""


class EventTable(FileTable):
    """[[event]]: something that happens at an instant: one of the actions, with what belongs to it."""

    at: Annotated[float, Field(ge=0, le=1e6), Right("a number of seconds from 0 to below the duration")]
    """When, s; it happens at the first step boundary from then on."""
    kill: RobotId | None = None
    """End the robot's process; its body stays."""
    freeze: RobotId | None = None
    """Stop the robot's process."""
    thaw: RobotId | None = None
    """Let a frozen robot go on."""
    restart: RobotId | None = None
    """Start the robot's process anew."""
    move: RobotId | None = None
    """Put the robot somewhere else: `to`."""
    to: Annotated[Pose | None, Right(A_POSE)] = None
    jam: Annotated[Point | None, Right(A_POINT)] = None
    """Switch a jammer on: `radius`, `duration`."""
    lose: RobotId | None = None
    """Let the robot not receive the next frame that it would have received: `of` whom."""
    of: RobotId | None = None
    obstacle: Annotated[Point | None, Right(A_POINT)] = None
    """Put a round thing on the floor: `radius`."""
    give: RobotId | None = None
    """Give the robot further places: `places`."""
    places: Annotated[
        tuple[Point, ...] | None,
        BeforeValidator(as_tuples),
        Field(min_length=1, max_length=MOST_PLACES),
        Right(f"a list of 1 to {MOST_PLACES} points [x, y] in m", item=A_POINT),
    ] = None
    close: Annotated[Point | None, Right(A_POINT)] = None
    """Close the door that this point lies in, once nobody stands in it."""
    open: Annotated[Point | None, Right(A_POINT)] = None
    """Open it again."""
    radius: Radius | None = None
    duration: Seconds | None = None


class Scenario(FileTable):
    """A scenario file; all paths in it are absolute once it has been read, and `run.modules` is set."""

    map: Annotated[Text, Right("the path of a map's YAML file, relative to the scenario file")]
    """A map file; or the name of a floor that `actors.floor.offices` draws, such as "offices:7"."""
    run: RunTable = RunTable()
    strategy: Settings = Field(default_factory=dict)
    """Settings of the strategy that [run] names; what is absent is as the strategy has it."""
    deeco: DeecoTable = DeecoTable()
    localisation: Parameters = Field(default_factory=dict)
    """How robots localise: a preset, and parameters where they differ from it (`stack_tables`)."""
    navigation: Parameters = Field(default_factory=dict)
    """The same of their navigation; the preset holds for the next three tables, too."""
    planner: Parameters = Field(default_factory=dict)
    local_map: Parameters = Field(default_factory=dict)
    dwa: Parameters = Field(default_factory=dict)
    robots: RobotsTable = RobotsTable()
    places: PlacesTable = PlacesTable()
    radio: RadioTable = RadioTable()
    uncertainty: UncertaintyTable = UncertaintyTable()
    area: Annotated[tuple[AreaTable, ...], BeforeValidator(as_tuples)] = ()
    robot: Annotated[tuple[RobotTable, ...], BeforeValidator(as_tuples)] = ()
    event: Annotated[tuple[EventTable, ...], BeforeValidator(as_tuples)] = ()
    wall: Annotated[tuple[WallTable, ...], BeforeValidator(as_tuples)] = ()
    wifi: Annotated[tuple[WifiTable, ...], BeforeValidator(as_tuples), Field(max_length=MOST_WIFI)] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """The robots' ids, in order."""
        return tuple(f"r{number}" for number in range(1, self.robots.count + 1))


_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
"""Keys that need no quotes."""


def document(content: Mapping[str, object]) -> str:
    """The file's text: values first, then tables and lists of tables; empty ones of these leave no text.

    Values are bool, int, finite float, str, and lists and tuples of them; floats keep every digit.
    """
    parts = ["\n".join(_line(name, value) for name, value in content.items() if not _holds_tables(value))]
    for name, value in content.items():
        if not value or not _holds_tables(value):
            continue
        if isinstance(value, Mapping):
            parts.append(_table(f"[{_key(name)}]", value))
        else:
            assert isinstance(value, Sequence)
            parts.extend(_table(f"[[{_key(name)}]]", table) for table in value)
    return "\n\n".join(part for part in parts if part) + "\n"


def inline(value: object) -> str:
    """A value on one line, as it may stand after an equals sign; tables in it as inline tables."""
    match value:
        case Mapping():
            return "{" + ", ".join(f"{_key(name)} = {inline(part)}" for name, part in value.items()) + "}"
        case list() | tuple():
            return f"[{', '.join(map(inline, value))}]"
        case _:
            return _value(value)


def _holds_tables(value: object) -> bool:
    """True for a table or a list of tables; an empty list is one of tables, too."""
    if isinstance(value, list | tuple):
        return all(isinstance(item, Mapping) for item in value)
    return isinstance(value, Mapping)


def _table(header: str, table: Mapping[str, object]) -> str:
    return "\n".join([header, *(_line(name, value) for name, value in table.items())])


def _line(name: str, value: object) -> str:
    return f"{_key(name)} = {_value(value)}"


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)


def _value(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return _text(value)
        case Sequence():
            return _array(value)
        case _:
            return repr(value)


def _text(value: str) -> str:
    # JSON's strings are TOML's but for DEL, which TOML wants escaped
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _array(items: Sequence[object]) -> str:
    """One line for a pose, a point or names, a line each for a list of poses or points."""
    if items and all(isinstance(item, tuple) for item in items):
        return "[\n" + "".join(f"    {_value(item)},\n" for item in items) + "]"
    return f"[{', '.join(map(_value, items))}]"


def to_toml(scenario: Scenario) -> str:
    """The scenario file's text, which reads back as the very same scenario; what is absent stays absent."""
    return document(scenario.model_dump(exclude_none=True))
