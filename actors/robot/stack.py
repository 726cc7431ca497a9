"""How a robot localises and navigates, as a scenario, a fleet and its own navigation.toml say it.

    [localisation]
    preset = "robust"      # "chapter" if nothing is said, "robust", or "odometry": none at all
    max_particles = 1000   # any field of AmclParameters

    [navigation]
    preset = "chapter"     # or "robust": for this table, [planner], [local_map] and [dwa]

Beside the presets, any field of the parameters may be set; durations in s.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar, cast, get_type_hints

from pydantic import AfterValidator, Field, create_model

from actors import table_wording
from actors.bounds import ParameterError
from actors.instant import Duration, seconds
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.navigation.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PlanningParameters
from actors.runtime.errors import AcrcError
from actors.table import Right, Table

BYTES_LIMIT: Final = 100_000
"""Size of the file; a hundred times what it needs."""
LONGEST_S: Final = 1_000_000
"""Longest duration, s."""
ODOMETRY: Final = "odometry"
"""The preset of [localisation] that trusts the odometry alone."""
_P = TypeVar("_P")


class StackError(AcrcError):
    """Tables of localisation and navigation that make no sense."""


@dataclass(frozen=True)
class Stack:
    """All parameters of a robot's localisation and navigation."""

    localisation: AmclParameters | None = PRESETS["chapter"]
    """None: no localisation, the odometry is trusted."""
    navigation: NavigationParameters = NAVIGATION_PRESETS["chapter"]
    planner: PlanningParameters = field(default_factory=PlanningParameters)
    local_map: CostMapParameters = LOCAL_MAP_PRESETS["chapter"]
    dwa: DwaParameters = DWA_PRESETS["chapter"]


_Seconds = Annotated[
    float,
    Field(ge=0, le=LONGEST_S),
    AfterValidator(seconds),
    Right(f"a number of seconds from 0 to {LONGEST_S}"),
]

_Whole = Annotated[int, Field(ge=-(2**63), lt=2**63), Right("a whole number of 64 bits")]
_KINDS: Final[Mapping[Any, Any]] = {Duration: _Seconds, int: _Whole}
"""How the file has a field of that type; others as they are."""


def _table(kind: type[Any], presets: tuple[str, ...] = ()) -> type[Table]:
    """The table of a kind of parameters: any of their fields, and a preset if there are some."""
    hints = get_type_hints(kind)
    keys: dict[str, Any] = {
        one.name: (_KINDS.get(hints[one.name], hints[one.name]), None) for one in fields(kind)
    }
    if presets:
        keys["preset"] = (Literal[presets], "chapter")
    return create_model(f"{kind.__name__}Table", __base__=Table, **keys)


_TABLES: Final[Mapping[str, type[Table]]] = {
    "localisation": _table(AmclParameters, (*PRESETS, ODOMETRY)),
    "navigation": _table(NavigationParameters, tuple(NAVIGATION_PRESETS)),
    "planner": _table(PlanningParameters),
    "local_map": _table(CostMapParameters),
    "dwa": _table(DwaParameters),
}
TABLES: Final = tuple(_TABLES)
_FILE_KEYS: Final[Mapping[str, Any]] = {name: (table, table()) for name, table in _TABLES.items()}
_NavigationFile: Final = create_model("_NavigationFile", __base__=Table, **_FILE_KEYS)


def load_stack(path: Path) -> Stack:
    """What stands in a robot's navigation.toml. Raises StackError."""
    file = table_wording.load(path, _NavigationFile, "navigation", StackError, BYTES_LIMIT)
    try:
        return _stack(file)
    except StackError as error:
        raise StackError(f"{path}: {error}") from None


def parse(text: str) -> Stack:
    """What the text of a navigation.toml says. Raises StackError."""
    return _stack(table_wording.parse(text, _NavigationFile, StackError))


def stack(tables: Mapping[str, Mapping[str, object]]) -> Stack:
    """What the tables say; those that are absent are as the preset `chapter` has them. Raises StackError."""
    return _stack(table_wording.checked(tables, _NavigationFile, StackError))


def _stack(file: Any) -> Stack:
    """What a _NavigationFile says, of whose fields mypy does not know."""
    preset = file.navigation.preset
    try:
        return Stack(
            localisation=_localisation(file.localisation),
            navigation=_with(NAVIGATION_PRESETS[preset], file.navigation),
            planner=_with(PlanningParameters(), file.planner),
            local_map=_with(LOCAL_MAP_PRESETS[preset], file.local_map),
            dwa=_with(DWA_PRESETS[preset], file.dwa),
        )
    except ParameterError as error:
        raise StackError(str(error)) from None


def _localisation(table: Any) -> AmclParameters | None:
    if table.preset != ODOMETRY:
        return _with(PRESETS[table.preset], table)
    for name in table.model_dump(exclude_unset=True, exclude={"preset"}):
        raise StackError(
            f'localisation.{name} is set, but must be left out where the preset is "{ODOMETRY}", '
            "which has no parameters"
        )
    return None


def _with(preset: _P, table: Table) -> _P:
    """The parameters of a preset with what the table sets. Raises ParameterError."""
    return cast(_P, replace(cast(Any, preset), **table.model_dump(exclude_unset=True, exclude={"preset"})))
