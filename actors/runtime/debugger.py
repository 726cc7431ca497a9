"""A debugger in the user's own code, at a terminal; meanwhile the whole run waits."""

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
"""The shipped strategies: the user's code if there is no other."""


class UserPdb(pdb.Pdb):
    """A debugger that steps over everything that a strategy runs on."""

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
    """A debugger that ends the run when the user leaves it."""

    def set_quit(self) -> None:
        """Raises AcrcError."""
        super().set_quit()
        sys.settrace(None)
        raise AcrcError("somebody has left the debugger; `c` goes on with the run")


def answer_breakpoints(terminal: str | None, robot: str) -> None:
    """Decide what `breakpoint()` does in this process from now on.

    `terminal`: the path of a device, at which it stops and output appears; empty: nothing, for another robot
    is debugged; None: raise AcrcError, for nobody could type. Raises AcrcError where it cannot be opened.
    """

    def refuse(*args: object, **kwargs: object) -> None:
        raise AcrcError(f"breakpoint() has no terminal here; `acrc run --debug {robot}` stops there")

    if terminal:
        streams = sys.stdin, sys.stdout = _open(terminal)
        sys.breakpointhook = lambda *args, **kwargs: _RobotPdb(*streams).set_trace(sys._getframe(1))
    else:
        sys.breakpointhook = refuse if terminal is None else lambda *args, **kwargs: None


def _open(terminal: str) -> tuple[TextIO, TextIO]:
    try:
        device = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    except OSError as error:
        raise AcrcError(f"{terminal}: no terminal for a debugger: {error.strerror}") from None
    reading = os.fdopen(device, encoding="utf-8", errors="replace")
    return reading, os.fdopen(os.dup(device), "w", encoding="utf-8", buffering=1)


def stop_here(frame: FrameType | None) -> None:
    """Stop in a frame, at the streams that this process was started with, wherever they lead by now."""
    _RobotPdb(sys.__stdin__, sys.__stdout__).set_trace(frame)
