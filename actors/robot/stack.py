"""Parameters of localisation, navigation and adaptation from the tables of a scenario or fleet file.

    [localisation]
    preset = "robust"      # the default; or "chapter", or "odometry": no localisation
    max_particles = 1000   # any field of AmclParameters

    [navigation]
    preset = "robust"      # the default; or "chapter": for this table, [planner], [local_map] and [dwa]

Every field of the parameters may be set; durations in s.
"""

from collections.abc import Mapping
from typing import Any, Final

import msgspec

from actors import wording
from actors.floor.placement import Area
from actors.robot.behaviour.ports import ExchangeSettings, Setting
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters
from actors.robot.navigation.steering import DWA_PRESETS, DwaParameters
from actors.runtime.errors import AcrcError
from actors.settings import ParameterError, decode

DEFAULT_PRESET: Final = "robust"
"""Default preset of localisation and navigation: the best one."""
ODOMETRY: Final = "odometry"
"""dead reckoning from odometry."""
IMPROVED_REMOVED: Final = (
    '"improved", which was removed; use "robust", or, for the same driving, "chapter" with '
    'navigation.reset_distance = 3.0, planner.method = "grid", planner.factor = 3.0, '
    'local_map.body = "disc", local_map.allowance = 0.0, local_map.padding = 0.045, '
    'local_map.inf_is_valid = true, dwa.rules = "disc" and dwa.granularity = 0.05'
)
"""Error for a file or an option that names the removed navigation preset `improved`."""


class Adaptation(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of the strategy, exchange of knowledge, and areas."""

    settings: dict[str, Setting] = {}
    """Settings of the strategy by name, checked by the strategy (`actors.robot.behaviour.from_settings`)."""
    exchange: ExchangeSettings = ExchangeSettings()
    areas: tuple[Area, ...] = ()
    """Areas that contain places; empty: no restriction."""


class Stack(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of localisation and navigation."""

    localisation: AmclParameters | None = PRESETS[DEFAULT_PRESET]
    """None: odometry alone."""
    navigation: NavigationParameters = NAVIGATION_PRESETS[DEFAULT_PRESET]
    planner: PlanningParameters = PLANNER_PRESETS[DEFAULT_PRESET]
    local_map: CostMapParameters = LOCAL_MAP_PRESETS[DEFAULT_PRESET]
    dwa: DwaParameters = DWA_PRESETS[DEFAULT_PRESET]


_TABLES: Final[Mapping[str, Mapping[str, Any]]] = {
    "localisation": {**PRESETS, ODOMETRY: None},
    "navigation": NAVIGATION_PRESETS,
    "planner": PLANNER_PRESETS,
    "local_map": LOCAL_MAP_PRESETS,
    "dwa": DWA_PRESETS,
}
"""Presets of each table; the preset of [navigation] also selects those of the tables after it."""
TABLES: Final = tuple(_TABLES)


def presets(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, str]:
    """Return the presets of localisation and navigation, by table. Raises AcrcError for an unknown one."""
    found = {}
    for name in ("localisation", "navigation"):
        found[name] = preset = tables.get(name, {}).get("preset", DEFAULT_PRESET)
        if name == "navigation" and preset == "improved":
            raise AcrcError(f"navigation.preset is {IMPROVED_REMOVED}")
        if preset not in list(_TABLES[name]):
            raise ParameterError(f"{name}.preset", preset, wording.one_of(_TABLES[name]))
    return found


def stack(tables: Mapping[str, Mapping[str, Any]]) -> Stack:
    """Return the parameters of the tables; the preset is DEFAULT_PRESET if none is named.

    Raises AcrcError.
    """
    named, found = presets(tables), dict[str, Any]()
    for name, known in _TABLES.items():
        own, others = dict(tables.get(name, {})), ("preset",) if name in named else ()
        base = found[name] = known[named.get(name, named["navigation"])]
        for key in own.keys() - set(others) if base is None else ():
            raise AcrcError(
                f'{name}.{key} is set, but must be absent where the preset is "{ODOMETRY}", '
                "which has no parameters"
            )
        if base is not None:
            found[name] = decode(type(base), own, name, base, others)
    return Stack(**found)
