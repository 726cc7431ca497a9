"""Being ended from outside: by Ctrl-C, by the system, by a terminal that closes."""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_CLEARANCE_S: Final = 10.0
"""How long what a signal has set off may take, s; longer than every process gets to end."""
_AGAIN_S: Final = 0.05
"""After so long a signal that was lost is sent again, s; if that is lost, too, once more."""


class Interrupted(BaseException):  # what a person or the system asked for is no error
    """The command was ended from outside; `exit_code` is 128 + the signal's number.

    No Exception, so that a strategy in this process, which may catch those, does not keep it to itself.
    """

    def __init__(self, exit_code: int) -> None:
        super().__init__(exit_code)
        self.exit_code = exit_code
        self.recorded: Path | None = None
        """The folder with what a run has recorded up to then; None if there is none."""


@contextmanager
def signals_as_interrupts() -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP become Interrupted, so that what was started is ended in order.

    What one of them has set off is not cut short by the next, and none is lost. A signal that this process
    was started to ignore, as by nohup, stays ignored.
    """
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    raised_s = -math.inf

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal raised_s
        if time.monotonic() > raised_s + _CLEARANCE_S:
            raised_s = time.monotonic()
            raise Interrupted(128 + number)

    def lost(what: "UnraisableHookArgs") -> None:
        """What is raised while C calls Python, as where a kernel is loaded, gets no further than there."""
        nonlocal raised_s
        if not isinstance(what.exc_value, Interrupted):
            tell(what)
            return
        raised_s = -math.inf
        again = threading.Timer(_AGAIN_S, os.kill, (os.getpid(), what.exc_value.exit_code - 128))
        again.daemon = True
        again.start()

    tell = sys.unraisablehook
    before = {number: signal.getsignal(number) for number in numbers}
    heeded = [number for number, handler in before.items() if handler is not signal.SIG_IGN]
    try:
        for number in heeded:
            signal.signal(number, interrupt)
        sys.unraisablehook = lost
        yield
    except RuntimeError as error:
        # Until Python 3.11, what comes while a class names its attributes, so in an import, comes as this.
        if isinstance(error.__cause__, Interrupted):
            raise error.__cause__ from None
        raise
    finally:
        sys.unraisablehook = tell
        for number, handler in before.items():
            signal.signal(number, handler)
