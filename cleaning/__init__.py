"""The model problem: autonomous cleaning robots that visit places and block each other.

Strategies that extend it import these names, and those of a shipped strategy that they derive from.
"""

from actors.robot.behaviour import SettingsError, from_settings
from cleaning.adaptive import AdaptiveCleaningRobot
from cleaning.adoption import AdoptedDestinationRemove, DestinationAdoption, MakingWay
from cleaning.cleaner import Cleaner, State
from cleaning.parameters import AdaptationParameters, CleaningParameters, ReleasedParameters, UnblockTarget
from cleaning.place import (
    Assignment,
    Takeover,
    VisitReport,
    assignments,
    assignments_since,
    points,
    visit_report,
)
from cleaning.robot import CleaningRobot

__all__ = [
    "AdaptationParameters",
    "AdaptiveCleaningRobot",
    "AdoptedDestinationRemove",
    "Assignment",
    "Cleaner",
    "CleaningParameters",
    "CleaningRobot",
    "DestinationAdoption",
    "MakingWay",
    "ReleasedParameters",
    "SettingsError",
    "State",
    "Takeover",
    "UnblockTarget",
    "VisitReport",
    "assignments",
    "assignments_since",
    "from_settings",
    "points",
    "visit_report",
]
