"""The errors that a person sees as one sentence; every other exception is a bug and shows its traceback."""

import re
from typing import Final

_CONTROLS: Final = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""What a terminal obeys or chokes on: control characters but tab and newline, what turns the direction of
writing, and halves of characters."""


class AcrcError(Exception):
    """What is wrong, where, with which value, and what would have been right: one sentence.

    As text it can be shown: a name or a reason in it may come from anywhere.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


def printable(text: str) -> str:
    """The text for a terminal: what that would obey instead of showing it stands there escaped."""
    return _CONTROLS.sub(lambda found: ascii(found.group())[1:-1], text)
