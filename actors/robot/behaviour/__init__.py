"""The seam to the user's code: what a behaviour may know and do, and how it is found and hosted.

Strategies need these names of a robot, and no others; docs/tutorial.md and docs/deeco.md show them at work.
"""

from actors.geometry import Door
from actors.robot.behaviour.node_host import host
from actors.robot.behaviour.ports import (
    FARTHEST_BACK,
    AbortReason,
    Behaviour,
    Decision,
    ExchangeSettings,
    FloorPlan,
    Goal,
    GoalOrder,
    GoalPhase,
    GoalStatus,
    Navigation,
    PlaceMonitor,
    Plan,
    Positioning,
    Setting,
    Start,
    TaskList,
    View,
)

__all__ = [
    "FARTHEST_BACK",
    "AbortReason",
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
    "PlaceMonitor",
    "Plan",
    "Positioning",
    "Setting",
    "Start",
    "TaskList",
    "View",
    "host",
]
