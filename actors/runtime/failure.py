"""Failures of processes: their cause as text, and the resources reserved for reporting them."""

import mmap
import os
import resource
import sysconfig
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from itertools import takewhile
from pathlib import Path
from types import FrameType, TracebackType
from typing import Final

import msgspec

from actors.runtime.errors import AcrcError, printable

_MEMORY: Final = 16 * 1024 * 1024
"""Bytes; own choice: many times the size of a failure note and a traceback. Only address space until used."""
_DISK: Final = 64 * 1024
"""Bytes; own choice: for the last records of a recording and the traceback in the log."""
_DESCRIPTORS: Final = 8
_MAP_NORESERVE: Final = 0x4000
"""mmap(2); keeps the mapping separate from its neighbours, so that all of it is freed at once."""


class _Reserve:
    """Reserved memory, and the functions that release everything else."""

    memory: mmap.mmap | None = None
    others: Final[list[Callable[[], object]]] = []


_reserve: Final = _Reserve()


def hold_reserve(folder: Path) -> None:
    """Reserve memory, descriptors and, in `folder`, disk space, unless this process has a reserve.

    Resources that the system refuses are skipped.
    """
    if _reserve.memory is not None:
        return
    with suppress(OSError):
        _reserve.memory = mmap.mmap(-1, _MEMORY, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _MAP_NORESERVE)
    for _ in range(_DESCRIPTORS):
        with suppress(OSError):
            _reserve.others.append(partial(os.close, os.open(os.devnull, os.O_RDONLY)))
    with suppress(OSError), tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        os.posix_fallocate(file.fileno(), 0, _DISK)
        room = os.dup(file.fileno())
        _reserve.others.extend((partial(os.close, room), partial(os.ftruncate, room, 0)))  # a fork has it


def reserve_file_size() -> None:
    """Keep back a little of the process's file size limit, if there is one."""
    most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    if most != resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_FSIZE, (max(most - _DISK, 0), most))
        _reserve.others.append(partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most)))


def release_reserve() -> None:
    """Release the reserve, if any: first the memory, which takes no allocation."""
    if _reserve.memory is not None:
        _reserve.memory.close()
        _reserve.memory = None
    while _reserve.others:
        with suppress(OSError, ValueError):  # closed, or the limit lowered, by a strategy
            _reserve.others.pop()()


_LIBRARIES: Final = tuple(
    f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Folders of library code: neither the user's nor this project's."""
_FRAMEWORK: Final = tuple(
    f"{Path(__file__).resolve().parents[3] / name}/" for name in ("acrc_testbed", "actors", "deeco", "deploy")
)
_MAX_FRAMES: Final = 20
"""Most frames shown below a failure."""
_MAX_TRACE: Final = 1200
"""Most frames of a traceback; Python's recursion limit is 1000."""


class StepTimeout(BaseException):  # not an Exception, which a strategy may catch
    """An actor exceeded its timeout; the text names it and its current line."""


class HardExit(SystemExit):
    """A call of `os._exit` where it would have ended the whole run."""


class FailureNote(msgspec.Struct, frozen=True):
    """Last record of a failed process: step and cause."""

    actor: str
    step: int
    cause: str
    expected: bool
    """True for an AcrcError, whose text is sufficient; False for a bug with a traceback in the log."""


def failure_note(actor: str, step: int, error: BaseException) -> FailureNote:
    """Return the failure as a note; releases the process's reserve."""
    release_reserve()
    if isinstance(error, AcrcError | StepTimeout):
        return FailureNote(actor, step, printable(str(error)), expected=True)
    # handlers of a MemoryError may run out of memory, too: the first error is the cause
    memory_errors = [error, *takewhile(lambda one: isinstance(one, MemoryError), _error_chain(error))]
    place = next(filter(None, map(_raising_line, reversed(memory_errors))), "")  # "" without memory
    cause = f"{_error_text(error)}{place}{'; return replace(self, …)' * ('FrozenInst' in repr(error))}"
    return FailureNote(actor, step, printable(cause), expected=False)


def print_traceback(error: BaseException) -> None:
    """Print a bug's traceback, as far as standard error accepts it; of a deep recursion only the end."""
    with suppress(MemoryError, OSError):
        for one in _error_chain(error):
            one.__traceback__ = _last_frames(one.__traceback__)
        traceback.print_exception(error)


def own_frames(error: BaseException) -> str:
    """Return the traceback lines in the user's code or a shipped strategy."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if _is_own((frame.filename, 0)) and not frame.filename.startswith(_FRAMEWORK)
    ]
    return printable("".join(traceback.format_list(frames[-_MAX_FRAMES:])))


def failure_sentence(note: FailureNote) -> str:
    """Return the note as one sentence."""
    where = "" if note.cause.startswith("step ") else f"{note.actor} failed in step {note.step}: "
    return f"{where}{note.cause}"


def current_line(frame: FrameType | None) -> str:
    """Return a thread's current line outside libraries, such as `mine.py:12 (advance)`."""
    frames = [(at.f_code.co_filename, line, at.f_code.co_name) for at, line in traceback.walk_stack(frame)]
    own = own_line([(name, line) for name, line, _ in frames])
    function = next((each[2] for each in frames if each[:2] == own), "")
    return f"{Path(own[0]).name}:{own[1]} ({function})"


def own_line(frames: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """Return the innermost file name and line outside libraries."""
    return next(filter(_is_own, frames), frames[0] if frames else ("nowhere", 0))


def _is_own(frame: tuple[str, int]) -> bool:
    return not frame[0].startswith((*_LIBRARIES, "<"))


def _raising_line(error: BaseException) -> str:
    """Return the innermost line outside libraries, such as ` (mine.py:12)`; "" if unknown."""
    frames: Iterable[tuple[str, int]] = (
        (frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)
    )
    if isinstance(error, HardExit):
        frames = [*frames][:-1]  # the last frame is the replacement of os._exit
    last = own = ("", 0)
    for last in frames:
        own = last if _is_own(last) else own
    name, line = own if own[0] else last
    return f" ({Path(name).name}:{line})" if name else ""


def _error_chain(error: BaseException) -> Iterator[BaseException]:
    """Yield the error, its cause or context, and so on."""
    seen: set[int] = set()
    current: BaseException | None = error
    while current is not None and id(current) not in seen:
        seen.add(id(current))
        yield current
        current = current.__cause__ or current.__context__


def _last_frames(trace: TracebackType | None) -> TracebackType | None:
    length, at = 0, trace
    while at is not None:
        length, at = length + 1, at.tb_next
    for _ in range(length - _MAX_TRACE):
        trace = trace and trace.tb_next
    return trace


def _error_text(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        function = "os._exit" if isinstance(error, HardExit) else "sys.exit"
        return f"its code called {function}({error.code!r})"
    try:
        text = str(error)
    except Exception:  # a user's exception whose __str__ fails
        text = "(its text cannot be shown)"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
