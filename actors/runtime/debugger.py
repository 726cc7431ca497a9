"""A debugger in the user's own code, at whichever terminal somebody sits; meanwhile the whole run waits."""

import os
import pdb
import sys
from pathlib import Path
from types import FrameType
from typing import Any, Final, TextIO

from actors.runtime.errors import AcrcError

_ROOT: Final = Path(__file__).resolve().parents[2]
_OURS: Final = tuple(
    f"{_ROOT / name}/" for name in ("acrc_testbed", "actors", "deeco", "deploy", "firmware_bridge")
)
"""What a strategy runs on."""
_SHIPPED: Final = f"{_ROOT / 'cleaning'}/"
"""The shipped strategies: somebody's own code as long as he has no other."""


class UserPdb(pdb.Pdb):
    """Steps over everything that a strategy runs on."""

    def __init__(
        self, stdin: TextIO | None = None, stdout: TextIO | None = None, *, own: bool = False
    ) -> None:
        """`own`: the strategy is the user's, and what the shipped ones are made of is stepped over, too."""
        super().__init__(stdin=stdin, stdout=stdout, skip=["*"])  # so that is_skipped_module is asked
        self._skipped = (*_OURS, sys.prefix, sys.base_prefix, *((_SHIPPED,) if own else ()))

    def stop_here(self, frame: FrameType) -> bool:
        """As in Bdb, but never in code that stands in no file, as what a dataclass generates."""
        return not frame.f_code.co_filename.startswith("<") and super().stop_here(frame)

    def is_skipped_module(self, module_name: Any) -> bool:
        """True for all but the user's code."""
        module = sys.modules.get(module_name or "")
        file = getattr(module, "__file__", None)
        if file is None:
            return True
        return str(Path(file).resolve()).startswith(self._skipped)


class _RobotPdb(UserPdb):
    """Ends the run, with a sentence, when somebody leaves it."""

    def set_quit(self) -> None:
        """Raises AcrcError."""
        super().set_quit()
        sys.settrace(None)
        raise AcrcError("somebody has left the debugger; `c` goes on with the run")


def stop_at(terminal: str) -> None:
    """From now on `breakpoint()` in this process stops there, and what is printed appears there.

    `terminal`: the path of a device. Raises AcrcError where it cannot be opened.
    """
    try:
        device = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    except OSError as error:
        raise AcrcError(f"{terminal}: no terminal for a debugger: {error.strerror}") from None
    reading = os.fdopen(device, encoding="utf-8", errors="replace")
    writing = os.fdopen(os.dup(device), "w", encoding="utf-8", buffering=1)
    sys.stdin, sys.stdout = reading, writing
    sys.breakpointhook = lambda *args, **kwargs: _stop(sys._getframe(1), reading, writing)


def ignore_breakpoints() -> None:
    """From now on `breakpoint()` in this process does nothing: another robot is debugged."""
    sys.breakpointhook = lambda *args, **kwargs: None


def refuse_breakpoints(robot: str) -> None:
    """From now on `breakpoint()` in this process fails: nobody is there who could type."""

    def refuse(*args: object, **kwargs: object) -> None:
        raise AcrcError(f"breakpoint() has no terminal here; `acrc run --debug {robot}` stops there")

    sys.breakpointhook = refuse


def stop_here(frame: FrameType | None) -> None:
    """Stop in a frame, at the streams that this process was started with, wherever they lead by now."""
    _RobotPdb(sys.__stdin__, sys.__stdout__).set_trace(frame)


def _stop(frame: FrameType, reading: TextIO, writing: TextIO) -> None:
    _RobotPdb(reading, writing).set_trace(frame)
