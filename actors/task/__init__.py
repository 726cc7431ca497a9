"""Interface of a task; tasks import from here only.

An example: docs/your-problem.md.
"""

from actors.items import ItemGivenUp, ItemKey, TaskReports
from actors.settings import Settings
from actors.task.task import (
    Column,
    Judge,
    JudgeSetup,
    MarkStyle,
    Metric,
    Placing,
    Task,
    TaskDeclaration,
    TaskOutcome,
    TaskProgress,
    TaskWorld,
    Value,
)
from actors.topic import MessagePart

__all__ = [
    "Column",
    "ItemGivenUp",
    "ItemKey",
    "Judge",
    "JudgeSetup",
    "MarkStyle",
    "MessagePart",
    "Metric",
    "Placing",
    "Settings",
    "Task",
    "TaskDeclaration",
    "TaskOutcome",
    "TaskProgress",
    "TaskReports",
    "TaskWorld",
    "Value",
]
