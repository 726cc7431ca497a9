"""Starts actor processes, by a forkserver with the heavy imports preloaded or by exec, and sees them end."""

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from typing import Protocol

from actors.runtime.process import open_log


@dataclass(frozen=True)
class Program:
    """What one would type: `python -m MODULE ARGV…`, with the output going to a log."""

    actor: str
    module: str
    argv: tuple[str, ...]
    log: Path
    record: Path


class Child(Protocol):
    """A started process."""

    program: Program

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""

    @property
    def pid(self) -> int:
        """Its process id."""

    @property
    def sentinel(self) -> int:
        """A file descriptor that becomes readable when the process ends."""

    def send(self, number: signal.Signals) -> None:
        """Send a signal; one that has ended already is left alone."""


class Forked:
    """A child of the forkserver: it runs the very `main(argv)` that exec would run."""

    def __init__(self, program: Program, context: multiprocessing.context.ForkServerContext) -> None:
        self.program = program
        self._process: ForkServerProcess = context.Process(
            target=enter, args=(program.module, program.argv, program.log), name=program.actor
        )
        self._process.start()

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""
        return self._process.exitcode

    @property
    def pid(self) -> int:
        """Its process id."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def sentinel(self) -> int:
        """A file descriptor that becomes readable when the process ends."""
        return self._process.sentinel

    def send(self, number: signal.Signals) -> None:
        """Send a signal; one that has ended already is left alone."""
        if self.exit_code is None:
            _signal(self.pid, number)


class Executed:
    """A child started by exec, in a session of its own so that a terminal's Ctrl-C passes it by."""

    def __init__(self, program: Program) -> None:
        self.program = program
        with program.log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", program.module, *program.argv],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                cwd=Path(__file__).resolve().parent.parent,
            )
        self._sentinel = os.pidfd_open(self._process.pid)

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: the signal that ended it."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def sentinel(self) -> int:
        """A file descriptor that becomes readable when the process ends."""
        return self._sentinel

    def send(self, number: signal.Signals) -> None:
        """Send a signal; one that has ended already is left alone."""
        if self.exit_code is None:
            _signal(self.pid, number)


class Launcher:
    """Starts programs one way or the other."""

    def __init__(self, spawn: str) -> None:
        self._context: multiprocessing.context.ForkServerContext | None = None
        if spawn == "forkserver":
            self._context = multiprocessing.get_context("forkserver")
            self._context.set_forkserver_preload(["deploy.preload"])

    def start(self, program: Program) -> Child:
        """Start one program."""
        if self._context is None:
            return Executed(program)
        return Forked(program, self._context)

    def warm_up(self) -> None:
        """Have the forkserver import what it preloads, before anything depends on how long that takes.

        Must come before any Zenoh session in this process: a fork after one would hang.
        """
        if self._context is not None:
            process = self._context.Process(target=int)
            process.start()
            process.join()


def enter(module: str, argv: Sequence[str], log: Path) -> None:
    """What a forked child does instead of exec."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    open_log(log)
    sys.exit(importlib.import_module(f"{module}.__main__").main(argv))


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return
