"""Printed and logged output of the code in an actor: by line, with simulated time and step, bounded.

It has no part in messages, recordings and digests. What is written past Python's own streams, as by
`os.write(1, …)`, is not captured.
"""

import io
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TextIO, TypeVar

MOST: Final = 4 * 1024 * 1024
"""Characters that one process may print; own choice."""
LONGEST: Final = 4096
"""Characters of a line; a longer one continues in the next."""

T = TypeVar("T")
R = TypeVar("R")


class Prints:
    """The output of one process of a robot."""

    def __init__(
        self, step_us: int, write: Callable[[str], object], flush: Callable[[], object] = lambda: None
    ) -> None:
        """`write` is given the text piece by piece; `flush` follows a step that printed."""
        self._step_us, self._write, self._flush = step_us, write, flush
        self._step = 0
        self._column = 0
        """Characters of the line so far; 0: the next one begins a line."""
        self._kept = self._lost = self._lost_lines = 0
        self._dirty = False

    def during(self, step: int) -> AbstractContextManager[None]:
        """Return a context: what this process prints within it belongs to this step of this actor."""
        self._step = step
        return taken_by(self)

    def of(self, step: int, work: Callable[[T], R], given: T) -> R:
        """Return `work(given)`; what it prints belongs to this step of this actor.

        The same as within `during`, in fewer calls where `taken_by` has replaced the streams already.
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
                self.flush()

    def take(self, text: str) -> None:
        """Keep printed text: any part of a line, or several."""
        *lines, rest = text.split("\n")
        for piece in [*(f"{line}\n" for line in lines), rest]:
            for start in range(0, len(piece), LONGEST):
                self._take(piece[start : start + LONGEST])

    def flush(self) -> None:
        """Flush what was printed since the last flush, if anything was."""
        if self._dirty:
            self._dirty = False
            self._flush()

    def close(self) -> None:
        """Report how much was not kept, if anything was not; the last call."""
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
    """Return Prints in a new file, which is made at the first write."""

    @cache
    def file() -> TextIO:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644)
        return io.TextIOWrapper(os.fdopen(number, "wb"), encoding="utf-8", errors="backslashreplace")

    return Prints(step_us, lambda text: file().write(text), lambda: file().flush())


def on(stream: TextIO, step_us: int) -> Prints:
    """Return Prints on an open stream; what a full disk does not take is lost."""

    def write(text: str) -> None:
        with suppress(OSError):
            stream.write(text)

    def flush() -> None:
        with suppress(OSError):
            stream.flush()

    return Prints(step_us, write, flush)


def nowhere() -> Prints:
    """Return Prints that discard everything."""
    return Prints(1, lambda text: None)


class _Replacement(io.TextIOBase):
    """Replaces standard output or error; logging keeps hold of it, whichever actor then prints."""

    behind: Any = None
    """The replaced stream. Bytes are written to it directly."""

    @property
    def buffer(self) -> Any:
        return self.behind.buffer

    def fileno(self) -> int:
        number: int = self.behind.fileno()
        return number

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
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
    prints: Prints | None = None
    """The actor that prints now; None: no actor, so text goes to the replaced streams."""


_turn: Final = _Turn()
_OUT, _ERR = _Replacement(), _Replacement()


@contextmanager
def taken_by(prints: Prints | None) -> Iterator[None]:
    """Give what is printed within the context to `prints`; None: to the replaced streams."""
    before = sys.stdout, sys.stderr, _turn.prints
    for stands, replacement in ((sys.stdout, _OUT), (sys.stderr, _ERR)):
        if stands is not replacement:
            replacement.behind = stands
    sys.stdout, sys.stderr, _turn.prints = _OUT, _ERR, prints
    try:
        yield
    finally:
        sys.stdout, sys.stderr, _turn.prints = before
        if prints is not None:
            prints.flush()
