"""What the code in an actor prints or logs, line by line with simulated time and step, in bounded amount.

It has no part in messages, recordings and digests. What is written past Python's own streams, as by
`os.write(1, …)`, keeps its way.
"""

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, TextIO, TypeVar

MOST: Final = 4 * 1024 * 1024
"""Characters that one process may print; own choice: more than anybody reads, and little on a disk."""
LONGEST: Final = 4096
"""Characters of a line; a longer one goes on in the next."""


T = TypeVar("T")
R = TypeVar("R")
_Standing = tuple[TextIO, TextIO, "Prints | None"]
"""Standard output, standard error, and whose turn it is."""


class Prints:
    """Of one process of a robot. Nothing is written before something is printed."""

    def __init__(
        self,
        step_us: int,
        write: Callable[[str], object],
        flush: Callable[[], object] = lambda: None,
        shut: Callable[[], object] = lambda: None,
    ) -> None:
        """`write` is given what is to be shown, piece by piece; `flush` follows a step that printed, and
        `shut` the last one."""
        self._step_us = step_us
        self._write, self._flush, self._shut = write, flush, shut
        self._step = 0
        self._before: list[_Standing] = []
        """Whose turn it was before, and what stood there: one for each context that has not ended."""
        self._column = 0
        """Characters of the line so far; 0: the next one begins a line."""
        self._kept = 0
        self._lost = self._lost_lines = 0
        self._dirty = False

    def during(self, step: int) -> "Prints":
        """What this process prints within it, as a context, belongs to this step of this actor."""
        self._step = step
        return self

    def of(self, step: int, work: Callable[[T], R], given: T) -> R:
        """What `work(given)` gives; what it prints belongs to this step of this actor.

        The same as within `during`, in fewer calls where the desks stand already, as in `taken_by`.
        """
        if sys.stdout is not _OUT or sys.stderr is not _ERR:
            with self.during(step):
                return work(given)
        before, self._step, _turn.prints = _turn.prints, step, self
        try:
            return work(given)
        finally:
            sys.stdout, sys.stderr, _turn.prints = _OUT, _ERR, before
            if self._dirty:
                self._dirty = False
                self._flush()

    def __enter__(self) -> None:
        self._before.append(_taken(self))

    def __exit__(self, *raised: object) -> None:
        sys.stdout, sys.stderr, _turn.prints = self._before.pop()
        if self._dirty:
            self._dirty = False
            self._flush()

    def take(self, text: str) -> None:
        """Something that was printed: any part of a line, or several."""
        *lines, rest = text.split("\n")
        for piece in [*(f"{line}\n" for line in lines), rest]:
            for start in range(0, len(piece), LONGEST):
                self._take(piece[start : start + LONGEST])

    def close(self) -> None:
        """Say how much was not kept, if anything was not; the last call."""
        if self._lost:
            self._write(
                f"{self._lost_lines} more lines, {self._lost} characters, were printed and not kept\n"
            )
            self._flush()

    def _stamp(self) -> str:
        return f"{self._step * self._step_us / 1e6:10.3f} s  step {self._step}  "

    def _take(self, piece: str) -> None:
        if self._kept >= MOST:
            self._lost += len(piece)
            self._lost_lines += piece.endswith("\n")
            return
        self._dirty = True
        if self._column + len(piece) > LONGEST:
            self._write("\n")
            self._column = 0
        self._write(piece if self._column else self._stamp() + piece)
        self._column = 0 if piece.endswith("\n") else self._column + len(piece)
        self._kept += len(piece)
        if self._kept >= MOST:
            end = "\n" if self._column else ""
            self._write(f"{end}{self._stamp()}too much: nothing more is kept\n")
            self._column = 0


def in_file(path: Path, step_us: int) -> Prints:
    """Prints in a new file, which is made once there is something to write."""
    file: list[io.TextIOWrapper] = []

    def opened() -> io.TextIOWrapper:
        if not file:
            number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644)
            file.append(
                io.TextIOWrapper(os.fdopen(number, "wb"), encoding="utf-8", errors="backslashreplace")
            )
        return file[0]

    def shut() -> None:
        for one in file:
            one.close()

    return Prints(step_us, lambda text: opened().write(text), lambda: opened().flush(), shut)


def on(stream: TextIO, step_us: int) -> Prints:
    """Prints on a stream that is there; what a full disk does not take is lost."""

    def write(text: str) -> None:
        with suppress(OSError):
            stream.write(text)

    def flush() -> None:
        with suppress(OSError):
            stream.flush()

    return Prints(step_us, write, flush)


def nowhere() -> Prints:
    """Prints that nobody wants to see."""
    return Prints(1, lambda text: None)


class _Desk(io.TextIOBase):
    """Stands where standard output or error was; logging keeps hold of it, whoever's turn it then is."""

    def __init__(self) -> None:
        self.behind: Any = None
        """What stood there."""

    @property
    def buffer(self) -> Any:
        """Of what stood there: bytes keep their way."""
        return self.behind.buffer

    def fileno(self) -> int:
        """Of what stood there."""
        number: int = self.behind.fileno()
        return number

    def writable(self) -> bool:
        """It is."""
        return True

    def write(self, text: str) -> int:
        """To whoever's turn it is, and else to what stood there."""
        if _turn.prints is None:
            self.behind.write(text)
        else:
            _turn.prints.take(text)
        return len(text)

    def flush(self) -> None:
        """Flush the stream behind, unless an actor prints; when Python exits, both may be gone already."""
        if _turn and _turn.prints is None and self.behind is not None and not self.behind.closed:
            self.behind.flush()


class _Turn:
    """Whose turn it is in this process."""

    prints: Prints | None = None


_turn: Final = _Turn()
_OUT, _ERR = _Desk(), _Desk()


def _taken(prints: Prints | None) -> _Standing:
    """From now on what is printed goes to `prints`; what was there before."""
    before = sys.stdout, sys.stderr, _turn.prints
    if sys.stdout is not _OUT:
        _OUT.behind = sys.stdout
    if sys.stderr is not _ERR:
        _ERR.behind = sys.stderr
    sys.stdout, sys.stderr, _turn.prints = _OUT, _ERR, prints
    return before


@contextmanager
def taken_by(prints: Prints | None) -> Iterator[None]:
    """What is printed meanwhile goes to `prints`; None: its way.

    Who keeps hold of standard error meanwhile, as logging does, keeps hold of whoever's turn it is then.
    """
    before = _taken(prints)
    try:
        yield
    finally:
        sys.stdout, sys.stderr, _turn.prints = before
