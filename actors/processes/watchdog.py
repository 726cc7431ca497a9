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

    def description(self) -> str:
        """Describe the step that the current actor has not finished."""
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
        signal_reader, signal_writer = _pipe(stack)
        dump_reader, dump_writer = _pipe(stack)
        numbers = (file.fileno(), signal_reader, dump_reader)
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
        before = signal.set_wakeup_fd(signal_writer, warn_on_full_buffer=False)
        stack.callback(signal.set_wakeup_fd, before)
        faulthandler.register(signal.SIGUSR1, file=dump_writer, all_threads=False)
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
_CHECK_INTERVAL_S: Final = 0.5
_DUMP_TIMEOUT_S: Final = 1.0
"""Timeout for the stack dump."""


class Watchdog:
    """Watchdog of one process."""

    def __init__(
        self, board: mmap.mmap, signal_reader: int, dump_reader: int, pid: int, step_s: float
    ) -> None:
        self._board, self._signal_reader, self._dump_reader, self._pid = (
            board,
            signal_reader,
            dump_reader,
            pid,
        )
        self._last_state: BoardState | None = None
        self._step_detector = StallDetector(Timeout(step_s + _GRACE_S), table=_other_processes)
        self._exit_detector: StallDetector | None = None
        """Started by a signal to exit; None: no signal yet."""

    def check(self) -> str | None:
        """Return a sentence on the actor in which the process hangs; None: it does not hang."""
        state = read(self._board)
        if state != self._last_state:
            self._last_state = state
            self._step_detector.step()
        if self._exit_detector is None and self._has_exit_signal():
            self._exit_detector = StallDetector(Timeout(_GRACE_S), table=_other_processes)
        suspects = (AwaitedProcess(state.actor, self._pid),)
        activity = state.description()
        if self._exit_detector is not None and self._exit_detector.check(suspects, suspects, activity):
            return f"{activity} within {_GRACE_S:g} s of a signal to exit{self._location()}"
        stall = self._step_detector.check(suspects, suspects, activity, "step" if state.actor else "start")
        return stall and f"{stall.sentence}{self._location()}"

    def kill(self) -> None:
        """Kill the process and its descendants."""
        members = process_table.descendants((self._pid,), _other_processes())
        for pid in (self._pid, *(members - {self._pid})):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def _has_exit_signal(self) -> bool:
        """Return whether one of the signals has arrived, handled or not."""
        with suppress(BlockingIOError):
            if {*os.read(self._signal_reader, 1 << 16)} & {*_EXIT_SIGNALS}:
                return True
        return bool({*_pending_signals(self._pid)} & {*_EXIT_SIGNALS})

    def _location(self) -> str:
        with suppress(ProcessLookupError):
            os.kill(self._pid, signal.SIGUSR1)
        text, deadline = b"", time.monotonic() + _DUMP_TIMEOUT_S
        while time.monotonic() < deadline and not (place := line_in_dump(text.decode(errors="replace"))):
            time.sleep(0.05)
            with suppress(BlockingIOError):
                text += os.read(self._dump_reader, 1 << 16)
        return f"; it is at {place}" if place else ""


def _other_processes() -> dict[int, ProcessState]:
    """Return all processes except this one."""
    found = process_table.processes()
    found.pop(os.getpid(), None)
    return found


def _pending_signals(pid: int) -> Iterator[int]:
    """Yield the pending signals of a process (SigPnd and ShdPnd, proc(5))."""
    with suppress(OSError):
        for line in Path(f"/proc/{pid}/status").read_text().splitlines():
            name, _, value = line.partition(":")
            if name in ("SigPnd", "ShdPnd"):
                mask = int(value, 16)
                yield from (number for number in range(1, 65) if mask >> (number - 1) & 1)


def main(argv: Sequence[str]) -> int:
    """Monitor the process until it exits."""
    board, signal_reader, dump_reader, pid = map(int, argv[:4])
    for number in (signal_reader, dump_reader):
        os.set_blocking(number, False)
    with mmap.mmap(board, SIZE, access=mmap.ACCESS_READ) as seen:
        watchdog = Watchdog(seen, signal_reader, dump_reader, pid, float(argv[4]))
        while os.getppid() == pid:
            if sentence := watchdog.check():
                with suppress(OSError):  # standard error may be closed
                    os.write(2, f"acrc: {sentence}\n".encode())
                watchdog.kill()
                return 0
            time.sleep(_CHECK_INTERVAL_S)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
