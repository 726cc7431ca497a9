"""`python -m benchmarks.hosts.holder NAME BYTES FOLDER`: holds a host until standard input ends.

The host has a network, a name and mounts of its own, and BYTES of disk at FOLDER; 0: no disk of its own.
FOLDER is empty, and removed at the end. "ready" on standard output says that the host is there. It
ends with standard input, hence with the process that made the host, and kills whoever is on the host then.
"""

import os
import signal
import socket
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from actors.runtime.lifecycle import linux
from actors.runtime.lifecycle.parent import leave_in_order
from benchmarks.hosts.members import TITLE, members, room

_LONGEST_SWEEP_S: Final = 5.0


def main(argv: Sequence[str]) -> int:
    """Hold the host; the exit code."""
    name, size, folder = argv
    try:
        _move_out(name, int(size), folder)
    except OSError as error:
        sys.stderr.write(f"{error.strerror or error}\n")
        return 1
    linux.set_title(f"{TITLE}{name}")
    leave_in_order()
    try:
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        sys.stdin.buffer.read()
    finally:
        left = _sweep()
        with suppress(OSError):  # its maker's task, if that lives; a host's own disk is still on it
            Path(folder).rmdir()
    if left:
        sys.stderr.write(f"still running: {', '.join(map(str, left))}\n")
    return 1 if left else 0


def _move_out(name: str, size: int, folder: str) -> None:
    """Make the namespaces, and go there. Raises OSError where that is forbidden."""
    linux.unshare(linux.CLONE_NEWNET | linux.CLONE_NEWUTS | linux.CLONE_NEWNS)
    socket.sethostname(name)
    linux.mount(None, "/", None, linux.MS_REC | linux.MS_PRIVATE)  # the machine does not see its mounts
    if size:
        linux.mount("none", folder, "tmpfs", linux.MS_NOSUID | linux.MS_NODEV, f"size={size}")


def _sweep() -> list[int]:
    """Kill whoever is on the host, and whom they start meanwhile; who is still there after some seconds."""
    own = room(os.getpid())
    deadline = time.monotonic() + _LONGEST_SWEEP_S
    while own is not None and (there := members(own, os.getpid())):
        if time.monotonic() > deadline:
            return there
        for pid in there:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        time.sleep(0.002)
    return []


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
