"""Server process that starts actors, reaps their orphans, and exits with its starter.

`python -m actors.processes.forkserver FD fork|exec reap|spare` serves `Request`s on a socket with `Reply`s.
StartChild is followed by a `ProcessStart`, which only the child reads: one actor's data must not be in the
memory of the next. `fork`: the server imports and compiles everything once, and forks children; `exec`: it
is small, and every child is a new interpreter. `spare`: do not kill processes that a child leaves running.
The server and its children exit when the other end of the socket closes. The standard library's forkserver
leaves a socket file, and keeps running when its parent is killed (docs/decisions).
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

from actors.processes.sandboxed_process import EntryPoint, ProcessStart, continue_sandboxed
from actors.runtime import process_table
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.mounts import survey
from actors.runtime.isolation.sandbox import MESSAGE_LIMIT
from actors.runtime.linux import (
    PR_SET_CHILD_SUBREAPER,
    PR_SET_PDEATHSIG,
    create_log,
    die_with_parent,
    prctl,
    redirect_output,
    set_title,
)
from actors.runtime.process_table import python_command

_GRACE_S: Final = 3.0
"""Time for actors to exit cleanly after the starter has exited."""


class StartChild(msgspec.Struct, frozen=True, tag=True):
    """Start a child; `is_sandboxed`: a sandboxed robot."""

    is_sandboxed: bool


class ShareData(msgspec.Struct, frozen=True, tag=True):
    """Keep the result of the module's `share(*words)` in memory for forked children.

    Sent with the descriptor of the folder of files named in `words`; no reply.
    """

    module: str
    words: tuple[str, ...]


class WithdrawRouter(msgspec.Struct, frozen=True, tag=True):
    """Remove the passwords and sockets that this router file names when the server exits.

    Sent with the descriptor of its folder; no reply.
    """

    name: str


class ServerReady(msgspec.Struct, frozen=True, tag=True):
    """The server has imported and compiled everything."""


class ChildStarted(msgspec.Struct, frozen=True, tag=True):
    """The child has a new log and is running."""

    pid: int


class StartRefused(msgspec.Struct, frozen=True, tag=True):
    """The child was not started."""

    reason: str


class ProcessExited(msgspec.Struct, frozen=True, tag=True):
    """A child has exited."""

    pid: int
    code: int
    """Negative: the signal that killed it."""
    orphans: int
    """Number of its child processes that survived it and were killed."""
    cpu_s: float
    """CPU time of the process and its waited-for children."""


Request = StartChild | ShareData | WithdrawRouter
Reply = ServerReady | ChildStarted | StartRefused | ProcessExited


class LogFile(NamedTuple):
    """Identity of a log, without its name, which would be in every child's memory."""

    device: int
    inode: int


_shared: Final[list[object]] = []
"""Shared data for children."""


