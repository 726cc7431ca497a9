"""The forkserver of a run that a warm command makes: a fork of the command, which has imported all of it.

Importing and compiling the same a second time takes longer than most of these runs. What begins a server anew
is shown by the tests that start `acrc` in an interpreter of its own (`tests.swarm.command.start`).
"""

import os
import signal
import socket
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NoReturn

from actors.installation.repository import REPOSITORY
from actors.processes import forkserver, launch
from actors.runtime.lifecycle.environment import passed_on

BEGIN: Final = launch.begin
"""What begins a server in an interpreter of its own."""


class Forked:
    """A child of this process, as subprocess.Popen is one."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._code: int | None = None

    def kill(self) -> None:
        if self._code is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> int:
        if self._code is None:
            _, status = os.waitpid(self.pid, 0)
            self._code = os.waitstatus_to_exitcode(status)
        return self._code


def serve_warm(places: Sequence[str]) -> None:
    """Let the servers of this process that fork be forks of it; `places`: where modules are."""

    def begin(command: Sequence[str], channel: socket.socket) -> launch.Server:
        *_, how, whose = command
        # Who did not ask for new interpreters has one only as it is there sooner than a server that forks.
        forks = how == "fork" or (whose == "reap" and "--spawn" not in sys.argv)
        threads = len(list(Path("/proc/self/task").iterdir()))  # after a session was opened no fork would do
        if command[0] != sys.executable or not forks or threads > 1:
            return BEGIN(command, channel)
        sys.stdout.flush()
        sys.stderr.flush()
        pid = os.fork()
        if pid == 0:
            be_server(channel.fileno(), ["fork", whose], places)
        return Forked(pid)

    launch.begin = begin


def be_server(channel: int, words: Sequence[str], places: Sequence[str]) -> NoReturn:
    """Be the server from here on, with no more of the command's than a new interpreter would have."""
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # no loop: strategies of tests look at frames' values
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        os.setsid()
        with Path(os.devnull).open("r+b", buffering=0) as nothing:
            for stream in (0, 1):
                os.dup2(nothing.fileno(), stream)
        os.closerange(3, channel)
        os.closerange(channel + 1, os.sysconf("SC_OPEN_MAX"))
        os.chdir(REPOSITORY)
        told = passed_on(os.environ)
        os.environ.clear()
        os.environ.update(told)
        named = [place for place in told.get("PYTHONPATH", "").split(os.pathsep) if place]
        sys.path[:] = [*named, *places]
        code = forkserver.main([str(channel), *words])
    except BaseException:  # the child must never return into the command
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)
