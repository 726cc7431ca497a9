"""A process's log: its standard output and error, in a new file."""

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from actors.runtime.lifecycle.linux import reserve

RESERVE: Final = 8192
"""Bytes that a log has on the disk behind its end: once that is full, why a process ends still finds room."""


def create_log(path: Path) -> int:
    """A descriptor of a new file to append to; FileExistsError where anything lies there, a link too."""
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_APPEND, 0o644)
    keep_room(log)
    return log


def keep_room(log: int) -> None:
    """Have room for so many bytes more again, as lines have used it up; a full disk leaves what there is."""
    if sys.platform == "linux":
        with suppress(OSError):  # also a file system that cannot, or no file at all
            reserve(log, os.fstat(log).st_size + RESERVE)


def write_to(log: int) -> None:
    """Send this process's standard output and error to an open log, from the system's level on."""
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
