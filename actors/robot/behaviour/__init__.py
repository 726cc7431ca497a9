"""The seam to the user's code: what a behaviour may know and do, and how it is found and hosted.

Strategies need these names of a robot, and no others; docs/tutorial.md and docs/deeco.md show them at work.
"""

from actors.floor.door import Door
from actors.robot.behaviour.equipment import FloorPlan, Navigation, PlaceMonitor, Positioning, TaskList
from actors.robot.behaviour.node_host import host
from actors.robot.behaviour.plan import AbortReason, Goal, GoalOrder, GoalPhase, GoalStatus, Plan
from actors.robot.behaviour.ports import (
    FARTHEST_BACK,
    Behaviour,
    Decision,
    ExchangeSettings,
    Setting,
    Start,
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
