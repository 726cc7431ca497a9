"""The logs of robots' processes, which hold what their code has printed; also while they grow."""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
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


class LogError(AcrcError):
    """A robot that a run has not, or a log that cannot be read."""


def logs(out: Path, robot: str) -> list[Path]:
    """The logs of a robot's processes, in the order of their starts; none where nothing was printed."""
    found = [
        path for path in (out / robot).glob(f"{robot}*.log") if _START.fullmatch(path.name[len(robot) :])
    ]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def robots(out: Path) -> list[str]:
    """Those whose processes have begun in a run's folder."""
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
        """What has been printed since the last call, for a terminal; a line that is not whole yet waits."""
        for robot in robots(self._out) if EVERYBODY in self._names else self._names:
            for path in logs(self._out, robot):
                yield from ((robot, line) for line in self._new(path))

    def close(self) -> Iterator[tuple[str, str]]:
        """The lines that never came to their end; the last call."""
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
                raise LogError(f"{path}: cannot be read: {error.strerror}") from None
        while piece := self._open[path].read(1 << 16):
            *lines, self._rest[path] = (self._rest[path] + piece).split(b"\n")
            for line in lines:
                yield printable(line.decode("utf-8", "replace"))


@contextmanager
def shown(out: Path, names: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Gives what is to be called now and then, and shows on standard error what robots have printed since.

    With the robot's name in front if there may be several.
    """
    tail, several = LogTail(out, names), EVERYBODY in names or len(names) > 1

    def look(lines: Iterable[tuple[str, str]] | None = None) -> None:
        for robot, line in tail.poll() if lines is None else lines:
            sys.stderr.write(f"{robot}  {line}\n" if several else f"{line}\n")

    try:
        yield look if names else lambda: None
    finally:
        look(tail.close() if names else ())


def check_names(names: Sequence[str], known: Sequence[str], where: str) -> None:
    """Raises LogError for a robot that is not there."""
    for name in names:
        if name not in known and name != EVERYBODY:
            raise LogError(f"{where}: no robot {name!r}; there are {', '.join(known)}, and '*' for all")


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
