"""What the system lets one robot's process have: memory, files, disk, processes (setrlimit(2))."""

import resource
from typing import Annotated, Final

import msgspec

from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import failure

_MB: Final = 1_000_000
_STACK: Final = 64 * 1024 * 1024
"""What the first thread's stack may grow to, B; own choice, eight times what most systems give."""

Amount = Annotated[int, msgspec.Meta(ge=1, lt=10**9)]


class LimitError(AcrcError):
    """A limit that is none."""


class ProcessLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How much one robot's process may have; own choices, far above what a strategy needs."""

    memory_mb: Amount = 4096
    """Its data, MB (RLIMIT_DATA); what it asks for beyond is a MemoryError in the strategy's line. A robot
    itself has about 300. All its processes together are looked at twice a second."""
    open_files: Amount = 256
    """Open files (RLIMIT_NOFILE)."""
    file_mb: Amount = 16_384
    """Each file that it writes, its log and its recording among them, MB (RLIMIT_FSIZE)."""
    disk_mb: Amount = 32_768
    """All files in its folder together, MB; looked at twice a second. One that it has deleted and keeps open
    is not counted, nor what an open robot writes elsewhere."""
    disk_files: Amount = 100_000
    """Files and folders there."""
    processes: Amount = 64
    """Processes and threads (RLIMIT_NPROC, which is none for root; looked at twice a second); isolated robots
    only, for else the system counts all of the user's."""


def limits(words: tuple[str, ...]) -> ProcessLimits:
    """The limits with these set, each as `name=number`. Raises LimitError."""
    known = ProcessLimits.__struct_fields__
    found = ProcessLimits()
    for word in words:
        name, _, number = word.partition("=")
        if (
            name not in known
            or not number.isascii()
            or not number.isdigit()
            or not 0 < int(number[:10]) < 10**9
        ):
            raise LimitError(
                f'--limit: {word}; must be one of {", ".join(known)}, "=" and a number from 1 to 999999999'
            )
        found = msgspec.structs.replace(found, **{name: int(number[:10])})
    return found


def enforce(chosen: ProcessLimits, *, isolated: bool) -> None:
    """Hold this process, and what it starts, to the limits from now on."""
    _lower(resource.RLIMIT_DATA, chosen.memory_mb * _MB)
    _lower(resource.RLIMIT_NOFILE, chosen.open_files)
    _lower(resource.RLIMIT_FSIZE, chosen.file_mb * _MB)
    failure.keep_room_in_files()
    _lower(resource.RLIMIT_CORE, 0)
    _lower(resource.RLIMIT_STACK, _STACK)  # it is not among the data
    if isolated and hasattr(resource, "RLIMIT_NPROC"):
        _lower(resource.RLIMIT_NPROC, chosen.processes)


def _lower(kind: int, most: int) -> None:
    """New threads' stacks are as large as the soft limit of the stack, so that one stays where it is less."""
    soft, hard = resource.getrlimit(kind)
    allowed = most if hard == resource.RLIM_INFINITY else min(most, hard)
    keeps = kind == resource.RLIMIT_STACK and soft != resource.RLIM_INFINITY
    resource.setrlimit(kind, (min(soft, allowed) if keeps else allowed, allowed))
