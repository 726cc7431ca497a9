"""A TOML file that a person has written: read within bounds, every failure one sentence."""

import tomllib
from pathlib import Path
from typing import Any, Final

from actors.runtime.errors import AcrcError

LARGEST_FILE: Final = 1_000_000
"""Bytes; a scenario of 1000 robots with 10 places each needs half of that."""


def read(path: Path, kind: str, fault: type[AcrcError]) -> str:
    """The text of a file of that kind, such as "scenario". Raises `fault`."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        if len(content) > LARGEST_FILE:
            raise fault(f"{path}: a {kind} file may have at most {LARGEST_FILE} bytes, but this has more")
        return content.decode("utf-8")
    except OSError as error:
        raise fault(f"{path}: the {kind} file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise fault(f"{path}: byte {error.start} of the {kind} file is not UTF-8") from None


def tables(text: str, path: Path, fault: type[AcrcError]) -> dict[str, Any]:
    """What the text of the file `path` says. Raises `fault`."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError, and whole numbers of 4301 digits
        raise fault(f"{path}: this is no TOML: {error}") from None
