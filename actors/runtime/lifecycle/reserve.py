"""What it takes to tell of an end: held before a user's code runs, let go by whoever tells.

A strategy may have taken all memory, descriptors or room on the disk, and the process that names it has no
more than that strategy has left. A process has one reserve.
"""

import mmap
import os
import resource
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Final

_MEMORY: Final = 16 * 1024 * 1024
"""Bytes; own choice: many times what a failure note and the traceback in the log take. It is address space
until it is used."""
_DISK: Final = 64 * 1024
"""Bytes; own choice: the last records of a recording, and the traceback in the log."""
_DESCRIPTORS: Final = 8
_MAP_NORESERVE: Final = 0x4000
"""mmap(2); makes the kernel keep it apart from what lies beside it, so that all of it comes free at once."""


class _Held:
    """The memory, and how each other part is let go."""

    memory: mmap.mmap | None = None
    others: Final[list[Callable[[], object]]] = []


_held: Final = _Held()


def hold(folder: Path) -> int:
    """Hold a reserve, the disk's in `folder`, unless this process does already.

    The descriptor that stands for the room on disk, for a process that closes all others; -1: there is none.
    What the system does not give is left out.
    """
    if _held.memory is not None:
        return -1
    with suppress(OSError):
        _held.memory = mmap.mmap(-1, _MEMORY, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _MAP_NORESERVE)
    for _ in range(_DESCRIPTORS):
        with suppress(OSError):
            _held.others.append(partial(os.close, os.open(os.devnull, os.O_RDONLY)))
    room = -1
    with suppress(OSError), tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        os.posix_fallocate(file.fileno(), 0, _DISK)
        room = os.dup(file.fileno())
        _held.others.append(partial(os.ftruncate, room, 0))  # what was forked from this process has it, too
    return room


def keep_room_in_files() -> None:
    """Hold back a little of what a file of this process may have, if that is limited."""
    most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    if most != resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_FSIZE, (max(most - _DISK, 0), most))
        _held.others.append(partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most)))


def release() -> None:
    """Let go what is held, if anything; the memory first, for which nothing must be allocated."""
    if _held.memory is not None:
        _held.memory.close()
        _held.memory = None
    while _held.others:
        with suppress(OSError, ValueError):  # a strategy may have closed it, or lowered the limit
            _held.others.pop()()
