"""Logs of robots' processes, which hold what their code prints; also while they grow."""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from actors.console import screen
from actors.processes.launch import Child, Program
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import own_place

EVERYBODY: Final = "*"
"""In place of a robot's name."""
_START: Final = re.compile(r"(?:\.[0-9]{1,9})?\.log")


def logs(out: Path, robot: str) -> list[Path]:
    """Return the logs of a robot's processes in the order of their starts; none where nothing was printed."""
    files = (out / robot).glob(f"{robot}*.log")
    found = [path for path in files if _START.fullmatch(path.name[len(robot) :])]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def robots(out: Path) -> list[str]:
    """Return the robots whose processes have begun in a run's folder."""
    files = (path for path in out.glob("*/*") if path.suffix in {".mcap", ".log"})
    names = {path.parent.name for path in files} - {"world", "radio"}
    return sorted(names, key=lambda name: (len(name), name))


class LogTail:
    """New lines of some robots' logs, each after its robot."""

    def __init__(self, out: Path, names: Sequence[str]) -> None:
        """`names`: robots, or EVERYBODY."""
        self._out, self._names = out, names
        self._open: dict[Path, IO[bytes]] = {}
        self._rest: dict[Path, bytes] = {}

    def poll(self) -> Iterator[tuple[str, str]]:
        """Yield what has been printed since the last call, for a terminal; an incomplete line waits."""
        for robot in robots(self._out) if EVERYBODY in self._names else self._names:
            for path in logs(self._out, robot):
                yield from ((robot, line) for line in self._new(path))

    def close(self) -> Iterator[tuple[str, str]]:
        """Yield the rest, with incomplete lines; the last call."""
        yield from self.poll()
        for path, rest in self._rest.items():
            if rest:
                yield path.parent.name, printable(rest.decode("utf-8", "replace"))
            self._open[path].close()

    def _new(self, path: Path) -> Iterator[str]:
        if path not in self._open:
            try:
                self._open[path], self._rest[path] = regular_file.opened(path), b""
            except OSError as error:
                raise AcrcError(f"{path}: cannot be read: {error.strerror}") from None
        while piece := self._open[path].read(1 << 16):
            *lines, self._rest[path] = (self._rest[path] + piece).split(b"\n")
            for line in lines:
                yield printable(line.decode("utf-8", "replace"))


@contextmanager
def shown(out: Path, names: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Yield a function that shows on standard error what robots have printed since its last call.

    With the robot's name in front if there may be several.
    """
    tail, several = LogTail(out, names), EVERYBODY in names or len(names) > 1

    def show_lines(lines: Iterator[tuple[str, str]]) -> None:
        for robot, line in lines:
            sys.stderr.write(f"{robot}  {line}\n" if several else f"{line}\n")

    try:
        yield lambda: show_lines(tail.poll())
    finally:
        show_lines(tail.close())


def check_names(names: Sequence[str], known: Sequence[str], where: str) -> None:
    """Raise AcrcError for a robot that is not in the run."""
    for name in names:
        if name not in known and name != EVERYBODY:
            raise AcrcError(f"{where}: no robot {name!r}; there are {', '.join(known)}, and '*' for all")


_LAST_LINES: Final = 8192
"""Bytes in which last lines are looked for."""
_SHOWN: Final = 20_000
"""Bytes of a program's output that are shown, its end."""
_DUMP: Final = 1 << 16
"""Bytes in which a dump of the stack is looked for."""


def _end(log: Path, most: int) -> str:
    """Return the last `most` bytes of a log; empty if it cannot be read."""
    try:
        with regular_file.opened(log) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - most))
            return file.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def last_line(path: Path) -> str:
    """Return the last line that is not empty, for a terminal; "" if there is none."""
    return next(iter(last_lines(path)), "")


def last_lines(path: Path) -> list[str]:
    """Return the lines that are not empty in the last 8 KiB, the last one first, for a terminal."""
    lines = _end(path, _LAST_LINES).split("\n")
    return [printable(line.strip()) for line in reversed(lines) if line.strip()]


def said(program: Program) -> str:
    """Return the end of a program's output, for a terminal."""
    return program.in_our_words(printable(_end(program.log, _SHOWN)))


def show(told: str) -> None:
    """Show a program's output on standard error, if there is any."""
    if told.strip():
        screen(stderr=True).print(told.rstrip("\n"))


_FRAME: Final = re.compile(r'^  File "(.*)", line (\d+) in (.*)$', re.MULTILINE)
_PATIENCE_S: Final = 1.0
"""Limit of the answer; own choice. A signal handler writes it, even during an endless loop."""


def where_it_stands(child: Child, wait: Callable[[float], None]) -> str:
    """Return `mine.py:12 (advance)`, the innermost line of the child's own code; empty without an answer.

    The child must have called `answer_where`; otherwise the signal ends it. `wait` passes so many seconds.
    """
    log = child.program.log
    before = log.stat().st_size if log.is_file() else 0
    child.send(signal.SIGUSR1)
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline:
        wait(0.02)
        grown = log.stat().st_size - before if log.is_file() else 0
        if grown and (found := place_in(_end(log, min(grown, _DUMP)))):
            return found
    return ""


def where_it_crashed(log: Path) -> str:
    """Return `mine.py:12 (advance)`, where the process of this log crashed; empty if the log does not say."""
    return place_in(_end(log, _DUMP))


def place_in(text: str) -> str:
    """Return `mine.py:12 (advance)` from a dump of faulthandler's; empty if it is incomplete."""
    dumped = text.rpartition("(most recent call first):\n")[2]  # the main thread's is the last one
    frames = [(name, int(line), function) for name, line, function in _FRAME.findall(dumped)]
    if not frames:
        return ""
    name, line = own_place([(name, line) for name, line, _ in frames])
    function = next(function for one in frames if one[:2] == (name, line) for function in one[2:])
    return f"{Path(name).name}:{line} ({function})"
