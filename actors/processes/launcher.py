"""Start of actor processes by a server that forks or executes them, and notification of their exits."""

import os
import select
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, Self

import msgspec

from actors.installation.repository import REPOSITORY
from actors.processes.forkserver import (
    ChildStarted,
    ProcessExited,
    Reply,
    Request,
    ServerReady,
    ShareData,
    StartChild,
    StartRefused,
    WithdrawRouter,
)
from actors.processes.sandboxed_process import EntryPoint, ProcessStart
from actors.runtime import process_table, regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import MESSAGE_LIMIT, SandboxPaths
from actors.runtime.process_setup import SETUP, ActorSetup
from actors.runtime.process_table import ProcessState, child_environment, python_command

_ANSWER_S: Final = 300.0
"""Timeout for the start of a process; the server may have to compile the kernels first. Own choice."""


class LaunchError(AcrcError):
    """A process that could not be started."""


class Program(msgspec.Struct, frozen=True):
    """Command to run: `python -m MODULE ARGV…`, with its output redirected to a log."""

    actor: str
    module: str
    argv: tuple[str, ...]
    log: Path
    record: Path | None
    """MCAP file that it writes; None for an observer, whose failure does not end the run."""
    names: SandboxPaths | None = None
    """Paths of a sandboxed robot in `argv` that differ outside; None: no sandbox."""
    setup: ActorSetup[Any, Any] | None = None
    """Set-up file for the process, beside its log; None: no set-up."""

    def outside_text(self, output: str) -> str:
        """Return the program's output with sandbox paths replaced by the paths outside."""
        return output if self.names is None else self.names.outside_paths(output)


@dataclass
class ChildProcess:
    """A started process."""

    program: Program
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that killed it."""
    orphans: int = 0
    """Number of its child processes that survived it and were killed."""
    cpu_s: float = 0.0
    """After its exit: CPU time of the process and its waited-for children, s."""

    def note(self, end: ProcessExited) -> None:
        """Store its exit."""
        self.exit_code, self.orphans, self.cpu_s = end.code, end.orphans, end.cpu_s

    @property
    def host(self) -> str:
        """Name of its host; empty: this computer."""
        return ""

    def notes(self) -> Mapping[str, str]:
        """Return the notes in its recording so far, by name. Raises RecordingError."""
        from actors.runtime.recording import read_notes  # noqa: PLC0415  # the server starts earlier without it

        assert self.program.record is not None
        return read_notes(self.program.record)

    def send(self, number: signal.Signals) -> None:
        """Send a signal, unless the process has exited."""
        if self.exit_code is None:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return


class Server(Protocol):
    """The process that starts a launcher's children; a child of this process."""

    @property
    def pid(self) -> int:
        """Its process id."""

    def kill(self) -> None:
        """Kill it."""

    def wait(self) -> int:
        """Wait for its exit; return the exit code, or the negative signal that killed it."""


def write_setup(program: Program) -> None:
    """Write the program's set-up file. Raises LaunchError."""
    assert program.setup is not None
    file = program.log.parent / SETUP
    try:
        regular_file.write_atomically(file, typed_json.dump(program.setup))
    except OSError as error:
        raise LaunchError(f"{program.actor} cannot be started: {file}: {error.strerror}") from error


