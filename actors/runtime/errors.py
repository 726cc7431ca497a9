"""Errors that are shown as one sentence; any other exception is a bug and shows a traceback."""

import re
from typing import Final

_CONTROLS: Final = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Characters that a terminal obeys or cannot encode: controls except tab and newline, bidirectional controls,
surrogates."""


class AcrcError(Exception):
    """One sentence: what is wrong, where, the value, and how to fix it.

    Its text is safe for terminals, whatever names it contains.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


def printable(text: str) -> str:
    """Return text that is safe for a terminal, with control characters escaped."""
    return _CONTROLS.sub(lambda found: ascii(found.group())[1:-1], text)
