"""Starts actor processes through a server that forks or executes them, and sees them end."""

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
from types import TracebackType
from typing import Any, Final, Protocol, Self

import msgspec

from actors.installation.repository import REPOSITORY
from actors.processes.confined import Part, ProcessStart
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
from actors.runtime import process_table, regular_file, typed_json
from actors.runtime.errors import AcrcError
from actors.runtime.isolation.sandbox import MESSAGE_LIMIT, Names
from actors.runtime.process_setup import SETUP, ActorSetup
from actors.runtime.process_table import ProcessGlance, passed_on, python
from actors.runtime.recording import read_notes

_ANSWER_S: Final = 300.0
"""Until the server starts a process; it may have to compile the kernels first. Own choice."""


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
    names: Names | None = None
    """Of a robot that is shut off: what is called otherwise in `argv`; None: nothing is."""
    setup: ActorSetup[Any, Any] | None = None
    """What its process reads, beside its log; None: it reads none."""

    def in_our_words(self, told: str) -> str:
        """What the program has said, its paths as they are called outside of its sandbox."""
        return told if self.names is None else self.names.outside_paths(told)


@dataclass
class Child:
    """A started process."""

    program: Program
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that ended it."""
    strays: int = 0
    """Processes that it had started, that ran on when it ended, and that have been ended since."""
    cpu_s: float = 0.0
    """Once it has ended: CPU time that the system charged for it, and for those that it has waited for."""

    def note(self, end: ProcessExited) -> None:
        """Take in that it has ended."""
        self.exit_code, self.strays, self.cpu_s = end.code, end.strays, end.cpu_s

    @property
    def host(self) -> str:
        """Name of the host that it runs on; empty: this computer."""
        return ""

    def notes(self) -> Mapping[str, str]:
        """What it has noted of itself by now, by name. Raises RecordingError."""
        assert self.program.record is not None
        return read_notes(self.program.record)

    def send(self, number: signal.Signals) -> None:
        """Send a signal; one that has ended already is left alone."""
        if self.exit_code is None:
            try:
                os.kill(self.pid, number)
            except ProcessLookupError:
                return


class Server(Protocol):
    """The process that starts a launcher's children, a child of this one."""

    @property
    def pid(self) -> int:
        """Its process id."""

    def kill(self) -> None:
        """End it at once."""

    def wait(self) -> int:
        """Wait for its end; the exit code, or less than 0: the signal that ended it."""


def write_setup(program: Program) -> None:
    """Write what the program reads. Raises LaunchError."""
    assert program.setup is not None
    file = program.log.parent / SETUP
    try:
        regular_file.write(file, typed_json.dump(program.setup))
    except OSError as error:
        raise LaunchError(f"{program.actor} is not started; {file}: {error.strerror}") from error