class Launcher:
    """Starts programs; a context manager that leaves no processes or files behind.

    They are children of a small server (`actors.processes.forkserver`), which reaps them.
    """

    arriving: Final = False
    """False: all output of exited programs is on this computer already."""

    def __init__(self, method: str, *, reap: bool = True) -> None:
        """Prepare the server.

        `method`: fork or exec. `reap`: kill processes that children leave running; not on a robot, where a
        process of the base may outlive it.
        """
        self._reap = reap
        self._command = [*python_command(), "-m", "actors.processes.forkserver"]
        self._method = method
        self._children: dict[int, ChildProcess] = {}
        self._early_exits: dict[int, ProcessExited] = {}
        """Exits of children whose start has not been acknowledged yet."""
        self._is_server_lost = False
        self.ready = False
        """True once the server has imported and compiled everything, so that starts take no time."""

    def __enter__(self) -> Self:
        """Start the server; only the first program waits until it is ready."""
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            orphan_mode = "reap" if self._reap else "spare"
            self._server = start_server(
                [*self._command, str(theirs.fileno()), self._method, orphan_mode], theirs
            )
        return self

    def __exit__(self, *_: object) -> None:
        if not self.ready:  # still importing and compiling, for a cancelled run
            self._server.kill()
        self._channel.close()
        self._server.wait()
        if self._is_server_lost and self._reap:  # it has not reaped its children
            process_table.kill_sessions(self._children)

    def fileno(self) -> int:
        """Return a descriptor for `select`: readable when a child may have exited."""
        return self._channel.fileno()

    def fault(self) -> str | None:
        """Return the fault of a host that ends the run; None: local launchers have no hosts."""
        return None

    def table(self) -> Mapping[int, ProcessState]:
        """Return all processes that children may have started."""
        return process_table.processes()

    def queued_s(self, pid: int) -> float | None:
        """Return how long a process waited for a processor, s; None if unknown."""
        return process_table.queued_s(pid)

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Let programs started later share the result of the module's `share(*words)`, if the server forks.

        `words` name files relative to `folder`.
        """
        self._send_with_folder(folder, ShareData(module, tuple(words)))

    def withdraw(self, router: Path) -> None:
        """Remove at the end everything that a router file names, even if all other processes were killed."""
        self._send_with_folder(router.parent, WithdrawRouter(router.name))

    def start(self, program: Program) -> ChildProcess:
        """Start a program; its set-up replaces the file of an earlier start. Raises LaunchError."""
        if program.setup is not None:
            write_setup(program)
        self._send(StartChild(program.names is not None))
        self._send(ProcessStart(EntryPoint(program.module, program.argv), str(program.log), program.names))
        while not isinstance(reply := self._receive(), ChildStarted | StartRefused):
            pass
        if isinstance(reply, StartRefused):
            raise LaunchError(f"{program.actor} cannot be started: {reply.reason}")
        child = self._children[reply.pid] = ChildProcess(program, reply.pid)
        if end := self._early_exits.pop(child.pid, None):
            child.note(end)
        return child

    def wait(self, timeout_s: float) -> None:
        """Wait until a child may have exited, at most `timeout_s`; then all exit codes are known.

        Raises LaunchError once if the server has exited; its children exit with it.
        """
        if self._is_server_lost:
            time.sleep(timeout_s)
            self._mark_exited()
            return
        while select.select([self._channel], [], [], timeout_s)[0]:
            self._receive()
            timeout_s = 0.0

    def _send_with_folder(self, folder: Path, request: ShareData | WithdrawRouter) -> None:
        """Send a request with the descriptor of a folder, whose name must stay unknown to the server."""
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            self._send(request, descriptor)
        finally:
            os.close(descriptor)

    def _send(self, request: Request | ProcessStart, *descriptors: int) -> None:
        try:
            socket.send_fds(self._channel, [msgspec.json.encode(request)], descriptors)
        except BrokenPipeError:
            raise self._loss_error() from None

    def _receive(self) -> Reply:
        """Return the server's next message; store it if it is a child's exit."""
        if not select.select([self._channel], [], [], _ANSWER_S)[0]:
            self._server.kill()
            raise LaunchError(f"the forkserver did not respond within {_ANSWER_S:g} s and was killed")
        try:
            text = self._channel.recv(MESSAGE_LIMIT)
        except ConnectionResetError:
            text = b""
        if not text:
            raise self._loss_error()
        reply: Reply = msgspec.json.decode(text, type=Reply)
        self.ready = self.ready or isinstance(reply, ServerReady)
        if isinstance(reply, ProcessExited):
            if reply.pid in self._children:
                self._children[reply.pid].note(reply)
            else:
                self._early_exits[reply.pid] = reply
        return reply

    def _loss_error(self) -> LaunchError:
        self._is_server_lost = True
        code = self._server.wait()
        method = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"exited with code {code}"
        return LaunchError(f"the forkserver {method}, which ended all processes of the run")

    def _mark_exited(self) -> None:
        """Mark exited children without the server; their exit codes are lost."""
        for child in self._children.values():
            if child.exit_code is None:
                state = process_table.process_state(child.pid)
                if state is None or state.state == "Z":
                    child.exit_code = -signal.SIGTERM


def start_server(command: Sequence[str], channel: socket.socket) -> Server:
    """Start a server with this end of the socket, in a new session."""
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=(channel.fileno(),),
        start_new_session=True,
        cwd=REPOSITORY,
        env=child_environment(os.environ),
    )


def create_launcher(spawn: str, *, reap: bool = True) -> Launcher:
    """Return a launcher for the option value `forkserver` or `exec`; see Launcher for `reap`."""
    return Launcher("fork" if spawn == "forkserver" else "exec", reap=reap)


_PROBE_BYTES: Final = 65536


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield the path, without links, of a temporary folder that is removed at the end.

    Raises AcrcError with the folder's path if the body fails because the disk is full.
    """
    try:
        temporary = tempfile.TemporaryDirectory(prefix="acrc-")
    except OSError as error:
        raise _write_error(os.environ.get("TMPDIR", "/tmp"), reason(error)) from error
    with temporary as name:
        folder = Path(name).resolve()
        try:
            yield folder
        except (OSError, AcrcError) as error:
            cause = write_fault(folder)
            if cause is None:
                raise
            fault = _write_error(folder.parent, cause)
            is_write_error = isinstance(error, OSError) or isinstance(error.__cause__, OSError)
            raise (fault if is_write_error else AcrcError(f"{error}; {fault}")) from error


def write_fault(folder: Path) -> str | None:
    """Return why nothing can be written to a folder, by trying; None: writable, or no such folder."""
    if not folder.is_dir():
        return None
    probe = folder / f".probe-{os.getpid()}"
    try:
        with probe.open("xb") as file:
            file.write(bytes(_PROBE_BYTES))
    except OSError as error:
        return reason(error)
    finally:
        with suppress(OSError):
            probe.unlink()
    return None


def reason(error: OSError) -> str:
    """Return the system's error message in lower case, to follow a colon."""
    return (error.strerror or str(error)).lower()


def _write_error(where: object, cause: str) -> AcrcError:
    return AcrcError(f"{where}: temporary files cannot be written: {cause}; free space there, or set TMPDIR")
