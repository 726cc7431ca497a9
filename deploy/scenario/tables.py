"""Tables of a scenario file; lengths in m, angles in rad, times in s."""

import json
import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, TypeVar

from msgspec import Meta, field

from actors.floor.placement import Area
from actors.radio.radio_model import RadioTable, WifiParameters
from actors.radio.walls import WallPatch
from actors.randomness import keyed_seed
from actors.robot.behaviour.ports import ExchangeSettings, Scalar
from actors.robot.stack import TABLES, Adaptation, Stack, presets, stack
from actors.robot_model import MOST_ITEMS as MOST_TASK_ITEMS
from actors.robot_model import AdversaryKind, Items, Model, OdometryKind, SensorName
from actors.runtime.errors import AcrcError
from actors.settings import (
    Names,
    ParameterError,
    Place,
    Settings,
    Share,
    Span,
    StartPose,
    Text,
    check_spans,
    decode,
    plain,
)
from actors.task.loading import DEFAULT, load_task
from actors.world.people import PeopleParameters
from actors.world.uncertainty import Uncertainty

MOST_WIFI: Final = 20
MOST_ROBOTS: Final = 500
MOST_ITEMS: Final = 1000
"""Items of a list in [strategy]."""
ROBOT_ID: Final = re.compile(r"r[1-9][0-9]{0,3}")
RobotId = Annotated[
    str, Meta(pattern=rf"\A{ROBOT_ID.pattern}\Z", description='the id of a robot, such as "r2"')
]
Seconds = Annotated[float, Meta(gt=0, le=1_000_000, extra={"unit": "seconds"})]
Seed = Annotated[int, Meta(ge=0, le=2**63 - 1)]
StepMs = Annotated[
    int,
    Meta(
        ge=10, le=100, multiple_of=10, description="a multiple of the 10 ms physics sub-step, from 10 to 100"
    ),
]
Parameters = Annotated[dict[str, Any], Meta(description="a table of a preset and of parameters")]
"""Content as in the file; `actors.robot.stack` checks it."""
_Setting = Annotated[
    Scalar | Annotated[tuple[Scalar, ...], Meta(max_length=MOST_ITEMS)],
    Meta(
        description="true, false, a whole number of 64 bits, a finite number, a string, or a list of at most"
        f" {MOST_ITEMS} of these"
    ),
]
_StrategySettings = Annotated[
    dict[str, _Setting],
    Meta(description="a table [strategy] with the strategy's settings; its name is in run.strategy"),
]


class ConductTable(Settings, frozen=True):
    """[run]: the robots' adaptation strategy."""

    strategy: Annotated[Text, Meta(description='the name of a strategy, such as "none"')] = "none"
    """Name of the strategy, or the entry "module:function" of a user's one."""
    modules: Annotated[Text, Meta(description="the path of a folder, relative to this file")] | None = None
    """Folder of a user's strategy, searched before the working directory; absent: the file's folder."""


class RunTable(ConductTable, frozen=True):
    """[run]: duration, step, seed and strategy."""

    duration: Seconds = 600.0
    """Simulated time after which the run ends, s."""
    step_ms: StepMs = 100
    """Length of a step, ms."""
    seed: Seed = 1
    """Seed of all random streams."""
    key: (
        Annotated[
            str,
            Meta(
                pattern=r"\A([0-9a-fA-F]{2}){16,64}\Z",
                description="32 to 128 hexadecimal digits, an even number, as of `openssl rand -hex 16`",
            ),
        ]
        | None
    ) = None
    """Secret second seed of all random streams: robots that know `seed` cannot predict them."""

    def seed_of(self, part: str) -> int:
        """Return the seed of one part of the run, such as "radio"."""
        return keyed_seed(self.seed, self.key or "", part)


class RobotsTable(Settings, frozen=True):
    """[robots]: number, model and starts."""

    count: Annotated[int, Meta(ge=1, le=MOST_ROBOTS)] = 4
    """Number of robots; their ids are r1, r2, and so on."""
    model: Model = "turtlebot2"
    """Name of a shipped robot model, or the path of a model file relative to the scenario file."""
    sensor: SensorName | None = None
    """Mounted sensor of the model; absent: its default."""
    odometry: OdometryKind | None = None
    """Model of odometry errors; absent: that of the robot model."""
    battery: Share | None = None
    """Charge of the batteries at the start, 0 to 1; absent: batteries are not simulated."""
    start: Annotated[
        tuple[StartPose, ...],
        Meta(max_length=MOST_ROBOTS, description=f"a list of at most {MOST_ROBOTS} poses [x, y, heading]"),
    ] = ()
    """Start poses of r1, r2, …; other robots get a random free one."""
    areas: Names | None = None
    """Areas of random starts; absent: all free floor."""


class TaskTable(Settings, frozen=True):
    """[task]: the task of the run; its settings are in a table of the task's own."""

    use: Annotated[Text, Meta(description='the name of a task, such as "cleaning"')] = DEFAULT
    """Name of the task, or the entry "module:Class" of a user's one."""


