"""A process that starts the actors, reaps whatever they leave, and ends with whoever started it.

`python -m actors.processes.forkserver FD fork|exec reap|spare` serves on a socket. `{"start": kind}` is
followed by a second message, `{module, argv, log, names}`, which only the child reads: what one actor is told
must not be in the memory of the next one. The answer is `{"started": pid}`, or `{"refused": why}` where the
log is no new file, and the end of a child is told as `{"ended": pid, "code": code, "strays": n, "cpu_s": s}`:
n processes that the child had started outlived it and have been ended (`reap`; `spare` leaves them alone),
and s is the CPU time that the system charged for it and for what it has waited for. Kinds are
`plain` and `confined`, a robot that is shut off (see `confined`). `fork`: the server has imported and
compiled everything once, and forks from there; `exec`: it is small, and every child begins anew. To
`{"share": [module, words]}`, sent with the descriptor of a folder in which the words name files, and which
nothing answers, a server that forks makes what `share(*words)` of the module gives and holds it, so that
children find it in memory. `{"withdraw": name}`, sent in the same way, names a router file: the passwords and
sockets of a run, which the server removes at its end if they are still there. It ends, and its children, when
the other end of the socket closes. The standard library's forkserver leaves a socket file and keeps running
when its parent is killed, see docs/decisions.
"""

import contextlib
import gc
import importlib
import importlib.util
import json
import os
import selectors
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn

from actors.processes.confined import Part, born
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
"""How long an actor may take to end in order once whoever wanted it is gone."""
Share = Callable[[str, Sequence[str]], object]
"""What children are to share: module, words."""


class LogFile(NamedTuple):
    """Which file a log is; not its name, which every child would find in memory."""

    device: int
    inode: int


class ForkServer:
    """Starts children on request and tells of their ends."""

    def __init__(
        self, channel: socket.socket, share: Share | None, shared: list[object], *, reap: bool
    ) -> None:
        """`share`: makes what children are to share, and it is put into `shared`; None: they execute anew."""
        self._channel = channel
        self._share = share
        self._shared = shared
        self._reaps = reap
        self._actors: dict[int, LogFile] = {}
        """The log of each child that runs, by process id."""
        self._withdrawn: list[tuple[int, str]] = []
        """Router files by the descriptor of their folder, for no child may find its name in memory; what they
        name is removed at the end if nobody has done so."""
        self._alarm_out, self._alarm_in = os.pipe()
        self._part: Part | None = None
        """In a child: what it is to become."""

    def serve(self) -> Part | None:
        """Start on request until the other end closes; then end everything. In a child: what it is."""
        os.set_blocking(self._alarm_in, False)
        signal.set_wakeup_fd(self._alarm_in, warn_on_full_buffer=False)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)
        if self._reaps and sys.platform == "linux":
            prctl(PR_SET_CHILD_SUBREAPER, 1)  # what an actor's process leaves behind falls to this one
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
        """Do what is asked for; False once nobody is there to ask, and in a child."""
        if descriptor == self._alarm_out:
            os.read(self._alarm_out, 512)
            self._reap()
            return True
        try:
            request, folders, _, _ = socket.recv_fds(self._channel, MESSAGE_LIMIT, 1)
        except ConnectionResetError:
            return False
        if not request:
            return False
        asked = json.loads(request)
        if "withdraw" in asked:
            self._withdrawn.append((*folders, asked["withdraw"]))
            return True
        if "share" in asked:
            self._hold(asked["share"], *folders)
            return True
        self._part = self._start(confined=asked["start"] == "confined")
        return self._part is None

    def _hold(self, asked: tuple[str, Sequence[str]], folder: int) -> None:
        """Make what is to be shared, from files whose folder has no name here."""
        here = os.open(".", os.O_RDONLY)
        os.fchdir(folder)
        if self._share is not None:
            with contextlib.suppress(AcrcError):  # whoever needs it makes it, and says what is wrong
                self._shared.append(self._share(*asked))
        os.fchdir(here)
        os.close(here)
        os.close(folder)

    def _start(self, *, confined: bool) -> Part | None:
        """Fork a child; in it, what it is to become."""
        server = os.getpid()
        told, tell = os.pipe()
        try:
            pid = os.fork()
        except OSError as error:  # no more processes, or no memory for one
            self._channel.recv(MESSAGE_LIMIT)  # what it was to be told
            for descriptor in (told, tell):
                os.close(descriptor)
            self._tell({"refused": f"fork: {error.strerror}"})
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
            self._tell({"started": pid})
        else:
            os.waitpid(pid, 0)  # it has said why
        return None

    def _become(self, server: int, tell: int, *, confined: bool) -> Part:
        """In a child: find out what it is to be, and let go of the server's things."""
        _tie_to(server)
        os.setsid()  # a terminal's Ctrl-C passes it by, and what it starts is known by the session
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        for descriptor in (self._alarm_out, self._alarm_in, *(folder for folder, _ in self._withdrawn)):
            os.close(descriptor)
        if confined and self._share is not None:
            channel = self._channel.fileno()
            return born(lambda: json.loads(self._told(tell)), server, (channel, tell))
        message = self._told(tell)
        if confined:
            return _elsewhere(message)
        request = json.loads(message)
        _show(Path(request["log"]).stem)
        return Part(request["module"], tuple(request["argv"]))

    def _told(self, tell: int) -> bytes:
        """In a child: the request; from here on standard output and error lead to its log."""
        message = self._channel.recv(MESSAGE_LIMIT)
        log = json.loads(message)["log"]
        try:
            stream = create_log(Path(log))
        except OSError as error:
            self._tell({"refused": f"{log}: {error.strerror}"})
            os._exit(1)
        self._channel.close()
        found = os.fstat(stream)
        os.write(tell, f"{found.st_dev} {found.st_ino}".encode())
        os.close(tell)
        write_to(stream)
        return message

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
                code = os.waitstatus_to_exitcode(status)
                cpu_s = usage.ru_utime + usage.ru_stime
                self._tell({"ended": pid, "code": code, "strays": strays, "cpu_s": cpu_s})

    def _orphans(self, actor: int, log: LogFile) -> set[int]:
        """What `actor`, which has ended, had started and has fallen to this process."""
        known = process_table.table()
        own = process_table.children(os.getpid(), known) - set(self._actors)
        if not self._actors:
            return own  # the last one to end: nobody is left whose it could be
        return {pid for pid in own if known[pid].session == actor or _writes_to(pid, log)}

    def _end_all(self) -> None:
        """Ask the actors to end, give them time, and end whatever is left."""
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
        """Remove passwords and sockets that the router and whoever started it were killed too fast to."""
        from actors.runtime.isolation import credentials  # noqa: PLC0415  # a server that executes stays small

        for folder, name in self._withdrawn:
            os.fchdir(folder)
            with contextlib.suppress(AcrcError):
                credentials.remove_router_file(Path(name))

    def _tell(self, message: dict[str, Any]) -> None:
        try:
            self._channel.send(json.dumps(message).encode())
        except (BrokenPipeError, ConnectionResetError):
            return  # nobody is there any more: the next request is the end of the socket


