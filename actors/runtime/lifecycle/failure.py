"""How a process that failed says so: the cause in words that can be shown on any terminal."""

import sysconfig
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Final

import msgspec

from actors.runtime.errors import AcrcError, printable

_LIBRARIES: Final = tuple(
    f"{sysconfig.get_path(name)}/" for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Where code lies that is neither the user's nor this project's."""


class TimedOut(BaseException):  # no Exception, for a strategy may catch those
    """An actor does not come to the end of its step; the text says which one, and where it stands."""


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
    """The cause, whole, as far as it can be printed."""
    if isinstance(error, AcrcError | TimedOut):
        return FailureNote(actor, step, printable(str(error)), expected=True)
    frames = [(frame.filename, frame.lineno or 0) for frame in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, HardExit):
        frames.pop()  # that of the function that stands in for os._exit
    name, line = own_place(frames[::-1])
    return FailureNote(actor, step, printable(f"{_said(error)} ({Path(name).name}:{line})"), expected=False)


def in_words(note: FailureNote) -> str:
    """The note as one sentence."""
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
    own = (frame for frame in frames if not frame[0].startswith((*_LIBRARIES, "<")))
    return next(own, frames[0] if frames else ("nowhere", 0))


def _said(error: BaseException) -> str:
    if isinstance(error, SystemExit):
        function = "os._exit" if isinstance(error, HardExit) else "sys.exit"
        return f"its code called {function}({error.code!r})"
    try:
        text = str(error)
    except Exception:  # an exception of the user's own, that cannot even be shown
        text = "(which has no text that can be shown)"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
