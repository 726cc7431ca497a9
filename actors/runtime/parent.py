"""The tie between a process and the one that started it."""

import os
import signal
import sys
from types import FrameType

from actors.runtime.linux import PR_SET_PDEATHSIG, prctl


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
    """Let SIGTERM end this process by SystemExit, so that sockets, files and sessions are closed."""

    def leave(number: int, frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, leave)
