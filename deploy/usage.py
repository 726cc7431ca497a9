"""What is wrong with a command, before anything has run."""

from actors.runtime.errors import AcrcError


class OptionError(AcrcError):
    """An option of the command line that makes no sense."""
