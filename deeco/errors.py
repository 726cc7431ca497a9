"""Errors of the component model."""


class DeecoError(Exception):
    """Base class of all errors; the message names the fault and the remedy."""


class DefinitionError(DeecoError):
    """Invalid role, component, process or ensemble; raised where it is defined."""


class DeploymentError(DeecoError):
    """Component, ensemble or parameter that a node cannot run; raised before its first step."""


class ExecutionError(DeecoError):
    """Invalid result of a process or an exchange, or an exceeded limit, while a node runs."""
