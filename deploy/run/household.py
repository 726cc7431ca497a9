"""Looks after a run whose actors, and so strategies of the user's, are all in this very process."""

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import FrameType, TracebackType
from typing import Final, NoReturn, Self

from actors.processes.silence import Silence, Suspect, Telling, Timeout
from actors.processes.turn_board import BoardTurn
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.failure import HardExit, TimedOut, where
from actors.runtime.lifecycle.linux import PR_SET_CHILD_SUBREAPER, prctl
from actors.runtime.lifecycle.process_table import ProcessGlance, leftover_fault
from actors.runtime.pace import ticking
from actors.runtime.shell import Shell

_TICK_S: Final = 0.25


def quiet(timeout: Timeout) -> Silence:
    """For the process that it looks at itself."""
    return Silence(timeout, look=lambda: {os.getpid(): ProcessGlance(0, 0, "S", time.process_time())})


def _say(sentence: str) -> None:
    """Past Python's own streams, which may be the strategy's at this moment."""
    with contextlib.suppress(OSError):
        os.write(2, f"acrc: {sentence}\n".encode())


@contextlib.contextmanager
def watched(
    shells: Sequence[Shell], silence: Silence, turn: Callable[[], BoardTurn], give_up: Callable[[str], None]
) -> Iterator[None]:
    """Raise TimedOut in the main thread if none of the `shells` advances for too long.

    `silence` is one that `quiet` makes; `turn` says whose turn it is. `give_up` is called once it has been
    raised in vain, and must not return. In other threads than the main one, where no signal arrives, nobody
    is watched.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    telling = Telling(silence, _say)
    advances = -1
    in_vain = 0

    def tick(frame: FrameType | None) -> None:
        nonlocal advances, in_vain
        now = sum(shell.advances for shell in shells)
        if now != advances:
            advances = now
            silence.broken()
            telling.broken()
            return
        now_on = turn()
        me = (Suspect(now_on.actor, os.getpid()),)
        verdict = silence.verdict(me, me, now_on.in_words())
        if verdict is not None:
            in_vain += 1
            sentence = f"{verdict.sentence}; it stands at {where(frame)}"
            if in_vain > 3:
                give_up(sentence)
            raise TimedOut(sentence)
        telling.lasts(me, now_on.in_words())

    with ticking(_TICK_S, tick):
        yield


@contextlib.contextmanager
def exits_caught() -> Iterator[None]:
    """`os._exit` raises HardExit instead of ending this process without a word."""
    leave, me = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != me:  # a child of a strategy's own
            leave(status)
        raise HardExit(status)

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = leave


class Leftovers:
    """What strategies in this process have started and not ended; made before the run."""

    def __init__(self) -> None:
        self._threads = threading.enumerate()
        self._children = process_table.children(os.getpid(), process_table.table())
        self.fault: str | None = None
        """Once this context has been left: what is wrong."""

    def __enter__(self) -> Self:
        _adopt_orphans(True)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        heirs = process_table.children(os.getpid(), process_table.table()) - self._children
        self.fault = leftover_fault(process_table.end_orphans(heirs) > 0, self._threads)
        _adopt_orphans(False)


def _adopt_orphans(adopt: bool) -> None:
    if sys.platform == "linux":
        # An emulator of processes has no such thing: there, children alone are found.
        with contextlib.suppress(OSError):
            prctl(PR_SET_CHILD_SUBREAPER, int(adopt))