class ForkServer:
    """Starts children on request and reports their exits."""

    def __init__(self, channel: socket.socket, *, forks: bool, reaps: bool) -> None:
        self._channel = channel
        self._forks = forks
        self._reaps = reaps
        self._actors: dict[int, LogFile] = {}
        """Log of each running child, by process id."""
        self._withdrawn: list[tuple[int, str]] = []
        """Router files with their folders' descriptors: no child may find a folder's name in memory."""
        self._wakeup_reader, self._wakeup_writer = os.pipe()
        self._entry_point: EntryPoint | None = None
        """In a child: its program."""

    def serve(self) -> EntryPoint | None:
        """Serve until the other end closes, then end all children. In a child: return its program."""
        os.set_blocking(self._wakeup_writer, False)
        signal.set_wakeup_fd(self._wakeup_writer, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        if self._reaps and sys.platform == "linux":
            prctl(PR_SET_CHILD_SUBREAPER, 1)  # inherit orphans of actors
        with selectors.DefaultSelector() as selector:
            selector.register(self._channel, selectors.EVENT_READ)
            selector.register(self._wakeup_reader, selectors.EVENT_READ)
            try:
                while all(self._handle_request(key.fd) for key, _ in selector.select()):
                    pass
            finally:
                if self._entry_point is None:
                    self._end_all()
                    self._withdraw()
        return self._entry_point

    def _handle_request(self, descriptor: int) -> bool:
        """Handle a request; return False once the other end is closed, and in a child."""
        if descriptor == self._wakeup_reader:
            os.read(self._wakeup_reader, 512)
            self._reap()
            return True
        try:
            message, folders, _, _ = socket.recv_fds(self._channel, MESSAGE_LIMIT, 1)
        except ConnectionResetError:
            return False
        if not message:
            return False
        match msgspec.json.decode(message, type=Request):
            case StartChild(is_sandboxed):
                self._entry_point = self._start(is_sandboxed=is_sandboxed)
            case ShareData() as request:
                self._create_shared(request, folders[0])
            case WithdrawRouter(name):
                self._withdrawn.append((folders[0], name))
        return self._entry_point is None

    def _create_shared(self, request: ShareData, folder: int) -> None:
        """Create shared data from files in a folder whose name is unknown to this process."""
        former_folder = os.open(".", os.O_RDONLY)
        os.fchdir(folder)
        if self._forks:
            with contextlib.suppress(AcrcError):  # the child that needs it tries again and reports the error
                _shared.append(importlib.import_module(request.module).share(*request.words))
                _freeze_heap()
        os.fchdir(former_folder)
        os.close(former_folder)
        os.close(folder)

    def _start(self, *, is_sandboxed: bool) -> EntryPoint | None:
        """Fork a child; in it, return its program."""
        server = os.getpid()
        log_reader, log_writer = os.pipe()
        try:
            pid = os.fork()
        except OSError as error:  # too many processes, or no memory
            self._channel.recv(MESSAGE_LIMIT)  # discard the child's start
            for descriptor in (log_reader, log_writer):
                os.close(descriptor)
            self._reply(StartRefused(f"fork: {error.strerror}"))
            return None
        if not pid:
            try:
                os.close(log_reader)
                return self._become_child(server, log_writer, is_sandboxed=is_sandboxed)
            except BaseException:  # the child must never return into the server's loop
                traceback.print_exc()
                os._exit(1)
        os.close(log_writer)
        log = os.read(log_reader, 100)
        os.close(log_reader)
        if log:
            self._actors[pid] = LogFile(*map(int, log.split()))
            self._reply(ChildStarted(pid))
        else:
            os.waitpid(pid, 0)  # it has sent StartRefused
        return None

    def _become_child(self, server: int, log_writer: int, *, is_sandboxed: bool) -> EntryPoint:
        """In a child: read its program, and close the server's descriptors."""
        die_with_parent(server, signal.SIGTERM)  # the setting survives exec
        os.setsid()  # leave the terminal's foreground group; the session identifies its children
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for descriptor in (
            self._wakeup_reader,
            self._wakeup_writer,
            *(folder for folder, _ in self._withdrawn),
        ):
            os.close(descriptor)
        if is_sandboxed and self._forks:
            return continue_sandboxed(
                lambda: self._receive_start(log_writer), server, (self._channel.fileno(), log_writer)
            )
        start = self._receive_start(log_writer)
        if is_sandboxed:
            return _sandboxed_program(start)
        _set_title(Path(start.log).stem)
        return start.entry_point

    def _receive_start(self, log_writer: int) -> ProcessStart:
        """In a child: receive its program, and redirect standard output and error to its log."""
        start = msgspec.json.decode(self._channel.recv(MESSAGE_LIMIT), type=ProcessStart)
        try:
            stream = create_log(Path(start.log))
        except OSError as error:
            self._reply(StartRefused(f"{start.log}: {error.strerror}"))
            os._exit(1)
        self._channel.close()
        found = os.fstat(stream)
        os.write(log_writer, f"{found.st_dev} {found.st_ino}".encode())
        os.close(log_writer)
        redirect_output(stream)
        return start

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
                orphans = process_table.kill_orphans(self._orphans(pid, log)) if self._reaps else 0
                cpu_s = usage.ru_utime + usage.ru_stime
                self._reply(ProcessExited(pid, os.waitstatus_to_exitcode(status), orphans, cpu_s))

    def _orphans(self, actor: int, log: LogFile) -> set[int]:
        """Return the children of this process that were started by `actor`, which has exited."""
        known = process_table.processes()
        own_children = process_table.children(os.getpid(), known) - set(self._actors)
        if not self._actors:
            return own_children  # no actor is left that could own them
        return {pid for pid in own_children if known[pid].session == actor or _writes_to(pid, log)}

    def _end_all(self) -> None:
        """Send SIGTERM to the actors, wait, and kill the rest."""
        for pid in self._actors:
            os.kill(pid, signal.SIGTERM)
        deadline = time.monotonic() + _GRACE_S
        while self._actors and time.monotonic() < deadline:
            self._reap()
            time.sleep(0.005)
        for pid in self._actors:
            os.kill(pid, signal.SIGKILL)
        if self._reaps:
            process_table.kill_orphans(process_table.children(os.getpid(), process_table.processes()))

    def _withdraw(self) -> None:
        """Remove passwords and sockets left behind by a killed router."""
        from actors.runtime.isolation import credentials  # noqa: PLC0415  # a server that executes stays small

        for folder, name in self._withdrawn:
            os.fchdir(folder)
            with contextlib.suppress(AcrcError):
                credentials.remove_router_file(Path(name))

    def _reply(self, message: Reply) -> None:
        try:
            self._channel.send(msgspec.json.encode(message))
        except (BrokenPipeError, ConnectionResetError):
            return  # the closed socket ends the loop


def _freeze_heap() -> None:
    from actors.runtime.process import freeze_heap  # noqa: PLC0415  # a server that executes stays small

    freeze_heap()


def _sandboxed_program(start: ProcessStart) -> EntryPoint:
    """Return the program that starts a robot in a new interpreter, which reads its start from a socket."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        ours.send(msgspec.json.encode(start))
    theirs.set_inheritable(True)
    return EntryPoint("actors.processes.sandboxed_process", (str(theirs.detach()),))


def _writes_to(pid: int, log: LogFile) -> bool:
    try:
        found = Path(f"/proc/{pid}/fd/1").stat()
    except OSError:
        return False
    return (found.st_dev, found.st_ino) == log


def _tie_to_starter(channel: socket.socket) -> None:
    """Exit immediately with the starter, until the socket is read."""
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    with contextlib.suppress(BlockingIOError):
        if channel.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b"":
            os._exit(0)


def _set_title(title: str) -> None:
    """Set the process name shown by ps and top, on Linux."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # without /proc the parent's name is kept
            set_title(f"acrc {title}")


def main(argv: Sequence[str]) -> int:
    """Preload if children are to be forked, then serve on the socket with the given descriptor."""
    descriptor, method, orphan_mode = argv
    forks = method == "fork"
    channel = socket.socket(fileno=int(descriptor))
    channel.set_inheritable(False)
    _tie_to_starter(channel)
    if forks:
        _set_title("forkserver")
        gc.disable()  # imported objects live forever
        importlib.import_module("actors.processes.preload")
        survey()
        gc.enable()
    server = ForkServer(channel, forks=forks, reaps=orphan_mode == "reap")
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, 0)  # from now on the closed socket shows it, which leaves time to clean up
    channel.send(msgspec.json.encode(ServerReady()))
    entry_point = server.serve()
    if entry_point is not None:
        channel.detach()  # a child has closed the descriptor
        del server, channel  # a child must have no reference to them
        _run(entry_point, forks=forks)
    channel.close()
    return 0


def _run(entry_point: EntryPoint, *, forks: bool) -> NoReturn:
    """In a child: call `main(argv)` of the module, or execute it in a new interpreter."""
    code = 1
    try:
        if not forks:  # `python -P -m MODULE ARGV…`: imports nothing from the working directory
            os.execv(sys.executable, [*python_command(), "-m", entry_point.module, *entry_point.argv])
        spec = importlib.util.find_spec(entry_point.module)
        is_package = spec is not None and spec.submodule_search_locations is not None
        code = importlib.import_module(entry_point.module + ".__main__" * is_package).main(entry_point.argv)
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