class Launcher:
    """Starts programs; a context manager that leaves nothing of its own behind.

    They are children of a small server (`actors.processes.forkserver`), which reaps them.
    """

    arriving: Final = False
    """No output of an ended program is still on its way: all is written on this computer."""

    def __init__(self, how: str, *, reap: bool = True) -> None:
        """`how`: fork or exec. `reap`: end what children leave running; not on board, where a process of the
        base's may outlive it."""
        self._reap = reap
        self._command = [*python(), "-m", "actors.processes.forkserver"]
        self._how = how
        self._children: dict[int, Child] = {}
        self._ended: dict[int, ProcessExited] = {}
        """Ends of children whose start has not been answered yet."""
        self._lost = False
        self.ready = False
        """True once the server has imported and compiled everything, so that a start takes no time."""

    def __enter__(self) -> Self:
        """Begin the server; only the first start waits until it is ready."""
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            whose = "reap" if self._reap else "spare"
            self._server = begin([*self._command, str(theirs.fileno()), self._how, whose], theirs)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self.ready:  # it is importing and compiling, for a run that will not be
            self._server.kill()
        self._channel.close()
        self._server.wait()
        if self._lost and self._reap:  # it has reaped nobody
            process_table.end_sessions(self._children)

    def fileno(self) -> int:
        """For `select`: readable when a child may have ended."""
        return self._channel.fileno()

    def fault(self) -> str | None:
        """Return why the run cannot go on because of a host; there is none here."""
        return None

    def table(self) -> Mapping[int, ProcessGlance]:
        """Return all processes that children may have started."""
        return process_table.table()

    def queued_s(self, pid: int) -> float | None:
        """Return a process's waiting time for a processor, s; None where that is unknown."""
        return process_table.queued_s(pid)

    def share(self, module: str, words: Sequence[str], folder: Path) -> None:
        """Let programs that are started later find the result of `share(*words)` of the module, if it forks.

        Files among the words are named as they lie in `folder`.
        """
        self._ask_about(folder, ShareData(module, tuple(words)))

    def withdraw(self, router: Path) -> None:
        """Remove what a router file names at the end, even if all others have been killed by then."""
        self._ask_about(router.parent, WithdrawRouter(router.name))

    def start(self, program: Program) -> Child:
        """Start one program; its set-up replaces an earlier start's file. Raises LaunchError."""
        if program.setup is not None:
            write_setup(program)
        self._ask(StartChild(program.names is not None))
        self._ask(ProcessStart(Part(program.module, program.argv), str(program.log), program.names))
        while not isinstance(reply := self._hear(), ChildStarted | StartRefused):
            pass
        if isinstance(reply, StartRefused):
            raise LaunchError(f"{program.actor} is not started; {reply.reason}")
        child = self._children[reply.pid] = Child(program, reply.pid)
        if end := self._ended.pop(child.pid, None):
            child.note(end)
        return child

    def wait(self, timeout_s: float) -> None:
        """Return when a child may have ended, at the latest after `timeout_s`, with all exit codes known.

        Raises LaunchError once if the server has ended; its children end with it.
        """
        if self._lost:
            time.sleep(timeout_s)
            self._look()
            return
        while select.select([self._channel], [], [], timeout_s)[0]:
            self._hear()
            timeout_s = 0.0

    def _ask_about(self, folder: Path, request: ShareData | WithdrawRouter) -> None:
        """Send a request with the descriptor of a folder, whose name the server must not know."""
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            self._ask(request, place)
        finally:
            os.close(place)

    def _ask(self, request: Request | ProcessStart, *descriptors: int) -> None:
        try:
            socket.send_fds(self._channel, [msgspec.json.encode(request)], descriptors)
        except BrokenPipeError:
            raise self._loss() from None

    def _hear(self) -> Reply:
        """Return the server's next message; note it if it is the end of a child."""
        if not select.select([self._channel], [], [], _ANSWER_S)[0]:
            self._server.kill()
            raise LaunchError(f"the forkserver has not answered within {_ANSWER_S:g} s and was ended")
        try:
            text = self._channel.recv(MESSAGE_LIMIT)
        except ConnectionResetError:
            text = b""
        if not text:
            raise self._loss()
        reply: Reply = msgspec.json.decode(text, type=Reply)
        self.ready = self.ready or isinstance(reply, ServerReady)
        if isinstance(reply, ProcessExited):
            if reply.pid in self._children:
                self._children[reply.pid].note(reply)
            else:
                self._ended[reply.pid] = reply
        return reply

    def _loss(self) -> LaunchError:
        self._lost = True
        code = self._server.wait()
        how = f"was ended by signal {signal.Signals(-code).name}" if code < 0 else f"has ended with {code}"
        return LaunchError(f"the forkserver {how}, and every process of the run with it")

    def _look(self) -> None:
        """Find out, without the server, which children are gone; their exit codes are lost."""
        for child in self._children.values():
            if child.exit_code is None:
                there = process_table.glance(child.pid)
                if there is None or there.state == "Z":
                    child.exit_code = -signal.SIGTERM


def begin(command: Sequence[str], channel: socket.socket) -> Server:
    """Start a server that has this end of the socket, in a session of its own."""
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        pass_fds=(channel.fileno(),),
        start_new_session=True,
        cwd=REPOSITORY,
        env=passed_on(os.environ),
    )


def launcher(spawn: str, *, reap: bool = True) -> Launcher:
    """Return a launcher for an option's `forkserver` or `exec`; for `reap` see Launcher."""
    return Launcher("fork" if spawn == "forkserver" else "exec", reap=reap)


_PROBE_BYTES: Final = 65536


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Make a folder that is removed at the end; its path without links.

    Raises AcrcError, with the folder's place, where what fails inside fails because nothing can be written
    there any more.
    """
    try:
        made = tempfile.TemporaryDirectory(prefix="acrc-")
    except OSError as error:
        raise _full(os.environ.get("TMPDIR", "/tmp"), reason(error)) from error
    with made as name:
        folder = Path(name).resolve()
        try:
            yield folder
        except (OSError, AcrcError) as error:
            why = write_fault(folder)
            if why is None:
                raise
            fault = _full(folder.parent, why)
            refused = isinstance(error, OSError) or isinstance(error.__cause__, OSError)
            raise (fault if refused else AcrcError(f"{error}; {fault}")) from error


def write_fault(folder: Path) -> str | None:
    """Why nothing can be written there, found out by trying; None if something can, or there is no folder."""
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
    """What the system says, to go on after a colon."""
    return (error.strerror or str(error)).lower()


def _full(where: object, why: str) -> AcrcError:
    return AcrcError(
        f"{where}: temporary files cannot be written: {why}; make room there, or set TMPDIR to another folder"
    )
