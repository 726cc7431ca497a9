"""Interface between a robot and a strategy; strategies import from here only.

Examples: docs/tutorial.md and docs/deeco.md.
"""

from actors.geometry import Door
from actors.robot.behaviour.adversary import SilentBehaviour
from actors.robot.behaviour.node_host import host
from actors.robot.behaviour.ports import (
    MAX_BACK_OUT,
    AbortReason,
    BatteryMeter,
    Behaviour,
    Decision,
    ExchangeSettings,
    FloorPlan,
    Goal,
    GoalOrder,
    GoalPhase,
    GoalStatus,
    Navigation,
    Plan,
    Positioning,
    Setting,
    Start,
    TaskList,
    TaskMonitor,
    View,
)
from actors.robot.behaviour.strategy_settings import SettingsError, from_settings

__all__ = [
    "MAX_BACK_OUT",
    "AbortReason",
    "BatteryMeter",
    "Behaviour",
    "Decision",
    "Door",
    "ExchangeSettings",
    "FloorPlan",
    "Goal",
    "GoalOrder",
    "GoalPhase",
    "GoalStatus",
    "Navigation",
    "Plan",
    "Positioning",
    "Setting",
    "SettingsError",
    "SilentBehaviour",
    "Start",
    "TaskList",
    "TaskMonitor",
    "View",
    "from_settings",
    "host",
]