def enter(part: Part) -> int:
    """Run `main(argv)` of the module, or of a package's `__main__`, as exec would; its exit code."""
    code: int = importlib.import_module(_program(part.module)).main(part.argv)
    return code


def share(module: str, words: Sequence[str]) -> object:
    """What `share(*words)` of the module gives, where no collection will touch it, which would copy it."""
    from actors.runtime.process import settle  # noqa: PLC0415  # a server that executes stays small

    shared: object = importlib.import_module(module).share(*words)
    settle()
    return shared


def execute(part: Part) -> int:
    """Become `python -P -m MODULE ARGV…`: what lies where it begins is no code."""
    os.execv(sys.executable, [*python(), "-m", part.module, *part.argv])


def _elsewhere(message: bytes) -> Part:
    """The program that makes a robot in a process of its own, with the request waiting for it."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours:
        ours.send(message)
    theirs.set_inheritable(True)
    return Part("actors.processes.confined", (str(theirs.detach()),))


def _program(module: str) -> str:
    """What `python -m module` executes."""
    spec = importlib.util.find_spec(module)
    is_package = spec is not None and spec.submodule_search_locations is not None
    return f"{module}.__main__" if is_package else module


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


def _show(title: str) -> None:
    """Let ps and top say which process this is; wholly on Linux, and nowhere else."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):  # without /proc it goes by its parent's
            set_title(f"acrc {title}")


def _tie_to_starter(channel: socket.socket) -> None:
    """End at once with whoever started this process; for as long as the socket is not listened to."""
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    try:
        gone = channel.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        gone = False
    if gone:
        os._exit(0)


def main(argv: Sequence[str]) -> int:
    """Preload if children are to be forked, then serve on the socket whose descriptor is given."""
    descriptor, how, whose = argv
    channel = socket.socket(fileno=int(descriptor))
    channel.set_inheritable(False)
    _tie_to_starter(channel)
    if how == "fork":
        _show("forkserver")
        gc.disable()  # until all is there, which stays
        importlib.import_module("actors.processes.preload")
        gc.enable()
    shared: list[object] = []  # outlives the server in each child
    server = ForkServer(channel, share if how == "fork" else None, shared, reap=whose == "reap")
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, 0)  # from here on the end of the socket tells, and there is time for order
    channel.send(json.dumps({"ready": os.getpid()}).encode())
    part = server.serve()
    if part is not None:
        channel.detach()  # a child has closed the descriptor
        del server, channel  # nothing that a child finds leads to them
        _be(part, enter if how == "fork" else execute)
    channel.close()
    return 0


def _be(part: Part, become: Callable[[Part], int]) -> NoReturn:
    """In a child: its whole life."""
    code = 1
    try:
        code = become(part)
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
