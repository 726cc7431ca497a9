"""Behaviours that go wrong on purpose, by entry string."""

import contextlib
import ctypes
import mmap
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from actors.instant import Instant, seconds
from actors.robot.behaviour import Behaviour, Decision, Start, View
from cleaning.strategies.none import behaviour as baseline

WHEN = seconds(2)


class Raises:
    """Follows the baseline for two seconds, then has a bug, if it is r2."""

    def __init__(self, start: Start) -> None:
        self._guilty = start.robot == "r2"
        self._inner = baseline(start)

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline, for a while."""
        if self._guilty and view.instant >= WHEN:
            raise ZeroDivisionError("my strategy divides by the number of its friends")
        return self._inner.advance(view, until)


class Behaves(Raises):
    """Follows the baseline, but for what r2 does once after two seconds."""

    def __init__(self, start: Start, deed: Callable[[], object]) -> None:
        super().__init__(start)
        self._deed = deed

    def advance(self, view: View, until: Instant) -> Decision:
        """As the baseline, for a while."""
        if self._guilty and view.instant >= WHEN:
            self._guilty = False
            self._deed()
        return self._inner.advance(view, until)


def _sleep() -> None:
    while True:
        time.sleep(1)


def _spin() -> None:
    count = 0
    while True:
        count += 1


def _fork() -> None:
    if os.fork() == 0:
        time.sleep(1000)
        os._exit(0)


def _fork_twice() -> None:
    child = os.fork()
    if child == 0:
        if os.fork() == 0:
            os.setsid()
            time.sleep(1000)
        os._exit(0)
    os.waitpid(child, 0)


def _start_a_thread() -> None:
    threading.Thread(target=time.sleep, args=(1000,), name="mine").start()


def _say_much() -> None:
    raise ValueError("first line\nsecond \x1b[31mline\udc80")


def raises(start: Start) -> Behaviour:
    """Entry `tests.failures.saboteur:raises`."""
    return Raises(start)


def hangs(start: Start) -> Behaviour:
    """Never answers, and uses no processor."""
    return Behaves(start, _sleep)


def spins(start: Start) -> Behaviour:
    """Never answers, and uses as much processor as there is."""
    return Behaves(start, _spin)


def naps(start: Start) -> Behaviour:
    """Sleeps for longer than a second, but not for too long, three steps long."""
    inner = baseline(start)

    class Naps:
        def advance(self, view: View, until: Instant) -> Decision:
            if start.robot == "r2" and WHEN <= view.instant < WHEN + seconds(0.3):
                time.sleep(2)
            return inner.advance(view, until)

    return Naps()


def half_works(start: Start) -> Behaviour:
    """Never answers, and uses the processor half of the time."""

    def work() -> None:
        while True:
            end_s = time.process_time() + 0.05
            while time.process_time() < end_s:
                pass
            time.sleep(0.05)

    return Behaves(start, work)


def vforks(start: Start) -> Behaviour:
    """Waits in the kernel for a process of its own that does nothing: asleep as if for a disk."""

    def wait() -> None:
        clone = {"x86_64": 56, "aarch64": 220}[os.uname().machine]
        vfork = 0x4000
        if ctypes.CDLL(None).syscall(clone, vfork | signal.SIGCHLD, 0, 0, 0, 0) == 0:
            time.sleep(1000)
            os._exit(0)

    return Behaves(start, wait)


def never_returns(start: Start) -> Behaviour:
    """Stays in a function in C, deaf to signals, and lets no other thread run Python."""

    def stay() -> None:
        signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))
        ctypes.PyDLL(None).sleep(1000)

    return Behaves(start, stay)


def catches_all(start: Start) -> Behaviour:
    """Heeds nobody."""

    def stay() -> None:
        while True:
            with contextlib.suppress(BaseException):
                _sleep()

    return Behaves(start, stay)


def forks(start: Start) -> Behaviour:
    """Leaves a process behind."""
    return Behaves(start, _fork)


def forks_twice(start: Start) -> Behaviour:
    """Leaves a process behind whose parent has ended."""
    return Behaves(start, _fork_twice)


def starts_a_thread(start: Start) -> Behaviour:
    """Leaves a thread behind, that is no daemon."""
    return Behaves(start, _start_a_thread)


def exits(start: Start) -> Behaviour:
    """Ends its process as if all were well."""
    return Behaves(start, lambda: sys.exit(0))


def exits_hard(start: Start) -> Behaviour:
    """Ends its process as if all were well, and nobody can say a last word."""
    return Behaves(start, lambda: os._exit(0))


def says_much(start: Start) -> Behaviour:
    """Raises with more than a line of text, and not only letters in it."""
    return Behaves(start, _say_much)


def hoards(start: Start) -> Behaviour:
    """Takes more memory than there is, and writes on it."""
    hoard: list[bytearray] = []

    def take() -> None:
        while True:
            hoard.append(bytearray(10_000_000))

    return Behaves(start, take)


def leave_20_mb() -> None:
    """Lower the limit to what this process has and 20 MB, to 10 MB; how much it has, no file tells it."""
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    for most in range(30_000_000, hard, 10_000_000):
        resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
        with suppress(OSError, MemoryError):
            mmap.mmap(-1, 20_000_000, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS).close()
            return


def hoards_crumbs(start: Start) -> Behaviour:
    """Takes the last byte, too, of the 20 MB that it leaves itself."""
    hoard: list[bytearray] = []

    def take() -> None:
        leave_20_mb()
        while True:
            hoard.append(bytearray(1))

    return Behaves(start, take)


def cannot_be_made(start: Start) -> Behaviour:
    """Fails before its first step, if it is r2."""
    if start.robot == "r2":
        raise ZeroDivisionError("my strategy has no friends")
    return baseline(start)


def crashes(start: Start) -> Behaviour:
    """Ends its process by a signal of its own."""
    return Behaves(start, os.abort)


def fills(start: Start) -> Behaviour:
    """Fills the disk, a file after the other, and waits for what comes of it."""

    def write() -> None:
        for number in range(60):
            Path(f"{number}.bin").write_bytes(bytes(1_000_000))
        _sleep()

    return Behaves(start, write)
