"""Asks a process that hangs where it stands, and finds the line in its log."""

import os
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from actors.console import screen
from actors.processes.launch import Child, Program
from actors.runtime import regular_file
from actors.runtime.errors import printable
from actors.runtime.lifecycle.failure import own_place

_LAST_BYTES: Final = 8192
"""Bytes in which the last line is looked for."""
_SHOWN: Final = 20_000
"""Bytes of what a program has said that are shown, its end."""


def last_line(path: Path) -> str:
    """The last line that is not empty, or as much of it as is read, for a terminal; "" if there is none."""
    return next(iter(last_lines(path)), "")


def last_lines(path: Path) -> list[str]:
    """The lines that are not empty in the last 8 KiB, the last one first, for a terminal."""
    try:
        with regular_file.opened(path) as log:
            log.seek(max(0, log.seek(0, os.SEEK_END) - _LAST_BYTES))
            lines = log.read(_LAST_BYTES).decode("utf-8", "replace").split("\n")
    except OSError:
        return []
    return [printable(line.strip()) for line in reversed(lines) if line.strip()]


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
        screen(stderr=True).print(told.rstrip("\n"))


_FRAME: Final = re.compile(r'^  File "(.*)", line (\d+) in (.*)$', re.MULTILINE)
_PATIENCE_S: Final = 1.0
"""How long the answer may take; own choice. A signal handler writes it, out of an endless loop, too."""
_TAIL: Final = 1 << 16


def where_it_stands(child: Child, wait: Callable[[float], None]) -> str:
    """`mine.py:12 (advance)`, the innermost line of the child's own code; empty if it does not answer.

    The child must have called `answer_where`; one that has not ends by the signal. `wait` passes so many
    seconds.
    """
    log = child.program.log
    before = log.stat().st_size if log.is_file() else 0
    child.send(signal.SIGUSR1)
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline:
        wait(0.02)
        if found := _place(log, before):
            return found
    return ""


def where_it_crashed(log: Path) -> str:
    """`mine.py:12 (advance)`: where the process of this log was when it crashed; empty if it does not say."""
    return _place(log, max(0, log.stat().st_size - _TAIL)) if log.is_file() else ""


def _place(log: Path, before: int) -> str:
    if not log.is_file():
        return ""
    with log.open("rb") as stream:
        stream.seek(before)
        return place_in(stream.read(_TAIL).decode(errors="replace"))


def place_in(text: str) -> str:
    """`mine.py:12 (advance)`, of what faulthandler has written; empty if that is not whole."""
    dumped = text.rpartition("(most recent call first):\n")[2]  # the main thread's is the last one
    frames = [(name, int(line), function) for name, line, function in _FRAME.findall(dumped)]
    if not frames:
        return ""
    name, line = own_place([(name, line) for name, line, _ in frames])
    function = next(function for one in frames if one[:2] == (name, line) for function in one[2:])
    return f"{Path(name).name}:{line} ({function})"
