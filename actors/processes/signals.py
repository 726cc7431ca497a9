"""Signals that end a command: Ctrl-C, SIGTERM, a closed terminal."""

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

_CLEANUP_TIMEOUT_S: Final = 10.0
"""Timeout for a clean exit after a signal, s; longer than any process's own timeout."""
_RESEND_DELAY_S: Final = 0.05
"""Delay before a lost signal is sent again, s."""


class Interruption(BaseException):  # not an error
    """The command was interrupted by a signal; `exit_code` is 128 + the signal's number.

    Not an Exception, because a strategy in this process may catch those.
    """

    def __init__(self, exit_code: int) -> None:
        super().__init__(exit_code)
        self.exit_code = exit_code
        self.recorded: Path | None = None
        """Folder of the run so far; None if there is none."""


@contextmanager
def signals_as_interrupts() -> Iterator[None]:
    """Raise Interruption on Ctrl-C, SIGTERM and SIGHUP, so that child processes and files are cleaned up.

    A second signal does not interrupt the clean-up, and no signal is lost. Signals ignored at the start of
    this process, as with nohup, stay ignored.
    """
    interrupt_handler = _InterruptHandler()
    former_handlers = {
        number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    handled = [number for number, handler in former_handlers.items() if handler is not signal.SIG_IGN]
    try:
        for number in handled:
            signal.signal(number, interrupt_handler.interrupt)
        sys.unraisablehook = interrupt_handler.send_again
        yield
        interrupt_handler.raise_lost()
    except RuntimeError as error:
        # Until Python 3.11, a RuntimeError wraps exceptions in __set_name__, and thus during imports.
        if isinstance(error.__cause__, Interruption):
            raise error.__cause__ from None
        raise
    except ImportError:
        # C extensions such as numpy replace exceptions during their import.
        if interrupt_handler.raised is not None:
            raise interrupt_handler.raised from None
        raise
    finally:
        interrupt_handler.cancel_pending()
        sys.unraisablehook = interrupt_handler.former_hook
        for number, handler in former_handlers.items():
            signal.signal(number, handler)


class _InterruptHandler:
    """Handler that raises Interruption on a signal, and again if the exception was lost."""

    def __init__(self) -> None:
        self.former_hook = sys.unraisablehook
        self.raised: Interruption | None = None
        """Exception of the last signal."""
        self._raised_s = -math.inf
        self._lost: Interruption | None = None
        self._timers: list[threading.Timer] = []

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Raise Interruption, unless the clean-up after an earlier signal is in progress."""
        if time.monotonic() > self._raised_s + _CLEANUP_TIMEOUT_S:
            self._raised_s, self._lost = time.monotonic(), None
            self.raised = Interruption(128 + number)
            raise self.raised

    def send_again(self, unraisable: "UnraisableHookArgs") -> None:
        """Send a signal again if C code swallowed its exception, for example while a kernel is loaded."""
        if not isinstance(unraisable.exc_value, Interruption):
            self.former_hook(unraisable)
            return
        self._raised_s, self._lost = -math.inf, unraisable.exc_value
        timer = threading.Timer(_RESEND_DELAY_S, os.kill, (os.getpid(), self._lost.exit_code - 128))
        timer.daemon = True
        timer.start()
        self._timers.append(timer)

    def raise_lost(self) -> None:
        """Raise Interruption if one was lost and has not been raised again."""
        if self._lost is not None:
            raise self._lost.with_traceback(None)

    def cancel_pending(self) -> None:
        """Cancel or ignore pending signals: later they would kill the process without a message."""
        if self._timers:
            self._raised_s = time.monotonic()
        for timer in self._timers:
            timer.cancel()
            timer.join()
