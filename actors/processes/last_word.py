"""Asks a process that hangs where it stands, and finds the line in its log."""

import re
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from actors.processes.launch import Child
from actors.runtime.lifecycle.failure import own_place

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
