"""A process that starts the actors, reaps what they leave, and ends with its starter.

`python -m actors.processes.forkserver FD fork|exec reap|spare` serves on a socket: `Request`s in, `Reply`s
out. StartChild is followed by a `ProcessStart`, which only the child reads: what one actor is told
must not be in the memory of the next one. `fork`: the server has imported and compiled everything once, and
forks from there; `exec`: it is small, and every child is a new interpreter. `spare`: processes that a child
has started are left alone when it ends. The server ends, and its children with it, when the other end of the
socket closes. The standard library's forkserver leaves a socket file and keeps running when its parent is
killed, see docs/decisions.
"""

import contextlib
import gc
import importlib
import importlib.util
import os
import selectors
import signal
import socket
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple, NoReturn

import msgspec

from actors.processes.confined import Part, ProcessStart, born
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import MESSAGE_LIMIT
from actors.runtime.linux import (
    PR_SET_CHILD_SUBREAPER,
    PR_SET_PDEATHSIG,
    create_log,
    prctl,
    set_title,
    write_to,
)
from actors.runtime.process_table import python

_GRACE_S: Final = 3.0
"""Time for actors to end in order once the starter is gone."""


class StartChild(msgspec.Struct, frozen=True, tag=True):
    """Start a child; `confined`: a sandboxed robot."""

    confined: bool


class ShareData(msgspec.Struct, frozen=True, tag=True):
    """Hold the result of `share(*words)` of the module, so that forked children find it in memory.

    Comes with the descriptor of the folder in which the words name files; has no reply.
    """

    module: str
    words: tuple[str, ...]


class WithdrawRouter(msgspec.Struct, frozen=True, tag=True):
    """Remove, at the server's end, what this router file names: passwords and sockets of a run.

    Comes with the descriptor of its folder; has no reply.
    """

    name: str


class ServerReady(msgspec.Struct, frozen=True, tag=True):
    """The server has imported and compiled everything."""


class ChildStarted(msgspec.Struct, frozen=True, tag=True):
    """The child has a new log, and begins."""

    pid: int


class StartRefused(msgspec.Struct, frozen=True, tag=True):
    """No child was started."""

    reason: str


class ProcessExited(msgspec.Struct, frozen=True, tag=True):
    """A child has ended."""

    pid: int
    code: int
    """Negative: the signal that ended it."""
    strays: int
    """Processes that it had started, that outlived it, and that have been ended."""
    cpu_s: float
    """CPU time that the system charged for it and for what it has waited for."""


Request = StartChild | ShareData | WithdrawRouter
Reply = ServerReady | ChildStarted | StartRefused | ProcessExited


class LogFile(NamedTuple):
    """Identity of a log; not its name, which every child would find in memory."""

    device: int
    inode: int


_shared: Final[list[object]] = []
"""Held for children."""


