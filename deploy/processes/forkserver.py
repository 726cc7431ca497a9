"""A process that starts the actors, reaps whatever they leave, and ends with whoever started it.

`python -m deploy.processes.forkserver FD fork|exec reap|spare` serves on a socket: `{"start": [module,
argv, log]}` is answered by `{"started": pid}`, or by `{"refused": why}` where the log is no new file, and
the end of a child is told as `{"ended": pid, "code": code, "strays": n, "cpu_s": s}`: n processes that the
child had started outlived it and have been ended (`reap`; `spare` leaves them alone), and s is the CPU time
that the system charged for it and for what it has waited for. `fork`: it has imported and
compiled everything once, and forks from there; `exec`: it is small, and every child begins anew. To
`{"share": [module, words]}`, which nothing answers, a server that forks makes what `share(*words)` of the
module gives and holds it, so that children find it in memory. `{"withdraw": path}` names a router file: the
passwords and sockets of a run, which the server removes at its end if they are still there. It ends, and its
children, when the other end of the socket closes. The standard library's forkserver leaves a socket file and
keeps running when its parent is killed, see docs/decisions.
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
from typing import Any, Final

from actors.runtime.errors import AcrcError
from actors.runtime.lifecycle import process_table
from actors.runtime.lifecycle.linux import PR_SET_CHILD_SUBREAPER, PR_SET_PDEATHSIG, prctl, set_title
from actors.runtime.lifecycle.log import create_log, write_to

MESSAGE_LIMIT: Final = 1 << 16
"""Bytes of one message on the socket."""
_GRACE_S: Final = 3.0
"""How long an actor may take to end in order once whoever wanted it is gone."""
Enter = Callable[[str, Sequence[str]], int]
"""Becomes an actor, in a process of its own: module, argv; its exit code, if it comes back."""
Share = Callable[[str, Sequence[str]], object]
"""What children are to share: module, words."""


class Server:
    """Starts children on request and tells of their ends."""

    def __init__(self, channel: socket.socket, enter: Enter, share: Share, *, reap: bool) -> None:
        self._channel = channel
        self._enter = enter
        self._share = share
        self._shared: list[object] = []
        self._reaps = reap
        self._actors: dict[int, str] = {}
        """The log of each child that runs, by process id."""
        self._withdrawn: list[Path] = []
        """Router files; what they name is removed at the end if nobody has done so."""
        self._alarm_out, self._alarm_in = os.pipe()

    def serve(self) -> None:
        """Start on request until the other end closes; then end everything."""
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
                self._end_all()
                self._withdraw()

    def _answer(self, descriptor: int) -> bool:
        """Do what is asked for; False once nobody is there to ask."""
        if descriptor == self._alarm_out:
            os.read(self._alarm_out, 512)
            self._reap()
            return True
        try:
            request = self._channel.recv(MESSAGE_LIMIT)
        except ConnectionResetError:
            return False
        if not request:
            return False
        asked = json.loads(request)
        if "withdraw" in asked:
            self._withdrawn.append(Path(asked["withdraw"]))
            return True
        if "share" in asked:
            with contextlib.suppress(AcrcError):  # whoever needs it makes it, and says what is wrong
                self._shared.append(self._share(*asked["share"]))
            return True
        self._start(*asked["start"])
        return True

    def _start(self, module: str, argv: Sequence[str], log: str) -> None:
        try:
            stream = create_log(Path(log))
        except OSError as error:
            self._tell({"refused": f"{log}: {error.strerror}"})
            return
        try:
            pid = self._fork(module, argv, stream, Path(log).stem)
        except OSError as error:  # no more processes, or no memory for one
            self._tell({"refused": f"fork: {error.strerror}"})
            return
        finally:
            os.close(stream)
        self._actors[pid] = log
        self._tell({"started": pid})

    def _fork(self, module: str, argv: Sequence[str], log: int, actor: str) -> int:
        server = os.getpid()
        pid = os.fork()
        if pid:
            return pid
        code = 1
        try:
            _tie_to(server)
            os.setsid()  # a terminal's Ctrl-C passes it by, and what it starts is known by the session
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for descriptor in (self._channel.fileno(), self._alarm_out, self._alarm_in):
                os.close(descriptor)
            write_to(log)
            _show(actor)
            code = self._enter(module, argv)
        except SystemExit as leave:
            code = leave.code if isinstance(leave.code, int) else 1
        except BaseException:  # the child must never return into the server's loop
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)

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

    def _orphans(self, actor: int, log: str) -> set[int]:
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
        from actors.runtime.access import router_file  # noqa: PLC0415  # a server that executes stays small

        for file in self._withdrawn:
            with contextlib.suppress(AcrcError):
                router_file.remove(file)

    def _tell(self, message: dict[str, Any]) -> None:
        try:
            self._channel.send(json.dumps(message).encode())
        except (BrokenPipeError, ConnectionResetError):
            return  # nobody is there any more: the next request is the end of the socket


def enter(module: str, argv: Sequence[str]) -> int:
    """Run `main(argv)` of the module, or of a package's `__main__`, as exec would; its exit code."""
    code: int = importlib.import_module(_program(module)).main(argv)
    return code


def share(module: str, words: Sequence[str]) -> object:
    """What `share(*words)` of the module gives, where no collection will touch it, which would copy it."""
    from actors.runtime.process import settle  # noqa: PLC0415  # a server that executes stays small

    shared: object = importlib.import_module(module).share(*words)
    settle()
    return shared


def execute(module: str, argv: Sequence[str]) -> int:
    """Become `python -P -m MODULE ARGV…`: what lies where it begins is no code."""
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *argv])


def _program(module: str) -> str:
    """What `python -m module` executes."""
    spec = importlib.util.find_spec(module)
    is_package = spec is not None and spec.submodule_search_locations is not None
    return f"{module}.__main__" if is_package else module


def _writes_to(pid: int, log: str) -> bool:
    try:
        return str(Path(f"/proc/{pid}/fd/1").readlink()) == log
    except OSError:
        return False


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
        importlib.import_module("deploy.processes.preload")
        gc.enable()
    served: tuple[Enter, Share] = (enter, share) if how == "fork" else (execute, lambda module, words: None)
    server = Server(channel, *served, reap=whose == "reap")
    if sys.platform == "linux":
        prctl(PR_SET_PDEATHSIG, 0)  # from here on the end of the socket tells, and there is time for order
    channel.send(json.dumps({"ready": os.getpid()}).encode())
    server.serve()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
