"""The command line in a process that has imported already: a fork of one that waits for this worker's tests.

A command needs a thousand modules, and importing them takes a second, more than most commands do themselves.
What is forked is a process like any other: it has folder, environment, streams, exit code and end of its own.
Where the interpreter's own beginning matters, a test starts a new one.
"""

import atexit
import json
import math
import os
import pkgutil
import select
import selectors
import signal
import socket
import subprocess
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module, invalidate_caches
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final, NoReturn

from actors.processes import launch
from tests.warm_server import BEGIN, be_server, serve_warm

ROOT: Final = Path(__file__).resolve().parents[1]
ACRC: Final = "command_line.app"
MESSAGE_LIMIT: Final = 1 << 20
"""Bytes of what is asked for."""
READ_AT_START: Final = ("GLIBC_", "LD_", "MALLOC_", "NPY_", "NUMBA_", "OMP_", "OPENBLAS_", "PYTHON")
"""Variables that begin so have done their work once the modules are there; a fork would not heed others."""

LEFT_OUT: Final = (
    "command_line.documentation.",
    "command_line.experiments.",
    "deploy.clusters.",
    "deploy.hosts.",
) + (() if find_spec("rerun") else ("deploy.fleet.watched", "observation.view."))
"""What few commands need is imported by these, among it Dask, which reads its configuration then; what draws
into the viewer only where that is installed."""


def read_at_start(env: Mapping[str, str]) -> dict[str, str]:
    """The variables that a process must begin with, as it does not look at them again."""
    return {k: v for k, v in env.items() if k.startswith(READ_AT_START) and k != "PYTHONPATH"}


BEGUN: Final = read_at_start(os.environ) | {"OPENBLAS_NUM_THREADS": "1"}
"""What the waiting process begins with, whatever a test, or a program that one imports, has set by then."""


def heeds(env: Mapping[str, str]) -> bool:
    """True if a fork would do what a new process does that begins with these variables."""
    return read_at_start(env).items() <= BEGUN.items()


def run(
    words: Sequence[str],
    cwd: Path,
    env: Mapping[str, str],
    timeout_s: float,
    *,
    finds_cwd: bool,
    program: str = ACRC,
    cores: Sequence[int] = (),
) -> subprocess.CompletedProcess[str]:
    """What `python -m command_line WORDS…` does in this folder and environment; `finds_cwd`: without `-P`.

    In an environment that a fork heeds, there can be another `program`, a module with a `main`, and `cores`,
    the only ones that it and what it starts may run on.
    """
    if heeds(env):
        begun = begin(words, cwd, env, finds_cwd=finds_cwd, program=program, cores=cores)
        try:
            out, err = begun.communicate(timeout_s)
            return subprocess.CompletedProcess(words, begun.wait(), out, err)
        finally:  # also when pytest holds that the test has taken long enough
            begun.kill()
            begun.close()
    assert program == ACRC and not cores
    flags = () if finds_cwd else ("-P",)
    return subprocess.run(
        [sys.executable, *flags, "-m", "command_line", *words],
        cwd=cwd, env=env, capture_output=True, text=True, timeout=timeout_s, check=False,
    )  # fmt: skip


def begin(
    words: Sequence[str],
    cwd: Path,
    env: Mapping[str, str],
    *,
    finds_cwd: bool,
    program: str = ACRC,
    cores: Sequence[int] = (),
) -> "Begun":
    """The same as `run` in an environment that a fork heeds, begun and left alone."""
    assert heeds(env)
    asked = {"words": words, "cwd": str(cwd), "env": dict(env), "finds_cwd": finds_cwd}
    return _waiting().begin({**asked, "program": program, "cores": cores})


def begin_server(command: Sequence[str], channel: socket.socket) -> launch.Server:
    """Stands for `launch.begin` in a test's own process: a server that forks is a fork itself."""
    *_, how, whose = command
    if command[0] != sys.executable or how != "fork" or not heeds(os.environ):
        return BEGIN(command, channel)
    return _waiting().begin_server([how, whose], channel.fileno())