class RobotTable(Settings, frozen=True):
    """[[robot]]: values of one robot that differ from the others."""

    id: RobotId
    model: Model | None = None
    sensor: SensorName | None = None
    """Mounted sensor; absent: as in [robots] if the model is the same, else the model's default."""
    odometry: OdometryKind | None = None
    battery: Share | None = None
    start: StartPose | None = None
    items: Items | None = None
    """The robot's initial items; in files, the key has the name of the task's table."""
    adversary: AdversaryKind | None = None


class EventTable(Settings, frozen=True):
    """[[event]]: one action at an instant, with its further keys."""

    at: Annotated[
        float, Meta(ge=0, le=1_000_000, description="a number of seconds from 0 to below the duration")
    ]
    """Instant, s; the action happens at the first step boundary not before it."""
    kill: RobotId | None = None
    """End the robot's process; its body stays."""
    freeze: RobotId | None = None
    """Stop the robot's process."""
    thaw: RobotId | None = None
    """Continue a frozen robot's process."""
    restart: RobotId | None = None
    """Restart the robot's process."""
    move: RobotId | None = None
    """Move the robot to the pose `to`."""
    to: StartPose | None = None
    jam: Place | None = None
    """Switch a jammer on at this point, with `radius` and `duration`."""
    lose: RobotId | None = None
    """Drop the next frame that the robot would receive from robot `of`."""
    of: RobotId | None = None
    obstacle: Place | None = None
    """Put a round obstacle on the floor, with `radius`."""
    give: RobotId | None = None
    """Give the robot further `items`."""
    items: (
        Annotated[
            tuple[Any, ...],
            Meta(
                min_length=1,
                max_length=MOST_TASK_ITEMS,
                description=f"a list of 1 to {MOST_TASK_ITEMS} items of the task",
            ),
        ]
        | None
    ) = None
    """In files, the key has the name of the task's table."""
    close: Place | None = None
    """Close the door at this point, once it is empty."""
    open: Place | None = None
    """Open the door at this point again."""
    radius: Annotated[float, Meta(gt=0, le=1000, extra={"unit": "metres"})] | None = None
    duration: Seconds | None = None


class AreaTable(Settings, frozen=True):
    """[[area]]: a named rectangle of the floor."""

    name: Annotated[Text, Meta(description='a name such as "hall"')]
    x: Span
    """West and east edge, m."""
    y: Span
    """South and north edge, m."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_spans(self, "x", "y")

    @property
    def area(self) -> Area:
        """The rectangle."""
        (x0, x1), (y0, y1) = self.x, self.y
        return Area(self.name, x0, y0, x1, y1)


class PeopleTable(PeopleParameters, frozen=True):
    """[people]: people who walk about the floor."""

    areas: Names | None = None
    """Names of the areas of `between = "areas"`; absent: all of the scenario."""
    area: tuple[AreaTable, ...] = ()
    """Own areas, used in place of the scenario's, such as {name = "hall", x = [1, 5], y = [2, 4]}."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.between != "areas":
            self.check_unused(("areas", "area"), f'people.between is "{self.between}"')


class SwarmFile(Settings, frozen=True, kw_only=True):
    """Tables that scenario and fleet files share."""

    map: Annotated[Text, Meta(description="the path of a map's YAML file, relative to this file")]
    """Map file; in a scenario also a drawn floor, such as "offices:7" (`actors.floor.offices`)."""
    strategy: _StrategySettings = field(default_factory=dict)
    """Settings of the strategy in [run]; absent ones have its defaults."""
    deeco: ExchangeSettings = ExchangeSettings()
    localisation: Parameters = field(default_factory=dict)
    """Localisation: a preset and parameters that differ from it (`actors.robot.stack`)."""
    navigation: Parameters = field(default_factory=dict)
    """Navigation: a preset, which also applies to the next three tables, and parameters."""
    planner: Parameters = field(default_factory=dict)
    local_map: Parameters = field(default_factory=dict)
    dwa: Parameters = field(default_factory=dict)
    area: tuple[AreaTable, ...] = ()
    task: TaskTable = TaskTable()
    task_settings: Parameters = field(default_factory=dict)
    """The task's table, whose key in files is `TaskDeclaration.table`; content as in the file."""

    @property
    def table(self) -> str:
        """Key of the task's table in files."""
        return load_task(self.task.use).declaration.table

    @property
    def adaptation(self) -> Adaptation:
        """Strategy settings and exchange of every robot."""
        return Adaptation(dict(self.strategy), self.deeco, self.areas)

    @property
    def areas(self) -> tuple[Area, ...]:
        """The named areas."""
        return tuple(table.area for table in self.area)

    @property
    def stack(self) -> Stack:
        """Localisation and navigation of every robot. Raises AcrcError."""
        return stack({name: getattr(self, name) for name in TABLES})

    @property
    def presets(self) -> dict[str, str]:
        """The presets of localisation and of navigation, by table."""
        return presets({"localisation": self.localisation, "navigation": self.navigation})


