"""The tie between a process and the one that started it."""

import faulthandler
import os
import signal
import sys
from contextlib import suppress
from types import FrameType
from typing import NoReturn

from actors.runtime.lifecycle.linux import PR_SET_PDEATHSIG, prctl


class Ended(SystemExit):
    """This process was told to end by SIGTERM, and does so in order."""


def die_with_parent(parent: int, number: signal.Signals = signal.SIGKILL) -> None:
    """Get the signal `number` as soon as the parent ends; `parent` is the parent's process id.

    To be called after `isolate`, because a change of user or capabilities clears the setting (prctl(2),
    PR_SET_PDEATHSIG), and in the thread that lives as long as the process. The parent is held to have ended
    when the *thread* that started this process ends. On systems other than Linux only a parent that is
    already gone is noticed.
    """
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)


def leave_in_order() -> None:
    """Let SIGTERM end this process by Ended, so that sockets, files and sessions are closed."""

    def leave(number: int, frame: FrameType | None) -> None:
        raise Ended(128 + number)

    signal.signal(signal.SIGTERM, leave)


def leave(code: int) -> NoReturn:
    """End this process now: what threads of a user's own do is not waited for, nor what a full disk keeps."""
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def answer_where() -> None:
    """From now on SIGUSR1 writes to standard error where this process stands, out of an endless loop, too,
    and so does a crash, such as an overflow of the stack."""
    faulthandler.enable(file=2)
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=True)
