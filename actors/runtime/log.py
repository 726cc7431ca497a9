"""A process's log: its standard output and error, in a file."""

import os
import sys
from pathlib import Path


def open_log(path: Path) -> None:
    """Send this process's standard output and error to a file, from the operating system's level on."""
    stream = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    sys.stdout.flush()
    sys.stderr.flush()
    os.dup2(stream, 1)
    os.dup2(stream, 2)
    os.close(stream)
