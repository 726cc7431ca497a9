"""The DEECo component model: knowledge, processes and ensembles, as values and functions without I/O."""

from deeco.component import adaptation, component, on_change, periodic, role
from deeco.encoding import Resolution
from deeco.ensemble import Contact, EndReason, ensemble
from deeco.errors import DeecoError, DefinitionError, DeploymentError, ExecutionError
from deeco.group_protocol import GroupCoordinator, GroupMember
from deeco.groups import all_of, group, one_of, some_of
from deeco.history import History, Past
from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds
from deeco.knowledge import Knowledge, replace
from deeco.modes import ModeChart, Transition

__version__ = "0.1.0"

__all__ = [
    "START",
    "Contact",
    "DeecoError",
    "DefinitionError",
    "DeploymentError",
    "Duration",
    "EndReason",
    "ExecutionError",
    "GroupCoordinator",
    "GroupMember",
    "History",
    "Instant",
    "Knowledge",
    "ModeChart",
    "Past",
    "Resolution",
    "Transition",
    "adaptation",
    "all_of",
    "component",
    "ensemble",
    "group",
    "in_seconds",
    "milliseconds",
    "on_change",
    "one_of",
    "periodic",
    "replace",
    "role",
    "seconds",
    "some_of",
]
