"""The tables of a scenario and of a fleet that choose localisation and navigation.

    [localisation]
    preset = "robust"      # the default; or "chapter", or "odometry": no localisation
    max_particles = 1000   # any field of AmclParameters

    [navigation]
    preset = "robust"      # the default; or "chapter": for this table, [planner], [local_map] and [dwa]

Beside the presets, any field of the parameters may be set; durations in s.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Annotated, Any, Final, Literal, TypeVar, cast, get_type_hints

from pydantic import AfterValidator, Field, create_model

from actors import table_wording
from actors.bounds import ParameterError
from actors.instant import Duration, seconds
from actors.robot.behaviour.ports import LONGEST_S
from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.stack import DEFAULT_PRESET, Stack
from actors.runtime.errors import AcrcError
from actors.table import FileTable, Right

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
