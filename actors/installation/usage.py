"""What is wrong with a command, before anything has run."""

import shlex
from pathlib import Path

from actors.installation.repository import REPOSITORY
from actors.runtime.errors import AcrcError

_LONGEST = 60
"""Characters of a value that a sentence shows."""


def command() -> str:
    """How the command line is called from where the user stands, in words for a shell."""
    script = REPOSITORY / "acrc"
    if not script.is_file():
        return "acrc"  # an installed package has it on the PATH
    return "./acrc" if script.parent == Path.cwd() else shlex.quote(str(script))


class OptionError(AcrcError):
    """An option of the command line that makes no sense.

    The sentence is of one form for all: what is wrong, with which value; what would be right.
    """


def wrong_value(option: str, value: object, right: str) -> OptionError:
    """The error that `option` has this value; `right` goes on after "must be"."""
    text = str(value)
    if len(text) > _LONGEST:
        text = f"{text[:_LONGEST]}…"
    return OptionError(f"{option}: {shlex.quote(text)}; must be {right}")