class Begun:
    """A command that a fork of the waiting process has become, as subprocess.Popen is one."""

    def __init__(self, words: Sequence[str], out: int, err: int, told: int) -> None:
        """`out`, `err`, `told`: what it prints, and what the waiting process says of it, to be read."""
        self._words = words
        self._told = os.fdopen(told)
        self.stdout, self.stderr = os.fdopen(out), os.fdopen(err)
        self.pid = int(self._told.readline())
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Its exit code, or minus the signal that ended it; None as long as it runs."""
        return self._await(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """The same once it has ended; subprocess.TimeoutExpired."""
        code = self._await(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(self._words, timeout or 0.0)
        return code

    def communicate(self, timeout: float | None = None) -> tuple[str, str]:
        """All that it still prints, on either stream, once it has ended; subprocess.TimeoutExpired."""
        deadline = math.inf if timeout is None else time.monotonic() + timeout
        try:
            out, err = _read_all((self.stdout.fileno(), self.stderr.fileno()), deadline)
        except TimeoutError:
            raise subprocess.TimeoutExpired(self._words, timeout or 0.0) from None
        self.wait(None if timeout is None else max(0.0, deadline - time.monotonic()))
        return out, err

    def send_signal(self, number: int) -> None:
        """Send it, unless the command is known to have ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it."""
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def close(self) -> None:
        """Nothing more will be read of it."""
        for stream in (self._told, self.stdout, self.stderr):
            stream.close()

    def _await(self, timeout_s: float | None) -> int | None:
        if self.returncode is None and select.select([self._told], [], [], timeout_s)[0]:
            self.returncode = int(self._told.readline())
        return self.returncode


class ForkedServer:
    """A forkserver that is a fork of the waiting process, as `actors.processes.launch` wants one."""

    def __init__(self, told: int) -> None:
        self._told = os.fdopen(told)
        self.pid = int(self._told.readline())
        self._code: int | None = None

    def kill(self) -> None:
        """End it."""
        if self._code is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> int:
        """Its exit code, or minus the signal that ended it."""
        if self._code is None:
            with self._told:
                self._code = int(self._told.readline())
        return self._code


class Waiting:
    """The process that has imported everything, and forks; it ends with the tests."""

    def __init__(self) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        rest = {name: value for name, value in os.environ.items() if name not in read_at_start(os.environ)}
        own = {"PYTHONPATH": str(ROOT)}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "tests.warm", str(theirs.fileno())],
            cwd=ROOT,
            env={**rest, **BEGUN, **own},
            pass_fds=(theirs.fileno(),),
        )
        theirs.close()
        atexit.register(self.end)

    def begin(self, asked: dict[str, Any]) -> Begun:
        """Begin a command as asked for in `begin` below."""
        ours, theirs = zip(os.pipe(), os.pipe(), os.pipe(), strict=True)
        self._ask(asked, theirs)
        for descriptor in theirs:
            os.close(descriptor)
        return Begun(asked["words"], *ours)

    def begin_server(self, words: Sequence[str], channel: int) -> ForkedServer:
        """Begin a forkserver with these words, which serves on the channel, and says what it says here."""
        ours, theirs = os.pipe()
        try:
            self._ask({"server": words, "env": dict(os.environ)}, (channel, 2, theirs))
        finally:
            os.close(theirs)
        return ForkedServer(ours)

    def end(self) -> None:
        """Nothing more will be asked for."""
        self._channel.close()
        self._process.wait()

    def _ask(self, asked: dict[str, Any], descriptors: Sequence[int]) -> None:
        socket.send_fds(self._channel, [json.dumps(asked).encode()], descriptors)


@cache
def _waiting() -> Waiting:
    return Waiting()


def _read_all(descriptors: Sequence[int], deadline: float) -> list[str]:
    """What comes until nobody can write any more; TimeoutError."""
    data = {descriptor: bytearray() for descriptor in descriptors}
    with selectors.DefaultSelector() as selector:
        for descriptor in descriptors:
            selector.register(descriptor, selectors.EVENT_READ)
        while selector.get_map():
            left = deadline - time.monotonic()
            ready = selector.select(None if left == math.inf else max(0.0, left))
            if not ready:
                raise TimeoutError
            for key, _ in ready:
                data[key.fd] += (piece := os.read(key.fd, 1 << 16))
                if not piece:
                    selector.unregister(key.fd)
    return [bytes(piece).decode() for piece in data.values()]


def serve(channel: socket.socket) -> None:
    """Fork as asked for until the other end closes, one command at a time."""
    import_module("actors.processes.preload")
    for package in ("command_line", "deploy", "observation"):
        for module in pkgutil.walk_packages(import_module(package).__path__, f"{package}."):
            if not (module.name.endswith("__main__") or module.name.startswith(LEFT_OUT)):
                import_module(module.name)
    import_module(
        "actors.runtime.process"
    ).settle()  # collecting in a fork would look at all this, and copy it
    own = [place for place in sys.path if place != str(ROOT)]
    made = {name: value for name, value in os.environ.items() if name.startswith("NUMBA_")}
    with selectors.DefaultSelector() as selector:
        selector.register(channel, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is not channel:
                    selector.unregister(key.fd)
                    _tell_end(key.fd, *key.data)
                    continue
                message, descriptors, _, _ = socket.recv_fds(channel, MESSAGE_LIMIT, 3)
                if not message:
                    return
                *streams, told = descriptors
                pid = os.fork()
                if pid == 0:
                    channel.close()
                    os.close(told)
                    _become(json.loads(message), streams, own, made)
                for descriptor in streams:
                    os.close(descriptor)
                os.write(told, f"{pid}\n".encode())
                selector.register(os.pidfd_open(pid), selectors.EVENT_READ, (pid, told))


def _tell_end(descriptor: int, pid: int, told: int) -> None:
    """Say how a fork has ended to whoever reads `told`; `descriptor`: of its process."""
    _, status = os.waitpid(pid, 0)
    with suppress(BrokenPipeError):  # nobody does any more
        os.write(told, f"{os.waitstatus_to_exitcode(status)}\n".encode())
    os.close(told)
    os.close(descriptor)


def _become(
    asked: dict[str, Any], descriptors: Sequence[int], places: Sequence[str], made: Mapping[str, str]
) -> NoReturn:
    """Be the command, or the forkserver, from here on, and end as an interpreter does.

    `places`: where modules are besides the environment's; `made`: the variables that modules have set.
    """
    if "server" in asked:
        channel, err = descriptors
        os.dup2(err, 2)
        os.environ.clear()
        os.environ.update({**made, **asked["env"]})
        serve_warm(places)  # what a trial of a campaign starts is found in its own fork
        be_server(channel, asked["server"], places)
    code: object = 1
    try:
        with Path(os.devnull).open() as nothing:
            for number, descriptor in enumerate((nothing.fileno(), *descriptors)):
                os.dup2(descriptor, number)
        for descriptor in descriptors:
            os.close(descriptor)
        os.chdir(asked["cwd"])
        os.sched_setaffinity(0, asked["cores"] or os.sched_getaffinity(0))
        os.environ.clear()
        os.environ.update({**made, **asked["env"]})
        named = [place for place in asked["env"].get("PYTHONPATH", "").split(os.pathsep) if place]
        sys.path[:] = [*([asked["cwd"]] if asked["finds_cwd"] else ()), *named, *places]
        sys.argv = [str(ROOT / "command_line" / "__main__.py"), *asked["words"]]
        invalidate_caches()
        serve_warm(places)
        import_module(asked["program"]).main()
        code = 0
    except SystemExit as leave:
        code = leave.code
    except BaseException:  # the child must never return into the server's loop
        traceback.print_exc()
    finally:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code if isinstance(code, int) else code is not None)


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
