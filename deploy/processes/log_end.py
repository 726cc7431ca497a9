"""The end of a process's log, which a robot may have filled with anything and with gigabytes."""

import os
from pathlib import Path
from typing import Final

from actors.runtime import regular_file
from actors.runtime.errors import printable

_TAIL: Final = 8192
"""Bytes in which the last line is looked for."""


def last_line(path: Path) -> str:
    """The last line that is not empty, or as much of it as is read, for a terminal; "" if there is none."""
    try:
        with regular_file.opened(path) as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _TAIL))
            lines = log.read(_TAIL).decode("utf-8", "replace").split("\n")
    except OSError:
        return ""
    return printable(next((line.strip() for line in reversed(lines) if line.strip()), ""))
