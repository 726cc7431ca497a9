"""The end of a process's log, which a robot may have filled with anything and with gigabytes."""

import os
from pathlib import Path
from typing import Final

from rich.console import Console

from actors.processes.launch import Program
from actors.runtime import regular_file
from actors.runtime.errors import printable

_TAIL: Final = 8192
"""Bytes in which the last line is looked for."""
_SHOWN: Final = 20_000
"""Bytes of what a program has said that are shown, its end."""


def last_line(path: Path) -> str:
    """The last line that is not empty, or as much of it as is read, for a terminal; "" if there is none."""
    try:
        with regular_file.opened(path) as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _TAIL))
            lines = log.read(_TAIL).decode("utf-8", "replace").split("\n")
    except OSError:
        return ""
    return printable(next((line.strip() for line in reversed(lines) if line.strip()), ""))


def said(program: Program, limit: int = _SHOWN) -> str:
    """The end of what a process wrote to its log, without what would steer a terminal."""
    if not program.log.is_file():
        return ""
    with program.log.open("rb") as log:
        log.seek(max(0, program.log.stat().st_size - limit))
        told = printable(log.read(limit).decode(errors="replace"))
    return program.in_our_words(told)


def show(told: str) -> None:
    """Show on standard error what a process said, if it said anything."""
    if told.strip():
        Console(stderr=True, soft_wrap=True).print(told.rstrip("\n"), markup=False, highlight=False)
