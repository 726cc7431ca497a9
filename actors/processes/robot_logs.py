"""Logs of robots' processes, with the output of their code; also while they are written."""

import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from actors.console import create_console
from actors.processes.launcher import ChildProcess, Program
from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable
from actors.runtime.failure import own_line

ALL_ROBOTS: Final = "*"
"""Placeholder for all robots."""
_SUFFIX: Final = re.compile(r"(?:\.[0-9]{1,9})?\.log")


def log_files(out: Path, robot: str) -> list[Path]:
    """Return the logs of a robot's processes in start order; empty if nothing was printed."""
    files = (out / robot).glob(f"{robot}*.log")
    found = [path for path in files if _SUFFIX.fullmatch(path.name[len(robot) :])]
    return sorted(found, key=lambda path: (len(path.name), path.name))


def logged_robots(out: Path) -> list[str]:
    """Return the robots whose processes have started, from a run's folder."""
    files = (path for path in out.glob("*/*") if path.suffix in {".mcap", ".log"})
    robots = {path.parent.name for path in files} - {"world", "radio"}
    return sorted(robots, key=lambda name: (len(name), name))


class LogTail:
    """New lines in logs of robots, with the robot's name."""

    def __init__(self, out: Path, robots: Sequence[str]) -> None:
        """`robots`: robots, or ALL_ROBOTS."""
        self._out, self._robots = out, robots
        self._open: dict[Path, IO[bytes]] = {}
        self._incomplete: dict[Path, bytes] = {}

    def poll(self) -> Iterator[tuple[str, str]]:
        """Yield robot and line for all complete lines since the last call, safe for a terminal."""
        for robot in logged_robots(self._out) if ALL_ROBOTS in self._robots else self._robots:
            for path in log_files(self._out, robot):
                yield from ((robot, line) for line in self._new_lines(path))

    def close(self) -> Iterator[tuple[str, str]]:
        """Yield the rest, including incomplete lines; the last call."""
        yield from self.poll()
        for path, rest in self._incomplete.items():
            if rest:
                yield path.parent.name, printable(rest.decode("utf-8", "replace"))
            self._open[path].close()

    def _new_lines(self, path: Path) -> Iterator[str]:
        if path not in self._open:
            try:
                self._open[path], self._incomplete[path] = regular_file.open_regular(path), b""
            except OSError as error:
                raise AcrcError(f"{path}: cannot be read: {error.strerror}") from None
        while piece := self._open[path].read(1 << 16):
            *lines, self._incomplete[path] = (self._incomplete[path] + piece).split(b"\n")
            for line in lines:
                yield printable(line.decode("utf-8", "replace"))


@contextmanager
def printing_new_lines(out: Path, robots: Sequence[str]) -> Iterator[Callable[[], None]]:
    """Yield a function that prints new output of robots to standard error.

    Lines start with the robot's name if there may be several robots.
    """
    tail, several = LogTail(out, robots), ALL_ROBOTS in robots or len(robots) > 1

    def show_lines(lines: Iterator[tuple[str, str]]) -> None:
        for robot, line in lines:
            sys.stderr.write(f"{robot}  {line}\n" if several else f"{line}\n")

    try:
        yield lambda: show_lines(tail.poll())
    finally:
        show_lines(tail.close())


def check_names(robots: Sequence[str], known: Sequence[str], where: str) -> None:
    """Raise AcrcError for a robot that is not in the run."""
    for name in robots:
        if name not in known and name != ALL_ROBOTS:
            raise AcrcError(f"{where}: no robot {name!r}; there are {', '.join(known)}, and '*' for all")


_LAST_LINES: Final = 8192
"""Bytes searched for last lines."""
_MAX_SHOWN: Final = 20_000
"""Bytes of a program's output to show, from its end."""
_MAX_DUMP: Final = 1 << 16
"""Bytes searched for a stack dump."""


def _tail(log: Path, most: int) -> str:
    """Return the last `most` bytes of a log; empty if it cannot be read."""
    try:
        with regular_file.open_regular(log) as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - most))
            return file.read(most).decode("utf-8", "replace")
    except OSError:
        return ""


def last_line(path: Path) -> str:
    """Return the last line that is not empty, safe for a terminal; "" if there is none."""
    return next(iter(last_lines(path)), "")


def last_lines(path: Path) -> list[str]:
    """Return the non-empty lines of the last 8 KiB, the last one first, safe for a terminal."""
    lines = _tail(path, _LAST_LINES).split("\n")
    return [printable(line.strip()) for line in reversed(lines) if line.strip()]


def program_output(program: Program) -> str:
    """Return the end of a program's output, safe for a terminal."""
    return program.outside_text(printable(_tail(program.log, _MAX_SHOWN)))


def print_output(output: str) -> None:
    """Print a program's output to standard error, if there is any."""
    if output.strip():
        create_console(stderr=True).print(output.rstrip("\n"))


_FRAME: Final = re.compile(r'^  File "(.*)", line (\d+) in (.*)$', re.MULTILINE)
_DUMP_TIMEOUT_S: Final = 1.0
"""Timeout for the dump; own choice. A signal handler writes it, even during an endless loop."""


def current_line(child: ChildProcess, wait: Callable[[float], None]) -> str:
    """Return the innermost line of the child's own code, such as `mine.py:12 (advance)`; "" on timeout.

    The child must have called `enable_stack_dumps`, or the signal kills it. `wait` waits for a number of
    seconds.
    """
    log = child.program.log
    size_before = log.stat().st_size if log.is_file() else 0
    child.send(signal.SIGUSR1)
    deadline = time.monotonic() + _DUMP_TIMEOUT_S
    while time.monotonic() < deadline:
        wait(0.02)
        growth = log.stat().st_size - size_before if log.is_file() else 0
        if growth and (found := line_in_dump(_tail(log, min(growth, _MAX_DUMP)))):
            return found
    return ""


def crash_line(log: Path) -> str:
    """Return the line where the process of this log crashed, such as `mine.py:12 (advance)`; "": unknown."""
    return line_in_dump(_tail(log, _MAX_DUMP))


def line_in_dump(text: str) -> str:
    """Return the innermost own line of a faulthandler dump, as `mine.py:12 (advance)`; "": incomplete."""
    dumped = text.rpartition("(most recent call first):\n")[2]  # the main thread is the last
    frames = [(name, int(line), function) for name, line, function in _FRAME.findall(dumped)]
    if not frames:
        return ""
    name, line = own_line([(name, line) for name, line, _ in frames])
    function = next(function for one in frames if one[:2] == (name, line) for function in one[2:])
    return f"{Path(name).name}:{line} ({function})"
