"""Interface of a task; tasks import from here only.

An example: docs/your-problem.md.
"""

from actors.items import ItemGivenUp, ItemKey, TaskReports
from actors.settings import Settings
from actors.task.task import (
    Column,
    DrawInput,
    Judge,
    JudgeSetup,
    MarkStyle,
    Metric,
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
    "DrawInput",
    "ItemGivenUp",
    "ItemKey",
    "Judge",
    "JudgeSetup",
    "MarkStyle",
    "MessagePart",
    "Metric",
    "Settings",
    "Task",
    "TaskDeclaration",
    "TaskOutcome",
    "TaskProgress",
    "TaskReports",
    "TaskWorld",
    "Value",
]
