"""Translation of error messages from command-line options to library arguments."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from actors.installation.usage import missing_extra_named
from actors.runtime.errors import AcrcError

_ARGUMENTS: Final = (
    (r"--bus (zenoh|memory)", r'bus="\1"'),
    (r"--set ([\w-]+\.[\w.-]+)", r'settings["\1"]'),
    (r"--modules (?:'([^']*)'|([./][^\s,;]*|DIR))", r'modules=["\1\2"]'),
    (r"--trust", "trust=True"),
    (r"--set\b", "settings"),
    (r"--(out|robots|seed|duration|strategy|navigation|bus|modules)\b", r"\1"),
    (r"(?<!acrc run )--([a-z])", r"acrc run --\1"),
)
"""Patterns of options and the arguments that replace them; the last: options without an argument."""


@contextmanager
def arguments_named() -> Iterator[None]:
    """Rewrite errors raised inside: arguments in place of options; name the extra of a missing package."""
    try:
        with missing_extra_named():
            yield
    except AcrcError as error:
        sentence = str(error)
        for option, argument in _ARGUMENTS:
            sentence = re.sub(option, argument, sentence)
        error.args = (sentence,)
        raise
