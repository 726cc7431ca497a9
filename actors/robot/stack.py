"""Parameters of localisation and navigation of one robot."""

from typing import Final

import msgspec

from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters

DEFAULT_PRESET: Final = "robust"
"""Preset of localisation and of navigation where a file names none: the best one that is shipped."""


class Stack(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As the tables of a scenario or of a fleet say it (`deploy.scenario.stack_tables`)."""

    localisation: AmclParameters | None = PRESETS[DEFAULT_PRESET]
    """None: no localisation, the odometry is trusted."""
    navigation: NavigationParameters = NAVIGATION_PRESETS[DEFAULT_PRESET]
    planner: PlanningParameters = PLANNER_PRESETS[DEFAULT_PRESET]
    local_map: CostMapParameters = LOCAL_MAP_PRESETS[DEFAULT_PRESET]
    dwa: DwaParameters = DWA_PRESETS[DEFAULT_PRESET]
