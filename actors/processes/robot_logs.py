"""The logs of robots' processes, which hold what their code has printed; also while they grow."""

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final

from actors.runtime import regular_file
from actors.runtime.errors import AcrcError, printable

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