class ForkServer:
    """Starts children on request and reports their ends."""

    def __init__(self, channel: socket.socket, *, forks: bool, reaps: bool) -> None:
        self._channel = channel
        self._forks = forks
        self._reaps = reaps
        self._actors: dict[int, LogFile] = {}
        """Log of each running child, by process id."""
        self._withdrawn: list[tuple[int, str]] = []
        """Router files by the descriptor of their folder, for no child may find its name in memory."""
        self._alarm_out, self._alarm_in = os.pipe()
        self._part: Part | None = None
        """In a child: its program."""

    def serve(self) -> Part | None:
        """Start on request until the other end closes; then end everything. In a child: its program."""
        os.set_blocking(self._alarm_in, False)
        signal.set_wakeup_fd(self._alarm_in, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        if self._reaps and sys.platform == "linux":
            prctl(PR_SET_CHILD_SUBREAPER, 1)  # orphans of an actor become children of this process
        with selectors.DefaultSelector() as selector:
            selector.register(self._channel, selectors.EVENT_READ)
            selector.register(self._alarm_out, selectors.EVENT_READ)
            try:
                while all(self._answer(key.fd) for key, _ in selector.select()):
                    pass
            finally:
                if self._part is None:
                    self._end_all()
                    self._withdraw()
        return self._part

    def _answer(self, descriptor: int) -> bool:
        """Carry out what is asked for; False once the other end is closed, and in a child."""
        if descriptor == self._alarm_out:
            os.read(self._alarm_out, 512)
            self._reap()
            return True
        try:
            message, folders, _, _ = socket.recv_fds(self._channel, MESSAGE_LIMIT, 1)
        except ConnectionResetError:
            return False
        if not message:
            return False
        match msgspec.json.decode(message, type=Request):
            case StartChild(confined):
                self._part = self._start(confined=confined)
            case ShareData() as asked:
                self._hold(asked, folders[0])
            case WithdrawRouter(name):
                self._withdrawn.append((folders[0], name))
        return self._part is None

    def _hold(self, asked: ShareData, folder: int) -> None:
        """Make what is to be shared, from files whose folder has no name here."""
        here = os.open(".", os.O_RDONLY)
        os.fchdir(folder)
        if self._forks:
            with contextlib.suppress(AcrcError):  # the child that needs it makes it, and reports the error
                _shared.append(importlib.import_module(asked.module).share(*asked.words))
                _settle()
        os.fchdir(here)
        os.close(here)
        os.close(folder)

    def _start(self, *, confined: bool) -> Part | None:
        """Fork a child; in it, return its program."""
        server = os.getpid()
        told, tell = os.pipe()
        try:
            pid = os.fork()
        except OSError as error:  # no more processes, or no memory for one
            self._channel.recv(MESSAGE_LIMIT)  # the child's
            for descriptor in (told, tell):
                os.close(descriptor)
            self._reply(StartRefused(f"fork: {error.strerror}"))
            return None
        if not pid:
            try:
                os.close(told)
                return self._become(server, tell, confined=confined)
            except BaseException:  # the child must never return into the server's loop
                traceback.print_exc()
                os._exit(1)
        os.close(tell)
        log = os.read(told, 100)
        os.close(told)
        if log:
            self._actors[pid] = LogFile(*map(int, log.split()))
            self._reply(ChildStarted(pid))
        else:
            os.waitpid(pid, 0)  # it has replied
        return None

    def _become(self, server: int, tell: int, *, confined: bool) -> Part:
        """In a child: read its program, and let go of the server's descriptors."""
        _tie_to(server)
        os.setsid()  # not in the terminal's foreground group; its own processes are known by the session
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for descriptor in (self._alarm_out, self._alarm_in, *(folder for folder, _ in self._withdrawn)):
            os.close(descriptor)
        if confined and self._forks:
            return born(lambda: self._told(tell), server, (self._channel.fileno(), tell))
        told = self._told(tell)
        if confined:
            return _elsewhere(told)
        _show(Path(told.log).stem)
        return told.part

    def _told(self, tell: int) -> ProcessStart:
        """In a child: receive its program; from here on standard output and error lead to its log."""
        told = msgspec.json.decode(self._channel.recv(MESSAGE_LIMIT), type=ProcessStart)
        try:
            stream = create_log(Path(told.log))
        except OSError as error:
            self._reply(StartRefused(f"{told.log}: {error.strerror}"))
            os._exit(1)
        self._channel.close()
        found = os.fstat(stream)
        os.write(tell, f"{found.st_dev} {found.st_ino}".encode())
        os.close(tell)
        write_to(stream)
        return told

    def _reap(self) -> None:
        while True:
            try:
                pid, status, usage = os.wait4(-1, os.WNOHANG)
            except ChildProcessError:
                return
            if pid == 0:
                return
            log = self._actors.pop(pid, None)
            if log is not None:
                strays = process_table.end_orphans(self._orphans(pid, log)) if self._reaps else 0
                cpu_s = usage.ru_utime + usage.ru_stime
                self._reply(ProcessExited(pid, os.waitstatus_to_exitcode(status), strays, cpu_s))

    def _orphans(self, actor: int, log: LogFile) -> set[int]:
        """Return the children of this process that `actor`, which has ended, had started."""
        known = process_table.table()
        own = process_table.children(os.getpid(), known) - set(self._actors)
        if not self._actors:
            return own  # the last actor has ended: they can be no one else's
        return {pid for pid in own if known[pid].session == actor or _writes_to(pid, log)}

    def _end_all(self) -> None:
        """Terminate the actors, wait, and kill what is left."""
        for pid in self._actors:
            os.kill(pid, signal.SIGTERM)
        deadline = time.monotonic() + _GRACE_S
        while self._actors and time.monotonic() < deadline:
            self._reap()
            time.sleep(0.005)
        for pid in self._actors:
            os.kill(pid, signal.SIGKILL)
        if self._reaps:
            process_table.end_orphans(process_table.children(os.getpid(), process_table.table()))

    def _withdraw(self) -> None:
        """Remove passwords and sockets that a killed router and a killed starter have left."""
        from actors.runtime.isolation import credentials  # noqa: PLC0415  # a server that executes stays small

        for folder, name in self._withdrawn:
            os.fchdir(folder)
            with contextlib.suppress(AcrcError):
                credentials.remove_router_file(Path(name))

    def _reply(self, message: Reply) -> None:
        try:
            self._channel.send(msgspec.json.encode(message))
        except (BrokenPipeError, ConnectionResetError):
            return  # the next request is the end of the socket


def _settle() -> None:
    from actors.runtime.process import settle  # noqa: PLC0415  # a server that executes stays small

    settle()


def _elsewhere(told: ProcessStart) -> Part:
    """Return the program that makes a robot in a new interpreter, with its start waiting on a socket."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        ours.send(msgspec.json.encode(told))
    theirs.set_inheritable(True)
    return Part("actors.processes.confined", (str(theirs.detach()),))


def _writes_to(pid: int, log: LogFile) -> bool:
    try:
        found = Path(f"/proc/{pid}/fd/1").stat()
    except OSError:
        return False
    return (found.st_dev, found.st_ino) == log


def _tie_to(parent: int) -> None:
    """End by SIGTERM as soon as the parent does; the setting outlives exec (prctl(2), PR_SET_PDEATHSIG)."""
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent:
            os._exit(1)


def _tie_to_starter(channel: socket.socket) -> None:
    """End at once with the starter, for as long as the socket is not read."""
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    with contextlib.suppress(BlockingIOError):
        if channel.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b"":
            os._exit(0)


def _show(title: str) -> None:
    """Show ps and top which process this is, on Linux."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # without /proc it keeps its parent's name
            set_title(f"acrc {title}")


def main(argv: Sequence[str]) -> int:
    """Preload if children are to be forked, then serve on the socket whose descriptor is given."""
    descriptor, how, whose = argv
    forks = how == "fork"
    channel = socket.socket(fileno=int(descriptor))
    channel.set_inheritable(False)
    _tie_to_starter(channel)
    if forks:
        _show("forkserver")
        gc.disable()  # everything that is imported stays
        importlib.import_module("actors.processes.preload")
        gc.enable()
    server = ForkServer(channel, forks=forks, reaps=whose == "reap")
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, 0)  # from here on the end of the socket shows it, and leaves time
    channel.send(msgspec.json.encode(ServerReady()))
    part = server.serve()
    if part is not None:
        channel.detach()  # a child has closed the descriptor
        del server, channel  # a child must find no reference to them
        _run(part, forks=forks)
    channel.close()
    return 0


def _run(part: Part, *, forks: bool) -> NoReturn:
    """In a child: call `main(argv)` of the module, or execute it in a new interpreter."""
    code = 1
    try:
        if not forks:  # as `python -P -m MODULE ARGV…`: no module of the working directory is found
            os.execv(sys.executable, [*python(), "-m", part.module, *part.argv])
        spec = importlib.util.find_spec(part.module)
        is_package = spec is not None and spec.submodule_search_locations is not None
        code = importlib.import_module(part.module + ".__main__" * is_package).main(part.argv)
    except SystemExit as leave:
        code = leave.code if isinstance(leave.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
