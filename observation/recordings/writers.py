"""Whether a run is going on, has ended, or has died: told from its files, and from who writes to them."""

import os
import sys
from enum import Enum
from pathlib import Path

from observation.recordings.topics import is_closed
from observation.replay.run_recordings import recordings


class Standing(Enum):
    """How a run stands."""

    ENDED = "ended"
    """World and radio have closed their recordings, or there is a result."""
    GOING_ON = "going on"
    DIED = "died"
    """They have not, and nobody writes to them any more."""


def standing(out: Path) -> Standing:
    """How the run in a folder stands. RecordingError if there is no recording in it.

    On systems other than Linux, and of somebody else's processes, nobody can be seen to write: then a run
    that has not ended is held to go on.
    """
    files = recordings(out)
    conducting = [path for actor, path in files.items() if actor in ("world", "radio")]
    if (out / "run.json").is_file() or not conducting or all(is_closed(path) for path in conducting):
        return Standing.ENDED
    return Standing.GOING_ON if _written(conducting) else Standing.DIED


def so_far(out: Path, end: float) -> str:
    """Until when a run without a result is known, s, and why no further: a title, or the end of one."""
    return f"up to {end:g} s: it is going on" if goes_on(out) else f"cut off after {end:g} s"


def goes_on(out: Path) -> bool:
    """Whether a run of which no result was read goes on, or has gone on until just now: it has one since."""
    return standing(out) is Standing.GOING_ON or (out / "run.json").is_file()


def drawn_until(out: Path, end: float) -> str:
    """What is said while a run without a result is drawn, until a second."""
    how = "is going on" if goes_on(out) else "has died without a result"
    return f"the run {how}: it is drawn as far as it was recorded, up to {end:g} s"


def _written(files: list[Path]) -> bool:
    """True if a process of this user has one of the files open, or that cannot be told."""
    if sys.platform != "linux" or files[0].stat().st_uid != os.getuid():
        return True
    wanted = {(there.st_dev, there.st_ino) for there in (path.stat() for path in files)}
    return any(_has_open(process, wanted) for process in Path("/proc").glob("[0-9]*/fd"))


def _has_open(descriptors: Path, wanted: set[tuple[int, int]]) -> bool:
    if descriptors.parent.name == str(os.getpid()):
        return False  # it reads
    try:
        for link in descriptors.iterdir():
            there = link.stat()
            if (there.st_dev, there.st_ino) in wanted and _writes(descriptors.parent / "fdinfo" / link.name):
                return True
    except OSError:  # it has ended, or is somebody else's
        return False
    return False


def _writes(info: Path) -> bool:
    """By the flags with which the file was opened (proc_pid_fdinfo(5))."""
    flags = next(line for line in info.read_text().splitlines() if line.startswith("flags:"))
    return bool(int(flags.split()[1], 8) & os.O_ACCMODE)
