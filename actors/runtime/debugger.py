"""Debugger for the user's code at a terminal; the run waits meanwhile."""

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
"""Framework code, which the debugger skips."""
_SHIPPED: Final = f"{_ROOT / 'cleaning'}/"
"""Shipped strategies: skipped if the user has a strategy of their own."""


class UserPdb(pdb.Pdb):
    """A debugger that skips framework code."""

    def __init__(
        self, stdin: TextIO | None = None, stdout: TextIO | None = None, *, own: bool = False
    ) -> None:
        """`own`: the strategy is the user's; skip the shipped strategies, too."""
        super().__init__(stdin=stdin, stdout=stdout, skip=["*"])  # calls is_skipped_module for every module
        self._skipped = (*_OURS, sys.prefix, sys.base_prefix, *((_SHIPPED,) if own else ()))

    def stop_here(self, frame: FrameType) -> bool:
        """As in Bdb, but never in code without a file, such as a dataclass's generated methods."""
        return not frame.f_code.co_filename.startswith("<") and super().stop_here(frame)

    def is_skipped_module(self, module_name: Any) -> bool:
        """Return True except for the user's code."""
        module = sys.modules.get(module_name or "")
        file = getattr(module, "__file__", None)
        if file is None:
            return True
        return str(Path(file).resolve()).startswith(self._skipped)


class _RobotPdb(UserPdb):
    """A debugger that ends the run when the user quits it."""

    def set_quit(self) -> None:
        """Raise AcrcError, which ends the run."""
        super().set_quit()
        sys.settrace(None)
        raise AcrcError("the run ended because the debugger was quit; use `c` to continue")


def answer_breakpoints(terminal: str | None, robot: str) -> None:
    """Set the behaviour of `breakpoint()` in this process.

    `terminal`: path of the terminal device for the debugger; empty: ignore breakpoints, another robot is
    debugged; None: raise AcrcError. Raises AcrcError if the device cannot be opened.
    """

    def refuse(*args: object, **kwargs: object) -> None:
        raise AcrcError(f"breakpoint() has no terminal; use `acrc run --debug {robot}`")

    if terminal:
        streams = sys.stdin, sys.stdout = _open(terminal)
        sys.breakpointhook = lambda *args, **kwargs: _RobotPdb(*streams).set_trace(sys._getframe(1))
    else:
        sys.breakpointhook = refuse if terminal is None else lambda *args, **kwargs: None


def _open(terminal: str) -> tuple[TextIO, TextIO]:
    try:
        device = os.open(terminal, os.O_RDWR | os.O_NOCTTY)
    except OSError as error:
        raise AcrcError(f"{terminal}: cannot be opened for the debugger: {error.strerror}") from None
    reading = os.fdopen(device, encoding="utf-8", errors="replace")
    return reading, os.fdopen(os.dup(device), "w", encoding="utf-8", buffering=1)


def stop_here(frame: FrameType | None) -> None:
    """Stop in a frame, using the streams that this process was started with."""
    _RobotPdb(sys.__stdin__, sys.__stdout__).set_trace(frame)
