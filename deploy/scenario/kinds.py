"""Which kind of file a TOML file is: a scenario says where robots drive, a study what is compared there."""

import difflib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from actors import toml_file
from actors.runtime.errors import AcrcError


def is_scenario(path: Path) -> bool:
    """True if a file is a scenario; of one that cannot be read nobody knows."""
    try:
        content = toml_file.tables(toml_file.read(path, "scenario"), path)
    except AcrcError:
        return False
    return "map" in content and not says_study(content)


def says_study(content: Mapping[str, Any]) -> bool:
    """True if a file with this content is a study: it must have both keys, and a scenario has neither."""
    return "strategies" in content and "scenario" in content


def check_there(path: Path, folder: Path) -> None:
    """Raise AcrcError with the file of `folder`, of those that are shipped, that one who typed this may mean.

    Not where the file exists, and not where none is called like it.
    """
    if path.exists():
        return
    shipped = {file.stem: file for file in sorted(folder.glob("*.toml"))}
    for near in difflib.get_close_matches(path.stem, shipped, n=1):
        raise AcrcError(f"{path}: there is no such file; did you mean {os.path.relpath(shipped[near])}?")
