"""How a robot localises and navigates, as a scenario, a fleet and its own navigation.toml say it.

    [localisation]
    preset = "robust"      # "chapter" if nothing is said, "robust", or "odometry": none at all
    max_particles = 1000   # any field of AmclParameters

    [navigation]
    preset = "chapter"     # or "robust": for this table, [planner], [local_map] and [dwa]

Beside the presets, any field of the parameters may be set; durations in s.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final, Literal, TypeVar, cast, get_args, get_origin, get_type_hints

from actors import toml_file
from actors.instant import Duration, seconds
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.navigation.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PlanningParameters
from actors.runtime.errors import AcrcError
from actors.wording import shown, unknown_key

BYTES_LIMIT: Final = 100_000
"""Size of the file; a hundred times what it needs."""
LONGEST_S: Final = 1_000_000
"""Longest duration, s."""
ODOMETRY: Final = "odometry"
"""The preset of [localisation] that trusts the odometry alone."""
TABLES: Final = ("localisation", "navigation", "planner", "local_map", "dwa")
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


def load_stack(path: Path) -> Stack:
    """What stands in a robot's navigation.toml. Raises StackError."""
    text = toml_file.read(path, "navigation", StackError, BYTES_LIMIT)
    try:
        return parse(text)
    except StackError as error:
        raise StackError(f"{path}: {error}") from None


def parse(text: str) -> Stack:
    """What the text of a navigation.toml says. Raises StackError."""
    try:
        content = toml_file.loads(text)
    except ValueError as error:
        raise StackError(f"this is no TOML: {error}") from None
    for name, table in content.items():
        if name not in TABLES:
            raise StackError(unknown_key("", name, TABLES))
        if not isinstance(table, dict):
            raise _wrong(name, table, f"a table [{name}]")
    return stack(content)


def stack(tables: Mapping[str, Mapping[str, object]]) -> Stack:
    """What the tables say; those that are absent are as the preset `chapter` has them. Raises StackError."""
    told = {name: dict(tables.get(name, {})) for name in TABLES}
    localiser = _preset("localisation", told["localisation"], (*PRESETS, ODOMETRY))
    preset = _preset("navigation", told["navigation"], tuple(NAVIGATION_PRESETS))
    return Stack(
        localisation=_localisation(localiser, told["localisation"]),
        navigation=_with("navigation", NAVIGATION_PRESETS[preset], told["navigation"]),
        planner=_with("planner", PlanningParameters(), told["planner"]),
        local_map=_with("local_map", LOCAL_MAP_PRESETS[preset], told["local_map"]),
        dwa=_with("dwa", DWA_PRESETS[preset], told["dwa"]),
    )


def _preset(name: str, table: dict[str, object], known: tuple[str, ...]) -> str:
    """The preset that a table names, taken out of it."""
    preset = table.pop("preset", "chapter")
    if not isinstance(preset, str) or preset not in known:
        raise _wrong(f"{name}.preset", preset, _one_of(known))
    return preset


def _localisation(preset: str, table: Mapping[str, object]) -> AmclParameters | None:
    if preset != ODOMETRY:
        return _with("localisation", PRESETS[preset], table)
    for name in table:
        raise StackError(
            f'localisation.{name} is set, but must be left out where the preset is "{ODOMETRY}", '
            "which has no parameters"
        )
    return None


def _with(table: str, preset: _P, values: Mapping[str, object]) -> _P:
    """The parameters of a preset with other values for some fields."""
    kinds = get_type_hints(type(preset))
    names = [field.name for field in fields(cast(Any, preset))]
    changes = {}
    for name, value in values.items():
        if name not in names:
            raise StackError(unknown_key(table, name, (*names, "preset")))
        changes[name] = _value(f"{table}.{name}", value, kinds[name])
    try:
        return cast(_P, replace(cast(Any, preset), **changes))
    except AcrcError as error:
        raise StackError(str(error)) from None


def _value(key: str, value: object, kind: Any) -> object:
    """The value as the field has it."""
    if get_origin(kind) is Literal:
        if value in get_args(kind):
            return value
        raise _wrong(key, value, _one_of(get_args(kind)))
    if kind is bool:
        if isinstance(value, bool):
            return value
        raise _wrong(key, value, "true or false")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise _wrong(key, value, "a whole number" if kind is int else "a finite number")
    if kind is Duration:
        if 0 <= value <= LONGEST_S:
            return seconds(value)
        raise _wrong(key, value, f"a number of seconds from 0 to {LONGEST_S}")
    if kind is int:
        if isinstance(value, int):
            return value
        raise _wrong(key, value, "a whole number")
    return float(value)


def _one_of(known: tuple[str, ...]) -> str:
    *first, last = (f'"{name}"' for name in known)
    return f"{', '.join(first)} or {last}" if first else last


def _wrong(key: str, value: object, right: str) -> StackError:
    return StackError(f"{key} is {shown(value)}, but must be {right}")
