"""The tables of a scenario and of a fleet that choose localisation and navigation.

    [localisation]
    preset = "robust"      # the default; or "chapter", or "odometry": no localisation
    max_particles = 1000   # any field of AmclParameters

    [navigation]
    preset = "robust"      # the default; or "chapter": for this table, [planner], [local_map] and [dwa]

Beside the presets, any field of the parameters may be set; durations in s.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Annotated, Any, Final, Literal, TypeVar, cast, get_type_hints

from pydantic import AfterValidator, BeforeValidator, Field, PlainValidator, create_model

from actors import table_wording
from actors.bounds import ParameterError
from actors.floor.placement import Area
from actors.instant import Duration, in_seconds, seconds
from actors.robot.behaviour.adaptation import Adaptation
from actors.robot.behaviour.ports import EVERYBODY_DBM, LONGEST_S, ExchangeSettings, Setting
from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.stack import DEFAULT_PRESET, Stack
from actors.runtime.errors import AcrcError
from actors.table import FileTable, Right, Span, Text

ODOMETRY: Final = "odometry"
"""The preset of [localisation] that trusts the odometry alone."""
IMPROVED_REMOVED: Final = (
    '"improved", which was removed, but must be "robust", or, to drive as that did, "chapter" with '
    'navigation.reset_distance = 3.0, planner.method = "grid", planner.factor = 3.0, '
    'local_map.body = "disc", local_map.allowance = 0.0, local_map.padding = 0.045, '
    'local_map.inf_is_valid = true, dwa.rules = "disc" and dwa.granularity = 0.05'
)
"""Error for a file or an option that names the removed navigation preset `improved`."""
_P = TypeVar("_P")


_Seconds = Annotated[
    float,
    Field(ge=0, le=LONGEST_S),
    AfterValidator(seconds),
    Right(f"a number of seconds from 0 to {LONGEST_S}"),
]

_Whole = Annotated[int, Field(ge=-(2**63), lt=2**63), Right("a whole number of 64 bits")]
_KINDS: Final[Mapping[Any, Any]] = {Duration: _Seconds, int: _Whole}
"""How the file has a field of that type; others as they are."""


def _table(kind: type[Any], presets: tuple[str, ...] = ()) -> type[FileTable]:
    """The table of a kind of parameters: any of their fields, and a preset if there are some."""
    hints = get_type_hints(kind)
    keys: dict[str, Any] = {
        one.name: (_KINDS.get(hints[one.name], hints[one.name]), None) for one in fields(kind)
    }
    if presets:
        keys["preset"] = (Literal[presets], DEFAULT_PRESET)
    return create_model(f"{kind.__name__}Table", __base__=FileTable, **keys)


_TABLES: Final[Mapping[str, type[FileTable]]] = {
    "localisation": _table(AmclParameters, (*PRESETS, ODOMETRY)),
    "navigation": _table(NavigationParameters, tuple(NAVIGATION_PRESETS)),
    "planner": _table(PlanningParameters),
    "local_map": _table(CostMapParameters),
    "dwa": _table(DwaParameters),
}
TABLES: Final = tuple(_TABLES)
_FILE_KEYS: Final[Mapping[str, Any]] = {name: (table, table()) for name, table in _TABLES.items()}
_NavigationFile: Final = create_model("_NavigationFile", __base__=FileTable, **_FILE_KEYS)


def stack(tables: Mapping[str, Mapping[str, object]]) -> Stack:
    """Return the parameters that the tables give; where they name no preset, DEFAULT_PRESET holds.

    Raises AcrcError.
    """
    if (navigation := tables.get("navigation")) and navigation.get("preset") == "improved":
        raise AcrcError(f"navigation.preset is {IMPROVED_REMOVED}")
    return _stack(table_wording.checked(tables, _NavigationFile))


def _stack(file: Any) -> Stack:
    """What a _NavigationFile says, of whose fields mypy does not know."""
    preset = file.navigation.preset
    try:
        return Stack(
            localisation=_localisation(file.localisation),
            navigation=_with(NAVIGATION_PRESETS[preset], file.navigation),
            planner=_with(PLANNER_PRESETS[preset], file.planner),
            local_map=_with(LOCAL_MAP_PRESETS[preset], file.local_map),
            dwa=_with(DWA_PRESETS[preset], file.dwa),
        )
    except ParameterError as error:
        raise AcrcError(str(error)) from None


def _localisation(table: Any) -> AmclParameters | None:
    if table.preset != ODOMETRY:
        return _with(PRESETS[table.preset], table)
    for name in table.model_dump(exclude_unset=True, exclude={"preset"}):
        raise AcrcError(
            f'localisation.{name} is set, but must be left out where the preset is "{ODOMETRY}", '
            "which has no parameters"
        )
    return None


def _with(preset: _P, table: FileTable) -> _P:
    """The parameters of a preset with what the table sets. Raises ParameterError."""
    return cast(_P, replace(cast(Any, preset), **table.model_dump(exclude_unset=True, exclude={"preset"})))


def stack_of(file: FileTable) -> Stack:
    """What a scenario or a fleet file says. Raises AcrcError."""
    return stack(file.model_dump(include=set(TABLES)))


def presets_of(file: FileTable) -> dict[str, str]:
    """Return the presets of localisation and of navigation of a scenario or a fleet file, by table."""
    tables = file.model_dump(include={"localisation", "navigation"})
    return {name: str(table.get("preset", DEFAULT_PRESET)) for name, table in tables.items()}


def stack_fault(file: FileTable) -> str | None:
    """What is wrong in its tables, in words without an end; None if nothing is."""
    try:
        stack_of(file)
    except AcrcError as error:
        return str(error)
    return None


SHORTEST_S: Final = 0.001
"""Least interval in [deeco], s."""
MOST_HOPS: Final = 15
"""Largest hop_limit in [deeco]."""
WEAKEST_DBM: Final = -90
"""Least relay_below in [deeco]: transceivers tell nothing weaker apart (`actors.radio.frame`)."""
MOST_ITEMS: Final = 1000
"""Of a list in [strategy]."""
_AS_IT_IS: Final = ExchangeSettings()


def _is_scalar(value: object) -> bool:
    """What TOML can hold and what has one value: no date, no table, no infinity."""
    match value:
        case bool() | str():
            return True
        case int():
            return -(2**63) <= value < 2**63
        case float():
            return math.isfinite(value)
    return False


def _is_setting(value: object) -> bool:
    if isinstance(value, list | tuple):
        return len(value) <= MOST_ITEMS and all(_is_scalar(item) for item in value)
    return _is_scalar(value)


def _setting(value: object) -> object:
    if not _is_setting(value):
        raise ValueError
    return tuple(value) if isinstance(value, list) else value


def _first_wrong(settings: object) -> object:
    """Of a million values that are wrong the first is enough."""
    if isinstance(settings, dict):
        for name, value in settings.items():
            if not _is_setting(value):
                return {name: value}
    return settings


Interval = Annotated[
    float,
    Field(ge=SHORTEST_S, le=LONGEST_S),
    Right(f"a number of seconds from {SHORTEST_S} to {LONGEST_S}"),
]
Settings = Annotated[
    Mapping[str, Annotated[Setting, PlainValidator(_setting)]],
    BeforeValidator(_first_wrong),
    Right(
        "a table [strategy] with the strategy's settings; its name stands in run.strategy",
        item=f"true, false, a whole number of 64 bits, a finite number, a text, or a list of at most"
        f" {MOST_ITEMS} of these",
    ),
]


class DeecoTable(FileTable):
    """[deeco]: how the nodes of the component model exchange knowledge by radio.

    What is absent is as `ExchangeSettings` has it.
    """

    publish: Interval = in_seconds(_AS_IT_IS.publish)
    """How often each robot publishes its knowledge, s (d3scomp/JDEECo, DefaultKnowledgePublisher)."""
    relay: bool = _AS_IT_IS.relay
    """Robots pass on what they hear; off in the original testbed."""
    hop_limit: Annotated[int, Field(ge=1, le=MOST_HOPS)] = _AS_IT_IS.hop_limit
    """How often knowledge is passed on at most."""
    relay_delay: Annotated[
        float, Field(ge=0, le=LONGEST_S), Right(f"a number of seconds from 0 to {LONGEST_S}")
    ] = in_seconds(_AS_IT_IS.relay_delay)
    """The longest wait before knowledge is passed on, that for the strongest signal, s."""
    relay_below: Annotated[
        float,
        Field(ge=WEAKEST_DBM, le=EVERYBODY_DBM),
        Right(f"a number of dBm from {WEAKEST_DBM} to {EVERYBODY_DBM:g}"),
    ] = _AS_IT_IS.relay_below_dbm
    """Who hears knowledge more strongly does not pass it on, dBm; at 0 everybody does."""
    forget: Interval = in_seconds(_AS_IT_IS.forget)
    """Replicas of robots that were not heard of for so long are dropped, s."""

    @property
    def settings(self) -> ExchangeSettings:
        """The same with its durations in µs."""
        return ExchangeSettings(
            publish=seconds(self.publish),
            relay=self.relay,
            hop_limit=self.hop_limit,
            relay_delay=seconds(self.relay_delay),
            relay_below_dbm=self.relay_below,
            forget=seconds(self.forget),
        )


class AreaTable(FileTable):
    """[[area]]: a rectangle of the floor that has a name."""

    name: Annotated[Text, Right('a name such as "hall"')]
    x: Span
    """From the west edge to the east edge, m."""
    y: Span
    """From the south edge to the north edge, m."""

    @property
    def area(self) -> Area:
        """The rectangle."""
        (x0, x1), (y0, y1) = self.x, self.y
        return Area(self.name, x0, y0, x1, y1)


def adaptation(settings: Settings, exchange: DeecoTable, areas: Iterable[AreaTable]) -> Adaptation:
    """What every robot is told of these tables."""
    return Adaptation(dict(settings), exchange.settings, tuple(table.area for table in areas))
