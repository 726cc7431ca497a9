"""Output printed or logged by an actor's code: captured by line, with simulated time and step, limited.

It is not part of messages, recordings or digests. Output that bypasses Python's streams, as by
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

MAX_CHARACTERS: Final = 4 * 1024 * 1024
"""Most characters printed per process; own choice."""
MAX_LINE: Final = 4096
"""Most characters per line; longer lines are split."""

T = TypeVar("T")
R = TypeVar("R")


class CapturedOutput:
    """Captured output of one robot's process."""

    def __init__(
        self, step_us: int, write: Callable[[str], object], flush: Callable[[], object] = lambda: None
    ) -> None:
        """`write` gets the text in pieces; `flush` is called after each step with output."""
        self._step_us, self._write, self._flush = step_us, write, flush
        self._step = 0
        self._column = 0
        """Characters in the current line; 0: at the start of a line."""
        self._written = self._discarded = self._discarded_lines = 0
        self._dirty = False

    def during(self, step: int) -> AbstractContextManager[None]:
        """Return a context in which output of this process belongs to this step of this actor."""
        self._step = step
        return captured_by(self)

    def call(self, step: int, function: Callable[[T], R], argument: T) -> R:
        """Return `function(argument)`, capturing its output as output of this step.

        Equivalent to `during`, with fewer calls if `captured_by` has replaced the streams already.
        """
        if sys.stdout is not _OUT or sys.stderr is not _ERR:
            with self.during(step):
                return function(argument)
        before, self._step, _current.prints = _current.prints, step, self
        try:
            return function(argument)
        finally:
            sys.stdout, sys.stderr, _current.prints = _OUT, _ERR, before
            if self._dirty:
                self.flush()

    def take(self, text: str) -> None:
        """Capture printed text: a part of a line, or several lines."""
        *lines, rest = text.split("\n")
        for piece in [*(f"{line}\n" for line in lines), rest]:
            for start in range(0, len(piece), MAX_LINE):
                self._write_piece(piece[start : start + MAX_LINE])

    def flush(self) -> None:
        """Flush output since the last flush, if there was any."""
        if self._dirty:
            self._dirty = False
            self._flush()

    def close(self) -> None:
        """Report discarded output, if there was any; the last call."""
        if self._discarded:
            self._write(
                f"{self._discarded_lines} more lines with {self._discarded} characters were discarded\n"
            )
            self._flush()

    def _prefix(self) -> str:
        return f"{self._step * self._step_us / 1e6:10.3f} s  step {self._step}  "

    def _write_piece(self, piece: str) -> None:
        if self._written >= MAX_CHARACTERS:
            self._discarded += len(piece)
            self._discarded_lines += piece.endswith("\n")
            return
        self._dirty = True
        if self._column + len(piece) > MAX_LINE:
            self._write("\n")
            self._column = 0
        self._write(piece if self._column else self._prefix() + piece)
        self._column = 0 if piece.endswith("\n") else self._column + len(piece)
        self._written += len(piece)
        if self._written >= MAX_CHARACTERS:
            end = "\n" if self._column else ""
            self._write(f"{end}{self._prefix()}output limit reached; further output is discarded\n")
            self._column = 0


def output_to_file(path: Path, step_us: int) -> CapturedOutput:
    """Return CapturedOutput in a file that is created at the first write."""

    @cache
    def file() -> TextIO:
        number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o644)
        return io.TextIOWrapper(os.fdopen(number, "wb"), encoding="utf-8", errors="backslashreplace")

    return CapturedOutput(step_us, lambda text: file().write(text), lambda: file().flush())


def output_to_stream(stream: TextIO, step_us: int) -> CapturedOutput:
    """Return CapturedOutput on an open stream; output is lost if the disk is full."""

    def write(text: str) -> None:
        with suppress(OSError):
            stream.write(text)

    def flush() -> None:
        with suppress(OSError):
            stream.flush()

    return CapturedOutput(step_us, write, flush)


def discarded_output() -> CapturedOutput:
    """Return CapturedOutput that discards all output."""
    return CapturedOutput(1, lambda text: None)


class _Replacement(io.TextIOBase):
    """Replacement of standard output or error, shared by all actors: logging keeps a reference to it."""

    replaced: Any = None
    """The replaced stream; receives bytes directly."""

    @property
    def buffer(self) -> Any:
        return self.replaced.buffer

    def fileno(self) -> int:
        number: int = self.replaced.fileno()
        return number

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        if _current.prints is None:
            self.replaced.write(text)
        else:
            _current.prints.take(text)
        return len(text)

    def flush(self) -> None:
        """Flush the replaced stream, unless an actor prints; at interpreter exit, both may be gone."""
        if _current and _current.prints is None and self.replaced is not None and not self.replaced.closed:
            self.replaced.flush()


class _CurrentActor:
    prints: CapturedOutput | None = None
    """Output of the current actor; None: no actor, text goes to the replaced streams."""


_current: Final = _CurrentActor()
_OUT, _ERR = _Replacement(), _Replacement()


@contextmanager
def captured_by(prints: CapturedOutput | None) -> Iterator[None]:
    """Capture output within the context in `prints`; None: pass it to the replaced streams."""
    before = sys.stdout, sys.stderr, _current.prints
    for stream, replacement in ((sys.stdout, _OUT), (sys.stderr, _ERR)):
        if stream is not replacement:
            replacement.replaced = stream
    sys.stdout, sys.stderr, _current.prints = _OUT, _ERR, prints
    try:
        yield
    finally:
        sys.stdout, sys.stderr, _current.prints = before
        if prints is not None:
            prints.flush()
