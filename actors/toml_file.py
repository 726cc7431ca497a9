"""TOML that a person has written, or somebody else: read within bounds, every failure one sentence."""

import codecs
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from actors.runtime import regular_file
from actors.runtime.errors import AcrcError

LARGEST_FILE: Final = 1_000_000
"""Bytes; a scenario of 1000 robots with 10 places each needs half of that."""
MOST_PARTS: Final = 32
"""Of a dotted key; time grows with their square, and no file of this project has more than three."""
MOST_BITS: Final = 1023
"""Of a whole number; a longer one is none as a float, and from 14 000 bits on Python cannot even show it."""
_TOKENS: Final = re.compile(
    r'(?P<skipped>"{3}(?:[^"\\]|\\.|"(?!""))*"{0,3}|\'{3}(?:[^\']|\'(?!\'\'))*\'{0,3}|#[^\n]*)'
    r"|(?P<part>[A-Za-z0-9_-]+|\"(?:[^\"\\\n]|\\.)*\"|'[^'\n]*')|(?P<dot>\.)|(?P<blank>[ \t]+)|(?P<other>.)",
    re.DOTALL,
)


def read(path: Path, kind: str, most: int = LARGEST_FILE) -> str:
    """Return the text of a file of that kind, such as "scenario", without a byte order mark.

    `most`: bytes that it may have. Raises AcrcError.
    """
    try:
        with regular_file.opened(path) as file:
            content = file.read(most + 1)
        if len(content) > most:
            raise AcrcError(f"{path}: the {kind} file may have at most {most} bytes, but has more")
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
            raise AcrcError(f"{path}: the {kind} file is UTF-16; save it as UTF-8")
        return content.decode("utf-8-sig")
    except OSError as error:
        raise AcrcError(f"{path}: the {kind} file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise AcrcError(f"{path}: byte {error.start} of the {kind} file is not UTF-8") from None


def tables(text: str, path: Path) -> dict[str, Any]:
    """What the text of the file `path` says. Raises AcrcError."""
    try:
        return loads(text)
    except ValueError as error:
        raise AcrcError(f"{path}: this is no TOML: {error}") from None


def loads(text: str) -> dict[str, Any]:
    """What a text says, in time that grows with its length alone. Raises ValueError.

    Refused beside what is no TOML: whole numbers beyond any float, and keys of more than MOST_PARTS
    parts.
    """
    _check_keys(text)
    try:
        content = tomllib.loads(text)
    except RecursionError as error:
        raise ValueError(str(error)) from None
    if any(isinstance(value, int) and value.bit_length() > MOST_BITS for value in _values(content)):
        raise ValueError(f"a whole number in it has more than {MOST_BITS} bits")
    return content


def _check_keys(text: str) -> None:
    parts = dots = 0
    for token in _TOKENS.finditer(text):
        match token.lastgroup:
            case "dot":
                dots += 1
            case "part" if dots == parts:
                parts += 1
                if parts > MOST_PARTS:
                    line = text.count("\n", 0, token.start()) + 1
                    raise ValueError(f"line {line} has a key of more than {MOST_PARTS} parts")
            case "part":
                parts, dots = 1, 0
            case "blank":
                pass
            case _:
                parts = dots = 0


def _values(content: object) -> Iterator[object]:
    """Every value, however deep."""
    todo = [content]
    while todo:
        value = todo.pop()
        if isinstance(value, dict):
            todo.extend(value.values())
        elif isinstance(value, list):
            todo.extend(value)
        else:
            yield value
