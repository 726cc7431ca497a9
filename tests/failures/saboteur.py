"""Behaviours that go wrong on purpose, by entry string."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
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
        if self._guilty and view.instant >= WHEN:
            raise ZeroDivisionError("my strategy divides by the number of its friends")
        return self._inner.advance(view, until)


class Behaves(Raises):
    """Follows the baseline, but for what r2 does once after two seconds."""

    def __init__(self, start: Start, deed: Callable[[], object]) -> None:
        super().__init__(start)
        self._deed = deed

    def advance(self, view: View, until: Instant) -> Decision:
        if self._guilty and view.instant >= WHEN:
            self._guilty = False
            self._deed()
        return self._inner.advance(view, until)


def deed(work: Callable[[], object]) -> Callable[[Start], Behaviour]:
    """Return the entry of a behaviour whose r2 does this work."""
    return lambda start: Behaves(start, work)


def raises(start: Start) -> Behaviour:
    return Raises(start)


def _sleep() -> None:
    while True:
        time.sleep(1)


def _spin() -> None:
    count = 0
    while True:
        count += 1


hangs = deed(_sleep)
spins = deed(_spin)
exits = deed(lambda: sys.exit(0))
exits_hard = deed(lambda: os._exit(0))
crashes = deed(os.abort)
starts_a_thread = deed(
    lambda: threading.Thread(target=time.sleep, args=(1000,), name="mine", daemon=True).start()
)


@deed
def vforks() -> None:
    """Wait in the kernel for a child that does nothing: asleep as if for a disk."""
    clone = {"x86_64": 56, "aarch64": 220}[os.uname().machine]
    vfork = 0x4000
    if ctypes.CDLL(None).syscall(clone, vfork | signal.SIGCHLD, 0, 0, 0, 0) == 0:
        time.sleep(1000)
        os._exit(0)


@deed
def never_returns() -> None:
    """Stay in a function in C with signals blocked; no other thread runs Python."""
    signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))
    ctypes.PyDLL(None).sleep(1000)


@deed
def catches_all() -> None:
    while True:
        with contextlib.suppress(BaseException):
            _sleep()


@deed
def forks() -> None:
    if os.fork() == 0:
        time.sleep(1000)
        os._exit(0)


@deed
def forks_twice() -> None:
    """Leave a process behind whose parent has ended."""
    child = os.fork()
    if child == 0:
        if os.fork() == 0:
            os.setsid()
            time.sleep(1000)
        os._exit(0)
    os.waitpid(child, 0)


@deed
def says_much() -> None:
    raise ValueError("first line\nsecond \x1b[31mline\udc80")


@deed
def hoards() -> None:
    hoard: list[bytearray] = []
    while True:
        hoard.append(bytearray(10_000_000))


@deed
def fills() -> None:
    """Fill the disk, then wait for the watch."""
    for number in range(60):
        Path(f"{number}.bin").write_bytes(bytes(1_000_000))
    _sleep()


def naps(start: Start) -> Behaviour:
    inner = baseline(start)

    class Naps:
        def advance(self, view: View, until: Instant) -> Decision:
            if start.robot == "r2" and WHEN <= view.instant < WHEN + seconds(0.3):
                time.sleep(2)
            return inner.advance(view, until)

    return Naps()


def cannot_be_made(start: Start) -> Behaviour:
    if start.robot == "r2":
        raise ZeroDivisionError("my strategy has no friends")
    return baseline(start)
