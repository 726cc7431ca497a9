"""Starts actor processes, by a forkserver with everything preloaded or by exec, and sees them end."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from actors.runtime.environment import passed_on
from actors.runtime.errors import AcrcError
from actors.runtime.log import create_log
from deploy.forkserver import MESSAGE_LIMIT

ROOT = Path(__file__).resolve().parent.parent
"""Where the packages are, so that `python -m` finds them from any working directory."""


class LaunchError(AcrcError):
    """A process that could not be started."""


@dataclass(frozen=True)
class Program:
    """What one would type: `python -m MODULE ARGV…`, with the output going to a log."""

    actor: str
    module: str
    argv: tuple[str, ...]
    log: Path
    record: Path | None
    """The MCAP file that it writes; None for an observer, without which a run goes on."""


@dataclass
class Child:
    """A started process."""

    program: Program
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that ended it."""

    def send(self, number: signal.Signals) -> None:
        """Send a signal; one that has ended already is left alone."""
        if self.exit_code is None:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return


class Launcher(Protocol):
    """Starts programs; a context manager that leaves nothing of its own behind."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def start(self, program: Program) -> Child:
        """Start one program."""

    def wait(self, timeout_s: float) -> None:
        """Return when a child may have ended, at the latest after `timeout_s`, with all exit codes known."""


class ForkLauncher:
    """Children of a forkserver: each runs the very `main(argv)` that exec would run."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._server = subprocess.Popen(
                [sys.executable, "-m", "deploy.forkserver", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
                cwd=ROOT,
                env=passed_on(os.environ),
            )
        self._children: dict[int, Child] = {}
        self._codes: dict[int, int] = {}

    def __enter__(self) -> Self:
        while "ready" not in self._hear():
            pass
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._channel.close()
        self._server.wait()

    def start(self, program: Program) -> Child:
        """Start one program."""
        request = {"start": [program.module, program.argv, str(program.log)]}
        self._channel.send(json.dumps(request).encode())
        while "started" not in (answer := self._hear()):
            pass
        child = Child(program, answer["started"])
        child.exit_code = self._codes.pop(child.pid, None)
        self._children[child.pid] = child
        return child

    def wait(self, timeout_s: float) -> None:
        """Return when a child may have ended, at the latest after `timeout_s`, with all exit codes known."""
        while select.select([self._channel], [], [], timeout_s)[0]:
            self._hear()
            timeout_s = 0.0

    def _hear(self) -> dict[str, int]:
        """The server's next message; the end of a child is noted on the way."""
        try:
            text = self._channel.recv(MESSAGE_LIMIT)
        except ConnectionResetError:
            text = b""
        if not text:
            raise LaunchError(
                f"the forkserver has ended with exit code {self._server.wait()}; what it said stands above"
            )
        message: dict[str, int] = json.loads(text)
        if "ended" in message:
            child = self._children.get(message["ended"])
            if child is None:
                self._codes[message["ended"]] = message["code"]
            else:
                child.exit_code = message["code"]
        return message


class ExecLauncher:
    """Children by exec, in a session of their own so that a terminal's Ctrl-C passes them by."""

    def __init__(self, before: Sequence[str] = ()) -> None:
        """`before`: words in front of every command, such as `unshare --net`; must end in exec."""
        self._before = before
        self._running: list[tuple[Child, subprocess.Popen[bytes]]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def start(self, program: Program) -> Child:
        """Start one program."""
        log = create_log(program.log)
        try:
            process = subprocess.Popen(
                [*self._before, sys.executable, "-m", program.module, *program.argv],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
                cwd=ROOT,
                env=passed_on(os.environ),
            )
        finally:
            os.close(log)
        child = Child(program, process.pid)
        self._running.append((child, process))
        return child

    def wait(self, timeout_s: float) -> None:
        """Return when a child may have ended, at the latest after `timeout_s`, with all exit codes known."""
        if hasattr(os, "pidfd_open"):
            _await_any([process.pid for _, process in self._running], timeout_s)
        for child, process in self._running:
            child.exit_code = process.poll()
        self._running = [(child, process) for child, process in self._running if child.exit_code is None]


def launcher(spawn: str) -> Launcher:
    """`forkserver` or `exec`."""
    return ForkLauncher() if spawn == "forkserver" else ExecLauncher()


def _await_any(pids: Sequence[int], timeout_s: float) -> None:
    descriptors = [os.pidfd_open(pid) for pid in pids]
    try:
        select.select(descriptors, [], [], timeout_s)
    finally:
        for descriptor in descriptors:
            os.close(descriptor)
