"""What a user of the component model can do wrong, each told in one sentence."""


class DeecoError(Exception):
    """Base of all errors that say, in one sentence, what is wrong and what would have been right."""


class DefinitionError(DeecoError):
    """A role, component, process or ensemble that makes no sense; raised where it is defined."""


class DeploymentError(DeecoError):
    """Something that a node cannot run as it is; raised before its first step."""


class ExecutionError(DeecoError):
    """A process or an exchange that broke the rules while the node ran."""