class Scenario(SwarmFile, frozen=True, kw_only=True):
    """A scenario file; once loaded, all paths are absolute and `run.modules` is set."""

    run: RunTable = RunTable()
    robots: RobotsTable = RobotsTable()
    radio: RadioTable = RadioTable()
    uncertainty: Uncertainty = Uncertainty()
    people: PeopleTable | None = None
    robot: tuple[RobotTable, ...] = ()
    event: tuple[EventTable, ...] = ()
    wall: tuple[WallPatch, ...] = ()
    wifi: Annotated[tuple[WifiParameters, ...], Meta(max_length=MOST_WIFI)] = ()

    @property
    def ids(self) -> tuple[str, ...]:
        """The robots' ids, in order."""
        return tuple(f"r{number}" for number in range(1, self.robots.count + 1))


_BARE: Final = re.compile(r"[A-Za-z0-9_-]+")
"""TOML keys that need no quotes."""


def toml_document(content: Mapping[str, Any]) -> str:
    """Return the file's text: values, then tables and lists of tables; empty ones are omitted.

    Values are bool, int, finite float, str, and lists and tuples of them; floats keep every digit.
    """
    tables = {name: value for name, value in content.items() if _holds_tables(value)}
    parts = [_lines({name: value for name, value in content.items() if name not in tables})]
    for name, value in tables.items():
        if isinstance(value, Mapping):
            parts += [f"[{_key(name)}]\n{_lines(value)}"] if value else []
        else:
            parts += [f"[[{_key(name)}]]\n{_lines(table)}" for table in value]
    return "\n\n".join(filter(None, parts)) + "\n"


def inline_toml(value: object) -> str:
    """Return a value as TOML on one line; tables in it are inline tables."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            # JSON strings are TOML strings, except that TOML requires DEL escaped
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case Mapping():
            return "{" + ", ".join(f"{_key(key)} = {inline_toml(part)}" for key, part in value.items()) + "}"
        case list() | tuple():
            return f"[{', '.join(map(inline_toml, value))}]"
        case _:
            return repr(value)


def _holds_tables(value: object) -> bool:
    """Return whether a value is a table or a list of tables; an empty list is one."""
    items = value if isinstance(value, list | tuple) else [value]
    return all(isinstance(item, Mapping) for item in items)


def _lines(table: Mapping[str, Any]) -> str:
    return "\n".join(f"{_key(name)} = {_value(value)}" for name, value in table.items())


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else inline_toml(name)


def _value(value: object) -> str:
    """Return a value as TOML; a list of poses or points has one per line."""
    if isinstance(value, tuple) and value and all(isinstance(item, tuple) for item in value):
        return "[\n" + "".join(f"    {inline_toml(item)},\n" for item in value) + "]"
    return inline_toml(value)


_F = TypeVar("_F", bound=SwarmFile)
_TASK_KEYS: Final = ("task_settings", "items")
"""Names of the task's table, and of a robot's or an event's items, in this program."""


def decode_swarm_file(kind: type[_F], content: Mapping[str, Any]) -> _F:
    """Return a file's content as a struct; keys of the task have the name of its table.

    Raises ParameterError with the file's key, or AcrcError.
    """
    task = decode(TaskTable, content.get("task", {}), "task")
    declaration = load_task(task.use).declaration
    table = declaration.table
    named = _with_keys(content, (table, table), _TASK_KEYS)
    run = named.get("run", {})
    if task.use != DEFAULT and isinstance(run, Mapping) and "strategy" not in run:
        if not declaration.baseline:
            raise AcrcError(
                f"run.strategy is missing, but must be a strategy for the task {declaration.name}"
            )
        named["run"] = {**run, "strategy": declaration.baseline}
    try:
        return decode(kind, named)
    except ParameterError as error:
        names = re.compile(r"task_settings|(?<=\]\.)items|(?<=[:,] )items(?=, |$)")
        key, sentence = (names.sub(table, text) for text in (error.key, str(error)))
        raise ParameterError(key, error.value, error.expected, sentence) from None


def _with_keys(content: Mapping[str, Any], old: tuple[str, str], new: tuple[str, str]) -> dict[str, Any]:
    """Return content with the keys of the task's table and of items renamed.

    Raises ParameterError for a file with one of _TASK_KEYS.
    """
    found = _renamed(content, old[0], new[0])
    for key in ("robot", "event"):
        tables = found.get(key)
        for index, one in enumerate(tables if isinstance(tables, list | tuple) else ()):
            if isinstance(one, Mapping):
                found[key] = [*found[key]]
                found[key][index] = _renamed(one, old[1], new[1], f"{key}[{index}].")
    return found


def _renamed(table: Mapping[str, Any], old: str, new: str, where: str = "") -> dict[str, Any]:
    for name in _TASK_KEYS if new in _TASK_KEYS else ():
        if name in table and name != old:
            sentence = f"{where}{name} is not a key; the task's key is {old}"
            raise ParameterError(f"{where}{name}", table[name], "", sentence)
    return {new if name == old else name: value for name, value in table.items()}


def to_toml(scenario: Scenario) -> str:
    """Return the scenario file's text, which loads as an equal scenario."""
    content = plain(scenario)
    if scenario.task == TaskTable():
        del content["task"]
    return toml_document(_with_keys(content, _TASK_KEYS, (scenario.table, scenario.table)))
