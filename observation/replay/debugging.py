"""Stops a robot that is replayed in the user's own code."""

import bdb
import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, cast

from actors.installation.usage import command
from actors.instant import Instant, seconds
from actors.runtime.core import Core, Inputs, Output
from actors.runtime.debugger import UserPdb
from actors.runtime.errors import AcrcError


class EnoughError(Exception):
    """The instant has come after which nothing more was asked for, or somebody has left the debugger."""


@dataclass(frozen=True)
class Stretch:
    """The part of a run that somebody wants to look at."""

    begin_s: float = 0.0
    end_s: float | None = None
    """None: to the end."""


def watch(core: Core, step_us: int, stretch: Stretch, stop: Callable[[], None] | None) -> None:
    """Call `stop` before the first step of the stretch, and end with EnoughError behind the last one."""
    advance = core.advance
    begin, stopped = seconds(stretch.begin_s), stop is None
    end = None if stretch.end_s is None else seconds(stretch.end_s)

    def watched(inputs: Inputs) -> Sequence[Output]:
        nonlocal stopped
        instant = Instant(core.step * step_us)
        if end is not None and instant > end:
            raise EnoughError
        if not stopped and instant >= begin:
            stopped = True
            assert stop is not None
            stop()
        try:
            return advance(inputs)
        except bdb.BdbQuit:
            raise EnoughError from None

    cast(Any, core).advance = watched


def terminal(*, own: bool) -> Callable[[], None]:
    """Python's own debugger, at the next line of the user's code; `own`: as in `UserPdb`."""
    return UserPdb(own=own).set_trace


def debugpy_at(port: int) -> Callable[[], None]:
    """A debugger that attaches to a port of this machine, and stops in the user's code by its breakpoints.

    Waits for it at once. Raises AcrcError where the package is missing.
    """
    if importlib.util.find_spec("debugpy") is None:
        raise AcrcError(
            f"--debugpy {port}: needs the Python package debugpy, which is not installed; "
            f"`{command()} add debugpy` brings it"
        )
    debugpy: Any = importlib.import_module("debugpy")
    debugpy.listen(("127.0.0.1", port))
    debugpy.wait_for_client()
    return cast(Callable[[], None], debugpy.breakpoint)
