"""A process's log: its standard output and error, in a new file."""

import os
import sys
from pathlib import Path


def create_log(path: Path) -> int:
    """A descriptor of a new file to append to; FileExistsError where anything lies there, a link too."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_APPEND, 0o644)


def write_to(log: int) -> None:
    """Send this process's standard output and error to an open log, from the system's level on."""
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
