"""Watchdog process of an in-memory run, where strategies share the process that detects stalls.

While that process is blocked in the kernel (vfork(2)) or in C code, neither a timeout nor Ctrl-C reaches it.
`python -m actors.processes.watchdog BOARD WAKES FRAMES PID STEP_S` reports the actor at fault and kills it.
"""

import faulthandler
import math
import mmap
import os
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final, NamedTuple

from actors.installation.repository import REPOSITORY
from actors.processes.monitor import AwaitedProcess, StallDetector, Timeout
from actors.processes.robot_logs import line_in_dump
from actors.runtime import process_table
from actors.runtime.process_table import ProcessState, child_environment, python_command

_FORM: Final = struct.Struct("q64s")
SIZE: Final = _FORM.size
"""Bytes of the shared memory."""
WriteBoard = Callable[[int, str], None]
"""Function that writes the step and the current actor to the shared memory."""


class BoardState(NamedTuple):
    """Content of the shared memory: the current actor."""

    step: int
    actor: str
    """Empty while the actors are being created."""

    def in_words(self) -> str:
        """Return what the current actor has failed to do."""
        if not self.actor:
            return "the actors have not been created"
        return f"step {self.step}: {self.actor} has not finished the step"


def read(board: mmap.mmap) -> BoardState:
    """Read the shared memory; it may be half written."""
    step, actor = _FORM.unpack(board[:SIZE])
    return BoardState(step, actor.rstrip(b"\0").decode(errors="replace"))


@contextmanager
def run_watchdog(step_s: float) -> Iterator[WriteBoard]:
    """Run a watchdog process meanwhile; yield the function that reports the current actor to it.

    Runs no watchdog outside the main thread, where no signal arrives, or without a timeout, for a debugger.
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
        watchdog = subprocess.Popen(
            [
                *python_command(),
                "-m",
                "actors.processes.watchdog",
                *map(str, (*numbers, os.getpid(), step_s)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            pass_fds=numbers,
            start_new_session=True,  # Ctrl-C must not reach the watchdog
            cwd=REPOSITORY,
            env=child_environment(os.environ),
        )
        stack.callback(watchdog.wait)
        stack.callback(watchdog.kill)
        before = signal.set_wakeup_fd(woken, warn_on_full_buffer=False)
        stack.callback(signal.set_wakeup_fd, before)
        faulthandler.register(signal.SIGUSR1, file=framed, all_threads=False)
        stack.callback(faulthandler.unregister, signal.SIGUSR1)
        yield lambda step, actor: _FORM.pack_into(board, 0, step, actor.encode())


def _pipe(stack: ExitStack) -> tuple[int, int]:
    """Return both ends of a non-blocking pipe."""
    ends = os.pipe()
    for end in ends:
        os.set_blocking(end, False)
        stack.callback(os.close, end)
    return ends


_EXIT_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_GRACE_S: Final = 10.0
"""Own time in which the process must exit after a timeout or a signal; own choice."""
_LOOK_S: Final = 0.5
_ANSWER_S: Final = 1.0
"""Timeout for the stack dump."""


class Watchdog:
    """Watchdog of one process."""

    def __init__(self, board: mmap.mmap, wakes: int, frames: int, pid: int, step_s: float) -> None:
        self._board, self._wakes, self._frames, self._pid = board, wakes, frames, pid
        self._turn: BoardState | None = None
        self._step = StallDetector(Timeout(step_s + _GRACE_S), table=_other_processes)
        self._end: StallDetector | None = None
        """Started by a signal to exit; None: no signal yet."""

    def look(self) -> str | None:
        """Return a sentence on the actor in which the process hangs; None: it does not hang."""
        turn = read(self._board)
        if turn != self._turn:
            self._turn = turn
            self._step.step()
        if self._end is None and self._told_to_end():
            self._end = StallDetector(Timeout(_GRACE_S), table=_other_processes)
        me = (AwaitedProcess(turn.actor, self._pid),)
        what = turn.in_words()
        if self._end is not None and self._end.check(me, me, what):
            return f"{what} within {_GRACE_S:g} s of a signal to exit{self._place()}"
        stall = self._step.check(me, me, what, "step" if turn.actor else "start")
        return stall and f"{stall.sentence}{self._place()}"

    def end(self) -> None:
        """Kill the process and its descendants."""
        family = process_table.descendants((self._pid,), _other_processes())
        for pid in (self._pid, *(family - {self._pid})):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def _told_to_end(self) -> bool:
        """Return whether one of the signals has arrived, handled or not."""
        with suppress(BlockingIOError):
            if {*os.read(self._wakes, 1 << 16)} & {*_EXIT_SIGNALS}:
                return True
        return bool({*_pending(self._pid)} & {*_EXIT_SIGNALS})

    def _place(self) -> str:
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGUSR1)
        text, deadline = b"", time.monotonic() + _ANSWER_S
        while time.monotonic() < deadline and not (place := line_in_dump(text.decode(errors="replace"))):
            time.sleep(0.05)
            with suppress(BlockingIOError):
                text += os.read(self._frames, 1 << 16)
        return f"; it is at {place}" if place else ""


def _other_processes() -> dict[int, ProcessState]:
    """Return all processes except this one."""
    found = process_table.processes()
    found.pop(os.getpid(), None)
    return found


def _pending(pid: int) -> Iterator[int]:
    """Yield the pending signals of a process (SigPnd and ShdPnd, proc(5))."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            name, _, value = line.partition(":")
            if name in ("SigPnd", "ShdPnd"):
                mask = int(value, 16)
                yield from (number for number in range(1, 65) if mask >> (number - 1) & 1)


def main(argv: Sequence[str]) -> int:
    """Monitor the process until it exits."""
    board, wakes, frames, pid = map(int, argv[:4])
    for number in (wakes, frames):
        os.set_blocking(number, False)
    with mmap.mmap(board, SIZE, access=mmap.ACCESS_READ) as seen:
        watchdog = Watchdog(seen, wakes, frames, pid, float(argv[4]))
        while os.getppid() == pid:
            if sentence := watchdog.look():
                with suppress(OSError):  # standard error may be closed
                    os.write(2, f"acrc: {sentence}\n".encode())
                watchdog.end()
                return 0
            time.sleep(_LOOK_S)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
