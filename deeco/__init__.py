"""The DEECo component model: knowledge, processes and ensembles, as values and functions without I/O."""

from deeco.component import component, role
from deeco.ensemble import Contact, ensemble
from deeco.errors import DeecoError, DefinitionError, DeploymentError, ExecutionError
from deeco.instant import START, Duration, Instant, in_seconds, milliseconds, seconds
from deeco.knowledge import Knowledge
from deeco.process import adaptation, on_change, periodic
from deeco.replacing import replace
from deeco.replication.scalars import Resolution

__all__ = [
    "START",
    "Contact",
    "DeecoError",
    "DefinitionError",
    "DeploymentError",
    "Duration",
    "ExecutionError",
    "Instant",
    "Knowledge",
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
