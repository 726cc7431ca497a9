"""The DEECo component model: knowledge, processes and ensembles, as values and functions without I/O."""

from deeco.component import adaptation, component, on_change, periodic, role
from deeco.encoding import Resolution
from deeco.ensemble import Contact, EndReason, ensemble
from deeco.errors import DeecoError, DefinitionError, DeploymentError, ExecutionError
from deeco.history import History, Past
from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds
from deeco.knowledge import Knowledge, replace

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
    "History",
    "Instant",
    "Knowledge",
    "Past",
    "Resolution",
    "adaptation",
    "component",
    "ensemble",
    "in_seconds",
    "milliseconds",
    "on_change",
    "periodic",
    "replace",
    "role",
    "seconds",
]
