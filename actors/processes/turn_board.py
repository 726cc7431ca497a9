"""Whose turn it is in a run in memory, where another process can see it: `actors.processes.warden`."""

import faulthandler
import math
import mmap
import os
import signal
import struct
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Final, NamedTuple

from actors.installation.repository import REPOSITORY
from actors.runtime.lifecycle.environment import passed_on, python

_FORM: Final = struct.Struct("q64s")
SIZE: Final = _FORM.size
"""Bytes of the board."""
Show = Callable[[int, str], None]
"""Shows the step, and the actor whose turn it is."""


class BoardTurn(NamedTuple):
    """Whose turn it is."""

    step: int
    actor: str
    """"" while the actors are being made."""

    def in_words(self) -> str:
        """What whoever has the turn does not do."""
        if not self.actor:
            return "the actors are not made"
        return f"step {self.step}: {self.actor} does not come to the step's end"


def read(board: mmap.mmap) -> BoardTurn:
    """What the board shows; it may be half written."""
    step, actor = _FORM.unpack(board[:SIZE])
    return BoardTurn(step, actor.rstrip(b"\0").decode(errors="replace"))


@contextmanager
def warded(step_s: float) -> Iterator[Show]:
    """A warden looks after this process meanwhile; yields what shows it whose turn it is.

    Not in other threads than the main one, where no signal arrives, nor without a timeout, for a debugger.
    """
    if threading.current_thread() is not threading.main_thread() or math.isinf(step_s):
        yield lambda step, actor: None
        return
    with ExitStack() as stack:
        file = stack.enter_context(tempfile.TemporaryFile(buffering=0))
        file.truncate(SIZE)
        board = stack.enter_context(mmap.mmap(file.fileno(), SIZE))
        wakes, woken = _pipe(stack)
        frames, framed = _pipe(stack)
        numbers = (file.fileno(), wakes, frames)
        warden = subprocess.Popen(
            [*python(), "-m", "actors.processes.warden", *map(str, (*numbers, os.getpid(), step_s))],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=numbers,
            start_new_session=True,  # a terminal's Ctrl-C is meant for this process
            cwd=REPOSITORY,
            env=passed_on(os.environ),
        )
        stack.callback(warden.wait)
        stack.callback(warden.kill)
        before = signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
        stack.callback(signal.set_wakeup_fd, before)
        faulthandler.register(signal.SIGUSR1, file=framed, all_threads=False)
        stack.callback(faulthandler.unregister, signal.SIGUSR1)
        yield lambda step, actor: _FORM.pack_into(board, 0, step, actor.encode())


def _pipe(stack: ExitStack) -> tuple[int, int]:
    """Both ends, which never wait."""
    ends = os.pipe()
    for end in ends:
        os.set_blocking(end, False)
        stack.callback(os.close, end)
    return ends
