"""What each robot has taken of disk and memory, and the sentence for one that has taken too much."""

import math
import os
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from actors.processes.launch import Child, Program
from actors.runtime.isolation.resource_limits import ProcessLimits
from actors.runtime.lifecycle import process_table

_MB: Final = 1_000_000
_BLOCK: Final = 512
"""stat(2) counts in such blocks, bytes."""
_KEEPERS: Final = 2
"""Processes that isolation adds to a robot's own."""


class Use(NamedTuple):
    """What lies in a folder."""

    size: int
    """Bytes that it takes on disk: holes in files are not counted."""
    files: int
    """Files, folders and links."""


class ResourceWatch:
    """Looks from time to time at what the system's own limits do not bound: a robot's folder, and all its
    processes together."""

    LOOK_S: Final = 0.5
    """Time between two looks; own choice: a fast disk takes a GB in it, and so does memory."""
    SHARE: Final = 2
    """The next look is put off by so many times the last one's duration, if that is more: robots that have
    made very many files must not win time by it."""

    def __init__(self, limits: ProcessLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._next_s = clock() + self.LOOK_S

    def fault(self, children: Iterable[Child]) -> str | None:
        """A sentence on the first robot that has taken too much; None if nobody has, or it is not time."""
        began_s = self._clock()
        if began_s < self._next_s:
            return None
        robots = [child for child in children if child.program.module == "actors.robot"]
        known = process_table.table() if robots else {}
        faults = (self._on_disk(child.program) or self._in_memory(child, known) for child in robots)
        found = next((fault for fault in faults if fault), None)
        now_s = self._clock()
        self._next_s = now_s + max(self.LOOK_S, self.SHARE * (now_s - began_s))
        return found

    def _on_disk(self, program: Program) -> str | None:
        folder, limits = program.log.parent, self._limits
        use = used(folder, limits.disk_mb * _MB, limits.disk_files)
        if use.size > limits.disk_mb * _MB:
            return (
                f"{program.actor} has written more than {limits.disk_mb} MB to {folder}; "
                "--limit disk_mb=N allows more"
            )
        if use.files > limits.disk_files:
            return (
                f"{program.actor} has made more than {limits.disk_files} files in {folder}; "
                "--limit disk_files=N allows more"
            )
        return None

    def _in_memory(self, child: Child, known: Mapping[int, process_table.ProcessGlance]) -> str | None:
        """Of the robot's process, its keeper and all that it has started, also what has left the family."""
        robot, limits = child.program.actor, self._limits
        session = {pid for pid, one in known.items() if one.session == child.pid}
        holdings = [
            process_table.held(pid) for pid in process_table.descendants({child.pid, *session}, known)
        ]
        if math.fsum(one.memory for one in holdings) > limits.memory_mb * _MB:
            return (
                f"{robot} has taken more than {limits.memory_mb} MB of memory with all its processes; "
                "--limit memory_mb=N allows more"
            )
        if child.program.names is not None and math.fsum(one.threads for one in holdings) > (
            limits.processes + _KEEPERS
        ):
            return (
                f"{robot} has more than {limits.processes} processes and threads; "
                "--limit processes=N allows more"
            )
        return None


def used(folder: Path, most_size: int, most_files: int) -> Use:
    """What lies below `folder`, links not followed; counted until one of the two is exceeded."""
    size = files = 0
    folders = [str(folder)]
    while folders:
        try:
            with os.scandir(folders.pop()) as entries:
                for entry in entries:
                    files += 1
                    size += _size(entry)
                    if size > most_size or files > most_files:
                        return Use(size, files)
                    if entry.is_dir(follow_symlinks=False):
                        folders.append(entry.path)
        except OSError:  # gone, or closed, since it was listed; the robot may do either
            continue
    return Use(size, files)


def _size(entry: "os.DirEntry[str]") -> int:
    try:
        return entry.stat(follow_symlinks=False).st_blocks * _BLOCK
    except OSError:
        return 0
