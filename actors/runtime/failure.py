"""Failures of processes: the reserve with which they report one, and the cause in words."""

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
"""Bytes; own choice: many times what a failure note and the traceback in the log take. It is address space
until it is used."""
_DISK: Final = 64 * 1024
"""Bytes; own choice: the last records of a recording, and the traceback in the log."""
_DESCRIPTORS: Final = 8
_MAP_NORESERVE: Final = 0x4000
"""mmap(2); makes the kernel keep it apart from what lies beside it, so that all of it comes free at once."""


class _Held:
    """The reserve: memory, and how each other part is released."""

    memory: mmap.mmap | None = None
    others: Final[list[Callable[[], object]]] = []


_held: Final = _Held()


def hold(folder: Path) -> None:
    """Hold a reserve of memory, descriptors and, in `folder`, disk, unless this process does already.

    What the system does not give is left out.
    """
    if _held.memory is not None:
        return
    with suppress(OSError):
        _held.memory = mmap.mmap(-1, _MEMORY, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | _MAP_NORESERVE)
    for _ in range(_DESCRIPTORS):
        with suppress(OSError):
            _held.others.append(partial(os.close, os.open(os.devnull, os.O_RDONLY)))
    with suppress(OSError), tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        os.posix_fallocate(file.fileno(), 0, _DISK)
        room = os.dup(file.fileno())
        _held.others.extend((partial(os.close, room), partial(os.ftruncate, room, 0)))  # a fork has it


def keep_room_in_files() -> None:
    """Hold back a little of the size limit of this process's files, if there is one."""
    most = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    if most != resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_FSIZE, (max(most - _DISK, 0), most))
        _held.others.append(partial(resource.setrlimit, resource.RLIMIT_FSIZE, (most, most)))


def release() -> None:
    """Release the reserve, if there is one; the memory first, for which nothing must be allocated."""
    if _held.memory is not None:
        _held.memory.close()
        _held.memory = None
    while _held.others:
        with suppress(OSError, ValueError):  # a strategy may have closed it, or lowered the limit
            _held.others.pop()()


_LIBRARIES: Final = tuple(
    f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Where code lies that is neither the user's nor this project's."""
_FRAMEWORK: Final = tuple(
    f"{Path(__file__).resolve().parents[3] / name}/" for name in ("acrc_testbed", "actors", "deeco", "deploy")
)
_MOST_SHOWN: Final = 20
"""Frames below the sentence of a failure."""
_LONGEST_TRACE: Final = 1200
"""Frames of a traceback that are shown; Python's own limit of recursion is 1000."""


class TimedOut(BaseException):  # no Exception, for a strategy may catch those
    """An actor does not end its step; the text says which one, and where it stands."""


class HardExit(SystemExit):
    """`os._exit` was called where it would have ended the whole run."""


class FailureNote(msgspec.Struct, frozen=True):
    """The last record of a process that failed: the step it was in, and the cause in words."""

    actor: str
    step: int
    cause: str
    expected: bool
    """True for an AcrcError, whose sentence says it all; False for a bug, whose traceback is in the log."""


def failure_note(actor: str, step: int, error: BaseException) -> FailureNote:
    """Return the cause in words; releases the process's reserve."""
    release()
    if isinstance(error, AcrcError | TimedOut):
        return FailureNote(actor, step, printable(str(error)), expected=True)
    # what the lack of memory meets on its way up may fail, too: the first one is the cause
    alike = [error, *takewhile(lambda one: isinstance(one, MemoryError), _chain(error))]
    place = next(filter(None, map(_raised_at, reversed(alike))), "")  # without memory there are no lines
    return FailureNote(actor, step, printable(f"{_said(error)}{place}"), expected=False)


def print_traceback(error: BaseException) -> None:
    """Print the traceback of a bug, as far as standard error takes it; of endless recursion the end."""
    with suppress(MemoryError, OSError):
        for one in _chain(error):
            one.__traceback__ = _end_of(one.__traceback__)
        traceback.print_exception(error)


def own_frames(error: BaseException) -> str:
    """Return the lines of the traceback that are in the user's own code, or in a shipped strategy."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if _is_own((frame.filename, 0)) and not frame.filename.startswith(_FRAMEWORK)
    ]
    return printable("".join(traceback.format_list(frames[-_MOST_SHOWN:])))


def in_words(note: FailureNote) -> str:
    """Return the note as one sentence."""
    where = "" if note.cause.startswith("step ") else f"{note.actor} failed in step {note.step}: "
    return f"{where}{note.cause}"


def where(frame: FrameType | None) -> str:
    """`mine.py:12 (advance)`: where in its own code, not in a library, a thread stands."""
    frames = [(at.f_code.co_filename, line, at.f_code.co_name) for at, line in traceback.walk_stack(frame)]
    own = own_place([(name, line) for name, line, _ in frames])
    function = next((each[2] for each in frames if each[:2] == own), "")
    return f"{Path(own[0]).name}:{own[1]} ({function})"


def own_place(frames: Sequence[tuple[str, int]]) -> tuple[str, int]:
    """Of file names and lines, the innermost first, the first that is in no library."""
    return next(filter(_is_own, frames), frames[0] if frames else ("nowhere", 0))


def _is_own(frame: tuple[str, int]) -> bool:
    return not frame[0].startswith((*_LIBRARIES, "<"))


def _raised_at(error: BaseException) -> str:
    """` (mine.py:12)`: the last line of its own code on the way to where it was raised; "" if it is lost."""
    frames: Iterable[tuple[str, int]] = (
        (frame.f_code.co_filename, line) for frame, line in traceback.walk_tb(error.__traceback__)
    )
    if isinstance(error, HardExit):
        frames = [*frames][:-1]  # the last one is that of the function that stands in for os._exit
    last = own = ("", 0)
    for last in frames:
        own = last if _is_own(last) else own
    name, line = own if own[0] else last
    return f" ({Path(name).name}:{line})" if name else ""


def _chain(error: BaseException) -> Iterator[BaseException]:
    """The error and those that it came of."""
    seen: set[int] = set()
    now: BaseException | None = error
    while now is not None and id(now) not in seen:
        seen.add(id(now))
        yield now
        now = now.__cause__ or now.__context__


def _end_of(trace: TracebackType | None) -> TracebackType | None:
    length, at = 0, trace
    while at is not None:
        length, at = length + 1, at.tb_next
    for _ in range(length - _LONGEST_TRACE):
        trace = trace and trace.tb_next
    return trace


def _said(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        function = "os._exit" if isinstance(error, HardExit) else "sys.exit"
        return f"its code called {function}({error.code!r})"
    try:
        text = str(error)
    except Exception:  # an exception of the user's own, that cannot even be shown
        text = "(which has no text that can be shown)"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
