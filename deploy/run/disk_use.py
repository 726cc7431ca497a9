"""What each robot has written to disk, and the sentence for one that has written too much."""

import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, NamedTuple

from actors.runtime.isolation.resource_limits import ProcessLimits
from deploy.processes.launch import Program

_MB: Final = 1_000_000
_BLOCK: Final = 512
"""stat(2) counts in such blocks, bytes."""


class Use(NamedTuple):
    """What lies in a folder."""

    size: int
    """Bytes that it takes on disk: holes in files are not counted."""
    files: int
    """Files, folders and links."""


class DiskWatch:
    """Looks into the robots' folders from time to time."""

    LOOK_S: Final = 0.5
    """Time between two looks; own choice: a fast disk takes a GB in it."""
    SHARE: Final = 20
    """A look may take the n-th part of the time at most: the next one is put off accordingly."""

    def __init__(self, limits: ProcessLimits, clock: Callable[[], float] = time.monotonic) -> None:
        self._limits = limits
        self._clock = clock
        self._next_s = clock() + self.LOOK_S

    def fault(self, programs: Iterable[Program]) -> str | None:
        """A sentence on the first robot that has written too much; None if nobody has, or it is not time."""
        began_s = self._clock()
        if began_s < self._next_s:
            return None
        found = next(
            (fault for one in programs if one.module == "actors.robot" and (fault := self._judge(one))), None
        )
        now_s = self._clock()
        self._next_s = now_s + max(self.LOOK_S, self.SHARE * (now_s - began_s))
        return found

    def _judge(self, program: Program) -> str | None:
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
