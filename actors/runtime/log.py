"""A process's log: its standard output and error, in a new file."""

import os
import sys
from pathlib import Path


def create_log(path: Path) -> int:
    """A descriptor of a new file to append to; FileExistsError where anything lies there, a link too."""
    return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_APPEND, 0o644)


def open_log(path: Path) -> None:
    """Send this process's standard output and error to a new file, from the operating system's level on."""
    stream = create_log(path)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(stream, 1)
    os.dup2(stream, 2)
    os.close(stream)
