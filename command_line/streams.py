"""Standard streams as they are found: closed, full, or with a reader that has gone."""

import io
import os
import sys
from typing import Any

from actors.runtime.errors import AcrcError


class StreamError(AcrcError):
    """Standard output that cannot be written."""


def settle() -> None:
    """Make standard output and error such that nobody who listens to neither is a fault.

    A stream that is closed leads nowhere from now on, and so does a pipe once nobody reads it any more.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file to be opened must not get this number, and be written to
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _stream(1, sys.stdout)
    sys.stderr = _stream(2, sys.stderr)


class _Pipe(io.FileIO):
    """A descriptor that drops what it cannot write; that is said once, unless nobody wants to read it."""

    dead = False

    def write(self, data: Any) -> int:
        """As for any file; StreamError."""
        try:
            return len(memoryview(data).cast("B")) if self.dead else super().write(data)
        except BrokenPipeError:
            self.dead = True
            return len(memoryview(data).cast("B"))
        except OSError as error:
            self.dead = True
            if self.fileno() != 1:
                return len(memoryview(data).cast("B"))  # nothing else is left to say it on
            words = (error.strerror or str(error)).lower()
            raise StreamError(f"standard output cannot be written: {words}") from None


def _stream(number: int, present: Any) -> io.TextIOWrapper:
    """The same as `present`, but for who may be gone at its other end."""
    if present is not None:
        present.flush()
    raw = _Pipe(number, "w", closefd=False)
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=getattr(present, "encoding", "utf-8"),
        errors="backslashreplace",
        line_buffering=number == 2 or raw.isatty(),
    )
