"""How a robot localises and navigates: all parameters of it."""

import msgspec

from actors.robot.cost_maps.cost_map import LOCAL_MAP_PRESETS, CostMapParameters
from actors.robot.local_planning.dwa_parameters import DWA_PRESETS, DwaParameters
from actors.robot.localisation import PRESETS, AmclParameters
from actors.robot.navigation.navigator import NAVIGATION_PRESETS, NavigationParameters
from actors.robot.navigation.planning import PLANNER_PRESETS, PlanningParameters


class Stack(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """As the tables of a scenario or of a fleet say it (`deploy.scenario.stack_tables`)."""

    localisation: AmclParameters | None = PRESETS["chapter"]
    """None: no localisation, the odometry is trusted."""
    navigation: NavigationParameters = NAVIGATION_PRESETS["chapter"]
    planner: PlanningParameters = PLANNER_PRESETS["chapter"]
    local_map: CostMapParameters = LOCAL_MAP_PRESETS["chapter"]
    dwa: DwaParameters = DWA_PRESETS["chapter"]
